"""Configuration: TOML -> frozen records. `sections` has the keys, `reading` the errors."""

from onboard.config.cameras import CameraConfig
from onboard.config.reading import (
    ConfigError,
    estimator_modules,
    load_config,
    named_estimators,
    parse_config,
    read_table,
)
from onboard.config.recorded import of_flight, read_recorded
from onboard.config.ros import ros_encoder
from onboard.config.sections import (
    FASTEST_OUT_HZ,
    AutopilotConfig,
    Config,
    DelayConfig,
    GuidanceConfig,
    LeaderOutConfig,
    LinkConfig,
    OdometryConfig,
    OwnErrors,
    OwnshipConfig,
    ParametersConfig,
    RecorderConfig,
    TrafficOutConfig,
    WarmStartConfig,
    source_delays_ns,
)
from onboard.config.storing import Storing, check_storable, read_stored, signing_key, store, storing_of
from onboard.config.warm_start import WarmFile, datagram_of

__all__ = [
    "FASTEST_OUT_HZ",
    "AutopilotConfig",
    "CameraConfig",
    "Config",
    "ConfigError",
    "DelayConfig",
    "GuidanceConfig",
    "LeaderOutConfig",
    "LinkConfig",
    "OdometryConfig",
    "OwnErrors",
    "OwnshipConfig",
    "ParametersConfig",
    "RecorderConfig",
    "Storing",
    "TrafficOutConfig",
    "WarmFile",
    "WarmStartConfig",
    "check_storable",
    "datagram_of",
    "estimator_modules",
    "load_config",
    "named_estimators",
    "of_flight",
    "parse_config",
    "read_recorded",
    "read_stored",
    "read_table",
    "ros_encoder",
    "signing_key",
    "source_delays_ns",
    "store",
    "storing_of",
]
