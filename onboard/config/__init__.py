"""Configuration from TOML to frozen records; `sections` has the keys, `reading` the errors."""

# `as` its own name: for others to import from here
from onboard.config.cameras import CameraConfig as CameraConfig
from onboard.config.reading import ConfigError as ConfigError
from onboard.config.reading import load_config as load_config
from onboard.config.reading import named_estimators as named_estimators
from onboard.config.reading import parse_config as parse_config
from onboard.config.reading import read_table as read_table
from onboard.config.recorded import flight_metadata as flight_metadata
from onboard.config.recorded import read_recorded as read_recorded
from onboard.config.ros import ros_encoder as ros_encoder
from onboard.config.sections import MAX_OUT_RATE_HZ as MAX_OUT_RATE_HZ
from onboard.config.sections import AutopilotConfig as AutopilotConfig
from onboard.config.sections import Config as Config
from onboard.config.sections import DelayConfig as DelayConfig
from onboard.config.sections import GuidanceConfig as GuidanceConfig
from onboard.config.sections import LeaderOutConfig as LeaderOutConfig
from onboard.config.sections import LinkConfig as LinkConfig
from onboard.config.sections import OdometryConfig as OdometryConfig
from onboard.config.sections import OwnErrors as OwnErrors
from onboard.config.sections import OwnshipConfig as OwnshipConfig
from onboard.config.sections import ParametersConfig as ParametersConfig
from onboard.config.sections import RecorderConfig as RecorderConfig
from onboard.config.sections import TrafficOutConfig as TrafficOutConfig
from onboard.config.sections import WarmStartConfig as WarmStartConfig
from onboard.config.sections import source_delays_ns as source_delays_ns
from onboard.config.storing import Storing as Storing
from onboard.config.storing import check_storable as check_storable
from onboard.config.storing import make_storing as make_storing
from onboard.config.storing import read_stored as read_stored
from onboard.config.storing import signing_key as signing_key
from onboard.config.storing import store as store
from onboard.config.warm_start import WarmFile as WarmFile
from onboard.config.warm_start import warm_datagram as warm_datagram
