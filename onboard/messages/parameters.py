"""Messages of the parameter protocols, and of a MAVLink component's identity."""

from enum import StrEnum

from onboard.messages.base import Message


class ParamAction(StrEnum):
    """The kinds of parameter requests."""

    LIST = "list"
    READ = "read"
    SET = "set"


class ParamRequest(Message, frozen=True, kw_only=True):
    """PARAM_REQUEST_LIST, PARAM_REQUEST_READ, PARAM_SET, or their `extended` counterparts.

    Attributes
    ----------
    name, index
        The parameter's name, or its number if `index` is not negative.
    value
        None if the value is not a number.
    """

    target_system: int
    target_component: int
    action: ParamAction
    extended: bool
    name: str = ""
    index: int = -1
    value: float | None = None


class ParamValue(Message, frozen=True, kw_only=True):
    """PARAM_VALUE or PARAM_EXT_VALUE: number `index` of `count` parameters.

    Attributes
    ----------
    count, index
        0 and -1 for the parameters of a log, which have no number.
    default
        The value unless somebody sets it, if known.
    """

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
    """PING: a request if both targets are 0. `time_us` is that of the requester."""

    time_us: int
    number: int
    target_system: int
    target_component: int


class Version(Message, frozen=True, kw_only=True):
    """AUTOPILOT_VERSION of a companion computer: MAV_PROTOCOL_CAPABILITY bits and version."""

    capabilities: int
    version: tuple[int, int, int]


class ComputerStatus(Message, frozen=True, kw_only=True):
    """ONBOARD_COMPUTER_STATUS. None or empty: unknown.

    Attributes
    ----------
    uptime
        Seconds since boot.
    cpu_percent
        Load of each core.
    memory_used, memory_total, storage_used, storage_total
        Bytes.
    temperature
        Degrees Celsius.
    """

    uptime: float
    cpu_percent: tuple[float, ...]
    memory_used: int | None
    memory_total: int | None
    storage_used: int | None
    storage_total: int | None
    temperature: float | None


class CameraInformation(Message, frozen=True, kw_only=True):
    """CAMERA_INFORMATION of a camera in which we track the leader, and which accepts no commands."""

    name: str
    width_px: int
    height_px: int
    version: tuple[int, int, int]
