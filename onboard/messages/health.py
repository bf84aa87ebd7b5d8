"""The condition of the daemon: streams, links, sinks, cameras, consistency and advice."""

from enum import StrEnum
from typing import Final

import msgspec
from msgspec.structs import force_setattr

from onboard.messages.base import Record
from onboard.messages.causes import Cause
from onboard.messages.estimates import Fault, Lifecycle


class StreamHealth(Record, frozen=True, kw_only=True):
    """One message stream.

    Attributes
    ----------
    count
        Number of messages.
    rate
        Rate over the last seconds, Hz.
    age
        Age of the last message, s.
    """

    count: int
    rate: float
    age: float


class SinkHealth(Record, frozen=True, kw_only=True):
    """One sink: records sent and dropped, restarts after failures, and the present error.

    Attributes
    ----------
    dropped
        Records dropped because the queue was full.
    dropped_important
        Dropped records that give way to no others: received bytes in the recorder; in Zenoh everything except
        further targets and traffic.
    cause
        Cause of `error`.
    """

    sent: int = 0
    dropped: int = 0
    dropped_important: int = 0
    restarts: int = 0
    error: str = ""
    cause: Cause = Cause.NONE


class LinkHealth(Record, frozen=True, kw_only=True):
    """One link: datagrams (or pieces of a stream) received and sent, and its errors.

    Attributes
    ----------
    errors
        Failed sends and reads.
    dropped
        Datagrams that the kernel dropped because the program was too slow.
    buffer_bytes
        Size of the kernel's buffer; 0: unknown.
    shed
        Datagrams of a sender beyond its budget, which are neither decoded nor recorded.
    skipped
        Datagrams that had waited in this program for too long, and were not processed.
    routers
        Zenoh routers that this program is connected to; None for other links.
    error, cause
        Why a link that connects by itself is not connected.
    refused, refused_from
        Connections refused while another one was delivering messages, and the sender of the last one.
    """

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


DOUBT_PREFIX: Final = "in doubt: "  # begins the reason of a `Refusal` whose messages were used
DOUBT_CAUSES: Final = frozenset(  # causes of such refusals
    {
        *(Cause.MOUNT, Cause.OFF_CENTER),
        *(Cause.OWN_MOTION_DOUBT, Cause.BINNED, Cause.QUARTER, Cause.RANGE_UNUSED, Cause.UNVERIFIED),
        Cause.KEY_UNREADABLE,
    }
)


class Refusal(Record, frozen=True, kw_only=True):
    """Messages of one source that were refused for one reason.

    Attributes
    ----------
    source
        Key, link or camera that they came from.
    reason
        The field, and what was expected; the first of several that differ only in a number.
    cause
        The reason for programs.
    t_recv_ns
        Arrival of the latest.
    """

    source: str
    reason: str
    count: int
    t_recv_ns: int
    cause: Cause = Cause.NONE


class CameraHealth(Record, frozen=True, kw_only=True):
    """Images of one camera that could be put on the time base.

    Attributes
    ----------
    rate
        Rate over the last seconds, Hz.
    age
        Seconds since the last image arrived.
    latency
        Seconds from exposure to arrival of the last image.
    lead
        Seconds from our own newest motion to the exposure of the last image; negative: before it.
    clock, stamp_ns
        Clock of the last image's stamp, and the stamp as it came.
    off_axis
        Largest angle between a point of the last image and the optical axis, rad.
    targets, classes
        First few names that its detector gives to aircraft and to classes.
    """

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
    """Whether the innovations of one source are as large as its estimator expects.

    Attributes
    ----------
    count
        Number of measurements, the latest ones.
    nis
        Mean NIS over its expectation; 1 for the configured noise.
    low, high
        Bounds of `nis` (99.7 %) if nothing else is wrong.
    noise
        Factor by which the source is noisier than configured, from the innovations and from what its estimator has
        learnt.
    """

    count: int
    nis: float
    low: float
    high: float
    noise: float = 1.0


class ComputerLoad(Record, frozen=True, kw_only=True):
    """The load of this computer.

    Attributes
    ----------
    cpu_busiest, cpu
        Load of the busiest core and of all, %.
    memory_free, storage_free
        Free memory and storage, bytes; None: unknown.
    lag
        Longest time in the last second by which the daemon was late for its own timer, s.
    uptime
        Time since the computer's boot, s; None: unknown.
    """

    cpu_busiest: float | None = None
    cpu: float | None = None
    memory_free: int | None = None
    storage_free: int | None = None
    lag: float = 0.0
    uptime: float | None = None


class Severity(StrEnum):
    """The consequence of an advice's cause."""

    ERROR = "error"  # no estimates, or none of one kind, while it lasts
    WARNING = "warning"  # estimates are worse, or some are missing
    NOTICE = "notice"  # no consequence if it is intended


class Advice(Record, frozen=True, kw_only=True):
    """A problem and its remedy.

    Attributes
    ----------
    kind
        Name of the advice, of the table in docs/status.md.
    cause
        The old name of `kind`, accepted for one release; at least one of the two is given.
    about
        The camera, stream or link.
    what
        What was found and what is needed, with figures.
    remedy
        The line to type, or the key to change.
    text
        A short form for a pilot, sent as STATUSTEXT.
    over
        Text that reports the end of the problem.
    count
        Number of messages that were refused.
    """

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
    """The condition of the daemon, once a second.

    Attributes
    ----------
    uptime, round_trip
        Time since the start, and the round trip of TIMESYNC, s.
    clock_offset_ns
        Host clock minus boot clock.
    wall_step_ns
        Unix time minus host clock; 0 unless the wall clock has been set since the start.
    clock_rate
        Seconds of the boot clock in one second of the host's.
    states, reasons, causes
        State of each estimator, and why, for people and for programs.
    verdicts, rejected
        Counts of measurements by verdict, and of messages by reason.
    faults
        Present faults of our own vehicle.
    refusals
        Refused camera messages, signed frames and requests of others, the latest last.
    own_motion_sources
        How often each source of our own attitude and velocity was chosen (`[ownship] source`), by source and
        reason.
    beside, beside_ids
        Other autopilots that are heard, and their MAVLink system and component, as `1/1`.
    followed
        MAVLink system and component of the autopilot in use.
    senders
        Messages by system and component, of the first senders heard.
    needed
        Rate that each stream must have, Hz.
    cameras
        Cameras with images.
    consistency
        Consistency by estimator and source.
    advice
        Problems and their remedies, the worst first.
    """

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
