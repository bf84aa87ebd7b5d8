"""Table of all MAVLink messages that the daemon can send; others are refused.

The documentation's tables are made from it.
"""

from typing import Final, NamedTuple

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

BY_ITSELF: Final = "by itself"  # on each link with `autopilot = true`, after the autopilot's first heartbeat
IN_ANSWER: Final = "in answer"  # on the link that asked
WHERE_NAMED: Final = "where named"  # on a link that the configuration names for it, and only there


class SentKind(NamedTuple):
    """MAVLink names of a message that we send, its occasion, and notes for the documentation."""

    names: tuple[str, ...]
    occasion: str
    when: str


SENT: Final[dict[type[Message], SentKind]] = {
    Heartbeat: SentKind(
        ("HEARTBEAT",),
        BY_ITSELF,
        "once a second, as an onboard controller of the autopilot's system; on a link of `[[leader_out]]` also "
        "as the leader and as a camera",
    ),
    TimeSync: SentKind(("TIMESYNC",), BY_ITSELF, "five requests a second; an answer to each request"),
    Command: SentKind(
        ("COMMAND_LONG",),
        BY_ITSELF,
        "requests for messages alone, never with `request_rates = false`: MAV_CMD_SET_MESSAGE_INTERVAL for each "
        "stream of `[autopilot.rates_hz]` that is too slow, every 5 s, and once a boot for EKF_STATUS_REPORT or "
        "ESTIMATOR_STATUS and ODOMETRY, and with setpoints EXTENDED_SYS_STATE and CURRENT_MODE; "
        "MAV_CMD_REQUEST_MESSAGE for GPS_GLOBAL_ORIGIN until it comes, every 5 s",
    ),
    ParamRequest: SentKind(
        ("PARAM_REQUEST_READ",),
        BY_ITSELF,
        "`[[leader_out]]` with setpoints: the parameters that limit them, until they come, three times a boot; "
        "never with `request_rates = false`",
    ),
    ComputerStatus: SentKind(
        ("ONBOARD_COMPUTER_STATUS",), BY_ITSELF, "once a second, where this computer shows its load"
    ),
    StatusText: SentKind(("STATUSTEXT",), BY_ITSELF, "seldom: what a pilot must know"),
    CommandAck: SentKind(
        ("COMMAND_ACK",),
        IN_ANSWER,
        "to commands for our components: requests for a message of ours or its interval are done or denied, all "
        "others are unsupported",
    ),
    MessageInterval: SentKind(("MESSAGE_INTERVAL",), IN_ANSWER, "to MAV_CMD_GET_MESSAGE_INTERVAL"),
    Ping: SentKind(("PING",), IN_ANSWER, "to a PING for all"),
    ParamValue: SentKind(("PARAM_VALUE", "PARAM_EXT_VALUE"), IN_ANSWER, "tunable keys of the configuration"),
    ParamAck: SentKind(("PARAM_EXT_ACK",), IN_ANSWER, "whether a key was stored, for the next start"),
    Version: SentKind(("AUTOPILOT_VERSION",), IN_ANSWER, "to a request for it"),
    CameraInformation: SentKind(
        ("CAMERA_INFORMATION",), IN_ANSWER, "to a request of the camera of `[[leader_out]]`"
    ),
    Setpoint: SentKind(
        ("SET_POSITION_TARGET_LOCAL_NED",),
        WHERE_NAMED,
        "`[[leader_out]]`: where to fly behind the leader. It moves the vehicle, in the mode that the pilot "
        "enters for it",
    ),
    FollowTarget: SentKind(("FOLLOW_TARGET",), WHERE_NAMED, "`[[leader_out]]`: the leader, smoothed"),
    GlobalPosition: SentKind(("GLOBAL_POSITION_INT",), WHERE_NAMED, "`[[leader_out]]`: the same"),
    TargetRelative: SentKind(("TARGET_RELATIVE",), WHERE_NAMED, "`[[leader_out]]`: the leader from us"),
    LandingTarget: SentKind(("LANDING_TARGET",), WHERE_NAMED, "`[[leader_out]]`: its direction and range"),
    CameraTracking: SentKind(
        ("CAMERA_TRACKING_IMAGE_STATUS",), WHERE_NAMED, "`[[leader_out]]`: where in the image"
    ),
    CameraTrackingGeo: SentKind(
        ("CAMERA_TRACKING_GEO_STATUS",), WHERE_NAMED, "`[[leader_out]]`: where on the map"
    ),
    AdsbVehicle: SentKind(
        ("ADSB_VEHICLE",), WHERE_NAMED, "`[traffic_out]`, `[[leader_out]]`: aircraft on the map"
    ),
    Collision: SentKind(
        ("COLLISION",), WHERE_NAMED, "`[traffic_out]`: a threat, reported with no action asked for"
    ),
    Odometry: SentKind(("ODOMETRY",), WHERE_NAMED, "`[odometry]`: our own state"),
}
SENT_COMMANDS: Final = {  # of COMMAND_LONG; none of them moves a vehicle
    dialect.MAV_CMD_SET_MESSAGE_INTERVAL: "MAV_CMD_SET_MESSAGE_INTERVAL",
    dialect.MAV_CMD_REQUEST_MESSAGE: "MAV_CMD_REQUEST_MESSAGE",
}


class Encoder(MavlinkEncoder):
    """Encodes the messages and commands of these tables, for one sender."""

    def encode(self, message: Message) -> bytes:
        """Encode a message as frames. Raises ValueError if it is not in the table."""
        if type(message) not in SENT or (isinstance(message, Command) and message.command not in SENT_COMMANDS):
            raise ValueError(f"{type(message).__name__} is not sent: onboard/autopilot/sent.py does not list it")
        return super().encode(message)
