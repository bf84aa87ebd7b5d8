"""How the daemon is."""

from onboard.messages.base import Record
from onboard.messages.estimates import Fault, Lifecycle


class StreamHealth(Record, frozen=True, kw_only=True):
    """One message stream: how many, how often (Hz, over the last seconds), how long ago (s)."""

    count: int
    rate: float
    age: float


class SinkHealth(Record, frozen=True, kw_only=True):
    """One sink: records handed on, dropped because its queue was full, restarts after a failure."""

    sent: int = 0
    dropped: int = 0
    restarts: int = 0
    error: str = ""


class Health(Record, frozen=True, kw_only=True):
    """How the program itself is doing. `clock_offset_ns` is host clock minus boot clock; `faults` are those of our
    own vehicle that last."""

    t_ns: int
    t_recv_ns: int
    uptime: float
    autopilot: str
    autopilot_reboots: int
    clock_source: str
    clock_offset_ns: int | None
    round_trip: float | None
    streams: dict[str, StreamHealth]
    states: dict[str, Lifecycle]
    verdicts: dict[str, int]
    rejected: dict[str, int]
    sinks: dict[str, SinkHealth]
    faults: tuple[Fault, ...] = ()
