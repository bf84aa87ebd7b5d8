"""Parameters over MAVLink, in the ordinary and the extended protocol; PING."""

from enum import StrEnum

from onboard.messages.base import Message


class ParamAction(StrEnum):
    """What is requested of parameters."""

    LIST = "list"
    READ = "read"
    SET = "set"


class ParamRequest(Message, frozen=True, kw_only=True):
    """PARAM_REQUEST_LIST, PARAM_REQUEST_READ, PARAM_SET, or their `extended` counterparts. A parameter is
    named, or numbered if `index` is not negative. `value` is None where it is no number."""

    target_system: int
    target_component: int
    action: ParamAction
    extended: bool
    name: str = ""
    index: int = -1
    value: float | None = None


class ParamValue(Message, frozen=True, kw_only=True):
    """PARAM_VALUE or PARAM_EXT_VALUE: number `index` of `count` parameters. `default`, where it is known: what the
    value is unless somebody sets it. A log's parameters have no number: -1 of 0."""

    extended: bool
    name: str
    value: float
    count: int = 0
    index: int = -1
    default: float | None = None


class ParamAck(Message, frozen=True, kw_only=True):
    """PARAM_EXT_ACK: a parameter's value after a request to set it."""

    name: str
    value: float
    accepted: bool


class Ping(Message, frozen=True, kw_only=True):
    """PING: a request if both targets are 0. `time_us` is the requester's."""

    time_us: int
    number: int
    target_system: int
    target_component: int


class Version(Message, frozen=True, kw_only=True):
    """AUTOPILOT_VERSION of a companion computer: MAV_PROTOCOL_CAPABILITY bits and version."""

    capabilities: int
    version: tuple[int, int, int]


class ComputerStatus(Message, frozen=True, kw_only=True):
    """ONBOARD_COMPUTER_STATUS: seconds since boot, load of each core in percent, bytes of memory and storage,
    deg C. None or empty: not known."""

    uptime: float
    cpu_percent: tuple[float, ...]
    memory_used: int | None
    memory_total: int | None
    storage_used: int | None
    storage_total: int | None
    temperature: float | None


class CameraInformation(Message, frozen=True, kw_only=True):
    """CAMERA_INFORMATION of a camera in which we track the leader, and which takes no commands."""

    name: str
    width_px: int
    height_px: int
    version: tuple[int, int, int]
