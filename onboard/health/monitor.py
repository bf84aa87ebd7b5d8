"""Counts of the pipeline for the health.

These are streams and their rates, verdicts, rejections, states, faults, and exceptions, which cost one message
each."""

import traceback
from collections import Counter, deque
from collections.abc import Iterable, Mapping
from typing import Final

from onboard.health.cameras import Cameras, Hints
from onboard.health.consistency import Consistencies
from onboard.health.refusals import Refusals
from onboard.messages import Estimate, Exposure, Fault, Heartbeat, Lifecycle, Message, NavState, StreamHealth
from onboard.messages.causes import Cause, Reason
from onboard.messages.mavlink_enums import AUTOPILOT_NAMES
from onboard.units import NS_PER_S, S_PER_NS

RATE_WINDOW_NS: Final = 2 * NS_PER_S
MAX_SENDER_COUNT: Final = 32
MAX_ERROR_COUNT: Final = 100  # kinds of exceptions that are described; all are counted


class Exceptions:
    """Exceptions of single messages."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()  # by place
        self.lines: list[str] = []  # a description of the first of each kind
        self._kinds: set[tuple[str, str]] = set()

    def count(self, place: str, error: Exception) -> None:
        """Count an exception that was caught; `place` is the message's name, or the part that failed."""
        self.counts[f"error.{place}"] += 1
        kind = place, type(error).__name__
        if kind in self._kinds or len(self._kinds) >= MAX_ERROR_COUNT:
            return
        self._kinds.add(kind)
        frame = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{frame.filename.rsplit('/', 1)[-1]}:{frame.lineno}"
        self.lines.append(f"error in {place}, which cost one message: {kind[1]}: {error} ({where})")


class Monitor:
    """Counts what comes in and what is published. It decides nothing; the pipeline works the same without it.

    `own_verdicts` names the estimators that count their verdicts themselves (`estimators.CountsVerdicts`);
    `takes_ranges`: ranges of detections are used.
    """

    def __init__(self, own_verdicts: Iterable[str], *, takes_ranges: bool) -> None:
        self.errors = Exceptions()
        self.refusals = Refusals()
        self._hints = Hints(self.refusals.add, takes_ranges=takes_ranges)
        self.rejected: Counter[str] = Counter()
        self.verdicts: Counter[str] = Counter()
        self.states: dict[str, Lifecycle] = {}
        self.reasons: dict[str, Reason] = {}
        self.faults: tuple[Fault, ...] = ()
        self._senders: dict[tuple[int, int], int] = {}  # messages by MAVLink system and component
        self.cameras, self.consistencies = Cameras(), Consistencies()
        self._own_verdicts = frozenset(own_verdicts)
        self._streams: dict[type[Message], _Stream] = {}

    def hear(self, message: Message) -> None:
        """Count a message of any sender."""
        sender = message.system, message.component
        if sender in self._senders:
            self._senders[sender] += 1
        elif message.system and len(self._senders) < MAX_SENDER_COUNT:
            self._senders[sender] = 1

    @property
    def senders(self) -> dict[str, int]:
        """The messages of each sender, by MAVLink system and component as `1/1`."""
        return {f"{system}/{component}": count for (system, component), count in self._senders.items()}

    def reject(self, message: Message, counted: str | Reason) -> None:
        """Count a message that goes no further."""
        self.rejected[counted.cause if isinstance(counted, Reason) else counted] += 1
        self.refusals.add_message(message, counted)

    def receive(self, message: Message) -> None:
        """Count a message of our own vehicle, or of one that an estimator listens to."""
        if isinstance(message, Exposure):
            for detection in message.detections:
                self._hints.see(detection)
        stream = self._streams.get(type(message))
        if stream is None:
            stream = self._streams[type(message)] = _Stream()
        stream.add(message.t_recv_ns)

    def publish(self, estimate: Estimate) -> None:
        """Note an estimate's state, verdict and faults."""
        key = estimate.name if estimate.is_primary else f"{estimate.name}.{estimate.target}"
        self.states[key], self.reasons[key] = estimate.state, Reason(estimate.cause, estimate.reason)
        if estimate.state is Lifecycle.SEARCHING and not estimate.is_primary:
            # the last estimate of one of many, of which a flight may have any number
            del self.states[key], self.reasons[key]
        if estimate.measurement is not None:
            if estimate.cause is not Cause.NO_POSITION:  # no camera is to blame while the autopilot aligns
                self.refusals.add_verdict(estimate, estimate.measurement)
            self.consistencies.add(estimate, estimate.measurement)
        if estimate.measurement is not None and estimate.name not in self._own_verdicts:
            self.verdicts[f"{estimate.name}.{estimate.measurement.verdict}"] += 1
        if isinstance(estimate, NavState):
            self.faults = estimate.faults

    def streams(self, t_recv_ns: int) -> dict[str, StreamHealth]:
        """Return the count, rate and age of each kind of message at a time."""
        return {kind.__name__: stream.health(t_recv_ns) for kind, stream in self._streams.items()}


class _Stream:
    """Messages of one kind: their number, and the arrivals within the window."""

    def __init__(self) -> None:
        self._count = 0
        self._window: deque[int] = deque()

    def add(self, t_recv_ns: int) -> None:
        """One more."""
        self._count += 1
        window = self._window
        window.append(t_recv_ns)
        while not 0 <= t_recv_ns - window[0] <= RATE_WINDOW_NS:  # < 0: this computer's clock was set back
            window.popleft()

    def health(self, t_recv_ns: int) -> StreamHealth:
        """Return the stream's health at a time."""
        window = self._window
        while len(window) > 1 and t_recv_ns - window[0] > RATE_WINDOW_NS:
            window.popleft()
        age_ns = t_recv_ns - window[-1]
        recent = len(window) if age_ns <= RATE_WINDOW_NS else 0
        return StreamHealth(count=self._count, rate=recent / (RATE_WINDOW_NS * S_PER_NS), age=age_ns * S_PER_NS)


def total(counts: Iterable[Mapping[str, int]]) -> dict[str, int]:
    """The sum of counts by their keys, in the order in which they appear."""
    summed: Counter[str] = Counter()
    for each in counts:
        summed.update(each)
    return dict(summed)


def sender_of(autopilot: Heartbeat | None) -> str:
    """An autopilot's MAVLink system and component, as `1/1`; "" before it is heard."""
    return "" if autopilot is None else f"{autopilot.system}/{autopilot.component}"


def autopilot_name(autopilot: Heartbeat | None) -> str:
    """Which autopilot this is, and its MAVLink system; "none" before it is heard."""
    if autopilot is None:
        return "none"
    kind = AUTOPILOT_NAMES.get(autopilot.autopilot, f"MAV_AUTOPILOT {autopilot.autopilot}")
    return f"{kind}, system {autopilot.system}"
