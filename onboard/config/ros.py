"""The encoder of records for ROS 2, as configured."""

from onboard.config.reading import ConfigError
from onboard.config.sections import Config
from onboard.wire.ros.messages import RosEncoder
from onboard.wire.ros.types import MISSING


def ros_encoder(config: Config) -> RosEncoder | None:
    """Return the encoder of `[ros2]`, or None if nothing is published for ROS 2.

    Raises ConfigError if a package is missing, also for received topics.
    """
    ros2 = config.ros2
    if not ros2.enabled and not config.ros_keys():
        return None
    if not config.zenoh.enabled and ros2.enabled:
        raise ConfigError("ros2.enabled needs zenoh.enabled = true, since it publishes over Zenoh")
    try:
        encoder = RosEncoder(ros2, ros2.rate_hz)
    except ImportError as error:
        key = "ros2.enabled" if ros2.enabled else "camera.ros_topic"
        raise ConfigError(f"{key}: {MISSING} ({error})") from error
    return encoder if ros2.enabled else None
