"""Tables of all MAVLink messages that the daemon can send; others are refused."""

from collections.abc import Mapping
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from onboard.messages import (
    AdsbVehicle,
    CameraInformation,
    CameraTracking,
    CameraTrackingGeo,
    Collision,
    Command,
    CommandAck,
    ComputerStatus,
    FollowTarget,
    GlobalPosition,
    Heartbeat,
    LandingTarget,
    Message,
    MessageInterval,
    Odometry,
    ParamAck,
    ParamRequest,
    ParamValue,
    Ping,
    Setpoint,
    StatusText,
    TargetRelative,
    TimeSync,
    Version,
)
from onboard.wire.mavlink.encode import MavlinkEncoder

# MAVLink's names of each record's messages; docs/published.md says when they are sent.
Names = Mapping[type[Message], tuple[str, ...]]
BY_ITSELF: Final[Names] = {  # on each link with `autopilot = true`, after the autopilot's first heartbeat
    Heartbeat: ("HEARTBEAT",),
    TimeSync: ("TIMESYNC",),
    Command: ("COMMAND_LONG",),
    ParamRequest: ("PARAM_REQUEST_READ",),
    ComputerStatus: ("ONBOARD_COMPUTER_STATUS",),
    StatusText: ("STATUSTEXT",),
}
IN_ANSWER: Final[Names] = {  # on the link that asked
    CommandAck: ("COMMAND_ACK",),
    MessageInterval: ("MESSAGE_INTERVAL",),
    Ping: ("PING",),
    ParamValue: ("PARAM_VALUE", "PARAM_EXT_VALUE"),
    ParamAck: ("PARAM_EXT_ACK",),
    Version: ("AUTOPILOT_VERSION",),
    CameraInformation: ("CAMERA_INFORMATION",),
}
WHERE_NAMED: Final[Names] = {  # on a link that the configuration names for it, and only there
    Setpoint: ("SET_POSITION_TARGET_LOCAL_NED",),
    FollowTarget: ("FOLLOW_TARGET",),
    GlobalPosition: ("GLOBAL_POSITION_INT",),
    TargetRelative: ("TARGET_RELATIVE",),
    LandingTarget: ("LANDING_TARGET",),
    CameraTracking: ("CAMERA_TRACKING_IMAGE_STATUS",),
    CameraTrackingGeo: ("CAMERA_TRACKING_GEO_STATUS",),
    AdsbVehicle: ("ADSB_VEHICLE",),
    Collision: ("COLLISION",),
    Odometry: ("ODOMETRY",),
}
SENT: Final[Names] = {**BY_ITSELF, **IN_ANSWER, **WHERE_NAMED}
SENT_COMMANDS: Final = {  # of COMMAND_LONG; none of them moves a vehicle
    dialect.MAV_CMD_SET_MESSAGE_INTERVAL: "MAV_CMD_SET_MESSAGE_INTERVAL",
    dialect.MAV_CMD_REQUEST_MESSAGE: "MAV_CMD_REQUEST_MESSAGE",
}


class Encoder(MavlinkEncoder):
    """Encodes the messages and commands of these tables, for one sender."""

    def encode(self, message: Message) -> bytes:
        """Encode a message as frames. Raises ValueError if it is not in them."""
        if type(message) not in SENT or (isinstance(message, Command) and message.command not in SENT_COMMANDS):
            raise ValueError(f"{type(message).__name__} is not sent: onboard/autopilot/sent.py does not list it")
        return super().encode(message)
