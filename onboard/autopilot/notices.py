"""Queue of STATUSTEXTs: few, the most important first, none repeated too soon."""

from enum import IntEnum
from typing import Final, NamedTuple

from onboard.messages import Advice, Clock, Estimate, Lifecycle, Severity, StatusText
from onboard.messages.causes import Cause
from onboard.messages.text import plain, without_numbers
from onboard.units import NS_PER_S

ERROR, WARNING, NOTICE, INFO = 3, 4, 5, 6  # MAV_SEVERITY
MAX_QUEUE_SIZE: Final = 5  # texts of one rank
NOTICE_PERIOD_NS: Final = NS_PER_S
REPEAT_PERIOD_NS: Final = 10 * NS_PER_S  # of the same text, or of texts from one sender
MAX_TEXT_LENGTH: Final = 200  # four chunks of STATUSTEXT


class Rank(IntEnum):
    """Priority of a text. Texts of a lower rank never displace those of a higher one."""

    LEADER = 0  # whether it is tracked
    OURS = 1  # our own state
    ADVICE = 2  # may be about what others send
    OTHERS = 3  # requests of others


Kind = tuple[Rank, str]


class _Text(NamedTuple):
    """A text in the queue. Its `repeat_key` is not sent again within REPEAT_PERIOD_NS."""

    severity: int
    text: str
    repeat_key: str


class Notices:
    """The queue, and the text of each kind that was sent last.

    A kind is a sender, advice of one cause about one thing, or a text without its numbers. The newest text of a
    kind replaces the one in the queue; a rank with too many texts drops its oldest."""

    def __init__(self) -> None:
        self.is_leading = False  # the vehicle brakes when the leader is lost
        self._waiting: dict[Kind, _Text] = {}  # the oldest first
        self._sent: dict[Kind, tuple[str, int]] = {}
        self._next_ns = 0
        self._was_valid = False

    def add(self, severity: int, text: str, rank: Rank = Rank.OURS, sender: str = "") -> None:
        """Queue a text. `sender`: who caused it."""
        text = plain(text, MAX_TEXT_LENGTH)
        self._enqueue((rank, sender or without_numbers(text)), _Text(severity, text, sender or text))

    def _enqueue(self, kind: Kind, text: _Text) -> None:
        self._waiting[kind], rank = text, kind[0]
        if len(alike := [kind for kind in self._waiting if kind[0] is rank]) > MAX_QUEUE_SIZE:
            del self._waiting[alike[0]]

    def advise(self, advice: Advice) -> None:
        """Queue advice, except for notices, which only the ground needs."""
        if advice.severity is not Severity.NOTICE:
            severity, text = (
                WARNING if advice.severity is Severity.ERROR else NOTICE,
                plain(advice.text, MAX_TEXT_LENGTH),
            )
            self._enqueue((Rank.ADVICE, f"{advice.kind} {advice.about}"), _Text(severity, text, text))

    def report_leader(self, estimate: Estimate) -> None:
        """Queue a text when the leader is first tracked, or is lost."""
        if estimate.name != "leader" or not estimate.is_primary:
            return
        if estimate.valid != self._was_valid:
            severity, text = INFO, "leader tracked"
            if not estimate.valid:
                lost = "leader lost" if estimate.state is Lifecycle.LOST else "no leader"
                brakes = self.is_leading and estimate.cause is not Cause.UNEXPECTED  # guidance still follows it
                severity, text = WARNING, f"{lost}: braking" if brakes else lost
            self._waiting[Rank.LEADER, ""] = _Text(severity, text, text)
        self._was_valid = estimate.valid

    def due(self, now_ns: int) -> list[StatusText]:
        """Return the text to send now, if any."""
        if now_ns < self._next_ns:
            return []
        self._sent = {kind: sent for kind, sent in self._sent.items() if now_ns - sent[1] < REPEAT_PERIOD_NS}
        while self._waiting:
            kind = min(self._waiting, key=lambda kind: kind[0])
            severity, text, repeat_key = self._waiting.pop(kind)
            if kind in self._sent and self._sent[kind][0] == repeat_key:
                continue
            self._sent[kind] = repeat_key, now_ns
            self._next_ns = now_ns + NOTICE_PERIOD_NS
            return [StatusText(t_ns=now_ns, t_recv_ns=now_ns, clock=Clock.HOST, severity=severity, text=text)]
        return []
