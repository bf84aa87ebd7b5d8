"""The encoder of records for ROS 2, as configured."""

from onboard.config.reading import ConfigError
from onboard.config.sections import Config
from onboard.wire.ros.messages import RosEncoder


def ros_encoder(config: Config) -> RosEncoder | None:
    """The encoder of `[ros2]`, None if nothing is published for ROS 2. Raises ConfigError if a package is
    missing."""
    ros2 = config.ros2
    if not ros2.enabled:
        return None
    if not config.zenoh.enabled:
        raise ConfigError("ros2.enabled: it is published over Zenoh: set zenoh.enabled = true")
    try:
        return RosEncoder(ros2, ros2.rate_hz)
    except ImportError as error:
        raise ConfigError(f"ros2.enabled: it needs rosbags ({error}): pip install 'wingline[ros2]'") from error
