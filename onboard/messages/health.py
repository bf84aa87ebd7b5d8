"""The condition of the daemon."""

from typing import Final

import msgspec

from onboard.messages.base import Record
from onboard.messages.estimates import Fault, Lifecycle


class StreamHealth(Record, frozen=True, kw_only=True):
    """One message stream: number of messages, rate over the last seconds (Hz), age of the last message (s)."""

    count: int
    rate: float
    age: float


class SinkHealth(Record, frozen=True, kw_only=True):
    """One sink: records sent, records dropped because its queue was full, restarts after failures, and the present
    error. `dropped_important`: of the dropped records, those that give way to no others. In the recorder these are
    the received bytes, in Zenoh all but further targets and traffic."""

    sent: int = 0
    dropped: int = 0
    dropped_important: int = 0
    restarts: int = 0
    error: str = ""


class LinkHealth(Record, frozen=True, kw_only=True):
    """One link: datagrams (or pieces of a stream) received and sent, failed sends and reads, datagrams that the
    kernel dropped because the program was too slow, and the size of the kernel's buffer (0: not known). `shed`:
    datagrams of a sender beyond its budget, which are neither decoded nor recorded. `routers`: Zenoh routers that
    this program is connected to; None for other links. `error`: why a link that connects by itself is not
    connected. `refused`: connections that were refused while another gave messages; `refused_from`: the last."""

    received: int = 0
    sent: int = 0
    errors: int = 0
    dropped: int = 0
    buffer_bytes: int = 0
    shed: int = 0
    routers: int | None = None
    error: str = ""
    refused: int = 0
    refused_from: str = ""


DOUBT: Final = "in doubt: "  # before the reason of a refusal that is none: the messages were used


class Refusal(Record, frozen=True, kw_only=True):
    """Messages of one camera that were refused for one reason. `source`: the key, link or camera that they came
    from. `reason`: the field, and what was expected; of several that differ only in a number, the first.
    `t_recv_ns`: arrival of the latest."""

    source: str
    reason: str
    count: int
    t_recv_ns: int


class Health(Record, frozen=True, kw_only=True):
    """The condition of the daemon, once a second. `uptime` and `round_trip` (of TIMESYNC) in s; `clock_offset_ns`:
    host clock minus boot clock; `clock_rate`: seconds of the boot clock in one of the host's. `states` by
    estimator; `verdicts` count measurements, `rejected` messages by reason. `faults`: present faults of our own
    vehicle. `refusals`: which camera messages, signed frames and requests of others were refused and why, of each
    the latest last. `own_motion_sources`: how often attitude and velocity of our own vehicle came to be taken from
    the autopilot or from our own state's estimator (`[ownship] source`), by which and why. `beside`: other
    autopilots that are heard."""

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
    links: dict[str, LinkHealth] = msgspec.field(default_factory=dict)
    refusals: tuple[Refusal, ...] = ()
    own_motion_sources: dict[str, int] = msgspec.field(default_factory=dict)
    clock_rate: float = 1.0
    beside: tuple[str, ...] = ()
