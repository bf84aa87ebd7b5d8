"""The condition of the daemon."""

from enum import StrEnum
from typing import Final

import msgspec
from msgspec.structs import force_setattr

from onboard.messages.base import Record
from onboard.messages.causes import Cause
from onboard.messages.estimates import Fault, Lifecycle


class StreamHealth(Record, frozen=True, kw_only=True):
    """One message stream: number of messages, rate over the last seconds (Hz), age of the last message (s)."""

    count: int
    rate: float
    age: float


class SinkHealth(Record, frozen=True, kw_only=True):
    """One sink: records sent, records dropped because its queue was full, restarts after failures, and the
    present error with its cause. `dropped_important`: of the dropped records, those that give way to no others.
    In the recorder these are the received bytes, in Zenoh all but further targets and traffic."""

    sent: int = 0
    dropped: int = 0
    dropped_important: int = 0
    restarts: int = 0
    error: str = ""
    cause: Cause = Cause.NONE


class LinkHealth(Record, frozen=True, kw_only=True):
    """One link: datagrams (or pieces of a stream) received and sent, failed sends and reads, datagrams that the
    kernel dropped because the program was too slow, and the size of the kernel's buffer (0: not known). `shed`:
    datagrams of a sender beyond its budget, which are neither decoded nor recorded; `skipped`: the same of
    datagrams that had waited in this program for too long. `routers`: Zenoh routers
    that this program is connected to; None for other links. `error`: why a link that connects by itself is not
    connected, with its `cause`. `refused`: connections that were refused while another gave messages;
    `refused_from`: the last."""

    received: int = 0
    sent: int = 0
    errors: int = 0
    dropped: int = 0
    buffer_bytes: int = 0
    shed: int = 0
    skipped: int = 0
    routers: int | None = None
    error: str = ""
    refused: int = 0
    refused_from: str = ""
    cause: Cause = Cause.NONE


DOUBT: Final = "in doubt: "  # before the reason of a refusal that is none: the messages were used ...
DOUBTS: Final = frozenset(  # ... of these causes
    {
        *(Cause.MOUNT, Cause.FOCAL_LENGTH, Cause.DELAY, Cause.CAMERA_SETUP, Cause.OFF_CENTER),
        *(Cause.OWN_MOTION_DOUBT, Cause.BINNED, Cause.QUARTER, Cause.RANGE_UNUSED, Cause.UNVERIFIED),
        Cause.KEY_UNREADABLE,
    }
)


class Refusal(Record, frozen=True, kw_only=True):
    """Messages of one camera that were refused for one reason. `source`: the key, link or camera that they came
    from. `reason`: the field, and what was expected; of several that differ only in a number, the first. `cause`:
    the same for programs. `t_recv_ns`: arrival of the latest."""

    source: str
    reason: str
    count: int
    t_recv_ns: int
    cause: Cause = Cause.NONE


class CameraHealth(Record, frozen=True, kw_only=True):
    """Images of one camera that could be put on the time base. `rate` over the last seconds, Hz; `age`: s since
    the last one arrived. Of the last one: `latency`, s from exposure to arrival; `lead`, s from our own newest
    motion to exposure (negative: before it); `clock` of its stamp, and the stamp as it came, ns. `off_axis`: the
    largest angle of a point of it off the optical axis, rad. `targets`, `classes`: names that its
    detector gives, of each the first few."""

    count: int
    rate: float
    age: float
    latency: float | None = None
    lead: float | None = None
    clock: str = ""
    stamp_ns: int | None = None
    off_axis: float = 0.0
    targets: tuple[str, ...] = ()
    classes: tuple[str, ...] = ()


class Consistency(Record, frozen=True, kw_only=True):
    """Whether the innovations of one source are as large as an estimator expects, over its last `count`
    measurements. `nis`: mean NIS over its expectation, 1 for the configured noise; `low`, `high`: its bounds
    (99.7 %), if nothing else is wrong. `noise`: by what factor the source is noisier than configured, by the
    same innovations and what an estimator has learnt of it."""

    count: int
    nis: float
    low: float
    high: float
    noise: float = 1.0


class ComputerLoad(Record, frozen=True, kw_only=True):
    """How busy this computer is: load of its busiest core and of all (%), memory and storage that are free
    (bytes; None: not known), and `lag`, the longest time (s) in the last second by which the daemon was late
    for its own timer."""

    cpu_busiest: float | None = None
    cpu: float | None = None
    memory_free: int | None = None
    storage_free: int | None = None
    lag: float = 0.0


class Severity(StrEnum):
    """How much a cause costs."""

    ERROR = "error"  # no estimate, or none of one kind, while it lasts
    WARNING = "warning"  # estimates are worse, or some are missing
    NOTICE = "notice"  # nothing, as long as it is meant


class Advice(Record, frozen=True, kw_only=True):
    """Something that is wrong, and its remedy. `kind`: the advice's name, of the table in docs/status.md; `cause`:
    the same under its old name, for one release, as one of the two at least is given;
    `about`: the camera, stream or link. `what`: what was found and what is needed, with figures; `remedy`: the
    line to type, or the key to change. `text`: the same for a pilot, as STATUSTEXT. `over`: what is reported once
    it is over. `count`: messages that were refused."""

    kind: str = ""
    cause: str = ""
    severity: Severity
    about: str
    what: str
    remedy: str
    text: str
    over: str = ""
    count: int = 1

    def __post_init__(self) -> None:
        force_setattr(self, "kind", self.kind or self.cause)
        force_setattr(self, "cause", self.kind)


class Health(Record, frozen=True, kw_only=True):
    """The condition of the daemon, once a second. `uptime` and `round_trip` (of TIMESYNC) in s;
    `clock_offset_ns`: host clock minus boot clock; `wall_step_ns`: Unix time minus host clock, 0 unless the wall
    clock has been set since the start; `clock_rate`: seconds of the boot clock in one of the
    host's. `states` by estimator; `verdicts` count measurements, `rejected` messages by reason. `faults`:
    present faults of our own vehicle. `refusals`: which camera messages, signed frames and requests of others
    were refused and why, of each the latest last. `own_motion_sources`: how often attitude and velocity of our
    own vehicle came to be taken from the autopilot or from our own state's estimator (`[ownship] source`), by
    which and why. `beside`: other autopilots that are heard; `beside_ids`: their MAVLink system and component, as
    `1/1`; `followed`: the same of the autopilot; `senders`: messages by system and component, of the first heard.
    `needed`: rate that each stream must have, Hz. `cameras`: whose images come. `reasons`: why the states are what
    they are, and `causes` for programs. `consistency` by estimator and source. `advice`: what is wrong and its
    remedy, the worst first."""

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
    wall_step_ns: int = 0
    beside: tuple[str, ...] = ()
    beside_ids: tuple[str, ...] = ()
    followed: str = ""
    senders: dict[str, int] = msgspec.field(default_factory=dict)
    needed: dict[str, float] = msgspec.field(default_factory=dict)
    cameras: dict[str, CameraHealth] = msgspec.field(default_factory=dict)
    reasons: dict[str, str] = msgspec.field(default_factory=dict)
    causes: dict[str, Cause] = msgspec.field(default_factory=dict)
    consistency: dict[str, Consistency] = msgspec.field(default_factory=dict)
    computer: ComputerLoad = ComputerLoad()
    advice: tuple[Advice, ...] = ()
