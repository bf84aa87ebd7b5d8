"""The condition of the daemon."""

from onboard.messages.base import Record
from onboard.messages.estimates import Fault, Lifecycle


class StreamHealth(Record, frozen=True, kw_only=True):
    """One message stream: number of messages, rate over the last seconds (Hz), age of the last message (s)."""

    count: int
    rate: float
    age: float


class SinkHealth(Record, frozen=True, kw_only=True):
    """One sink: records sent, records dropped because its queue was full, restarts after failures, and the present
    error."""

    sent: int = 0
    dropped: int = 0
    restarts: int = 0
    error: str = ""


class Health(Record, frozen=True, kw_only=True):
    """The condition of the daemon, once a second. `uptime` and `round_trip` (of TIMESYNC) in s; `clock_offset_ns`:
    host clock minus boot clock. `states` by estimator; `verdicts` count measurements, `rejected` messages by
    reason. `faults`: present faults of our own vehicle."""

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
