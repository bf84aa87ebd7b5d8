"""STATUSTEXT: what a pilot must know, seldom."""

from enum import IntEnum
from typing import Final, NamedTuple

from onboard.messages import Advice, Clock, Estimate, Lifecycle, Severity, StatusText
from onboard.messages.causes import Cause
from onboard.messages.text import plain, without_numbers
from onboard.units import NS_PER_S

ERROR, WARNING, NOTICE, INFO = 3, 4, 5, 6  # MAV_SEVERITY
MOST_WAITING: Final = 5  # of one rank
NOTICE_PERIOD_NS: Final = NS_PER_S  # between two texts
REPEATED_AFTER_NS: Final = 10 * NS_PER_S  # before the same text is sent again, or the next of one sender
LENGTH: Final = 200  # of a text: four STATUSTEXTs


class Rank(IntEnum):
    """Which texts go first, and never give way to those behind: whether the leader is tracked, what else concerns
    our own state, advice, which may be about what others send, and what others ask for."""

    LEADER, OURS, ADVICE, OTHERS = range(4)


Kind = tuple[Rank, str]


class _Text(NamedTuple):
    """A text that waits. `same`: another of its kind with the same one is not sent for `AGAIN_NS`."""

    severity: int
    text: str
    same: str


class Notices:
    """Texts that wait, and what was sent last of each kind. Of one kind, which is a sender, advice of one cause
    about one thing, or a text without its numbers, the newest waits in the place of the first; of one rank, the
    oldest gives way. `is_leading`: the vehicle is led, and brakes when the leader is lost."""

    def __init__(self) -> None:
        self.is_leading = False
        self._waiting: dict[Kind, _Text] = {}  # the oldest first
        self._sent: dict[Kind, tuple[str, int]] = {}
        self._next_ns = 0
        self._was_valid = False

    def add(self, severity: int, text: str, rank: Rank = Rank.OURS, sender: str = "") -> None:
        """Let a text be sent. `sender`: who is the reason of it."""
        text = plain(text, LENGTH)
        self._wait((rank, sender or without_numbers(text)), _Text(severity, text, sender or text))

    def _wait(self, kind: Kind, text: _Text) -> None:
        self._waiting[kind], rank = text, kind[0]
        if len(alike := [kind for kind in self._waiting if kind[0] is rank]) > MOST_WAITING:
            del self._waiting[alike[0]]

    def advise(self, advice: Advice) -> None:
        """Let advice be sent; a mere notice is for those on the ground."""
        if advice.severity is not Severity.NOTICE:
            severity, text = WARNING if advice.severity is Severity.ERROR else NOTICE, plain(advice.text, LENGTH)
            self._wait((Rank.ADVICE, f"{advice.kind} {advice.about}"), _Text(severity, text, text))

    def note(self, estimate: Estimate) -> None:
        """Whether the leader is tracked, when that changes."""
        if estimate.name != "leader" or not estimate.is_primary:
            return
        if estimate.valid != self._was_valid:
            severity, text = INFO, "leader tracked"
            if not estimate.valid:
                lost = "leader lost" if estimate.state is Lifecycle.LOST else "no leader"
                brakes = self.is_leading and estimate.cause is not Cause.UNEXPECTED  # which is followed still
                severity, text = WARNING, f"{lost}: braking" if brakes else lost
            self._waiting[Rank.LEADER, ""] = _Text(severity, text, text)
        self._was_valid = estimate.valid

    def due(self, now_ns: int) -> list[StatusText]:
        """The text to send now, if any."""
        if now_ns < self._next_ns:
            return []
        self._sent = {kind: sent for kind, sent in self._sent.items() if now_ns - sent[1] < REPEATED_AFTER_NS}
        while self._waiting:
            kind = min(self._waiting, key=lambda kind: kind[0])
            severity, text, same = self._waiting.pop(kind)
            if kind in self._sent and self._sent[kind][0] == same:
                continue
            self._sent[kind] = same, now_ns
            self._next_ns = now_ns + NOTICE_PERIOD_NS
            return [StatusText(t_ns=now_ns, t_recv_ns=now_ns, clock=Clock.HOST, severity=severity, text=text)]
        return []
