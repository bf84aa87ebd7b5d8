"""STATUSTEXT: what a pilot must know, seldom."""

from collections import deque
from typing import Final

from onboard.geometry.units import NS_PER_S
from onboard.messages import Advice, Clock, Estimate, Lifecycle, Severity, StatusText

ERROR, WARNING, NOTICE, INFO = 3, 4, 5, 6  # MAV_SEVERITY
MOST_WAITING: Final = 5
PERIOD_NS: Final = NS_PER_S  # between two texts
AGAIN_NS: Final = 10 * NS_PER_S  # before the same text is sent again
LENGTH: Final = 200  # of a text: four STATUSTEXTs


class Notices:
    """Texts that wait, of which the oldest give way, and when each was sent last. `follows`: an autopilot may
    follow what is sent of the leader."""

    def __init__(self, *, follows: bool = False) -> None:
        self._follows = follows
        self._waiting: deque[tuple[int, str]] = deque(maxlen=MOST_WAITING)
        self._sent: dict[str, int] = {}
        self._next_ns = 0
        self._was_valid = False

    def add(self, severity: int, text: str) -> None:
        """Let a text be sent."""
        entry = severity, text[:LENGTH]
        if entry not in self._waiting:
            self._waiting.append(entry)

    def advise(self, advice: Advice) -> None:
        """Let advice be sent; a mere notice is for those on the ground."""
        if advice.severity is not Severity.NOTICE:
            self.add(WARNING if advice.severity is Severity.ERROR else NOTICE, advice.text)

    def note(self, estimate: Estimate) -> None:
        """Whether the leader is tracked, when that changes."""
        if estimate.name != "leader" or not estimate.is_primary:
            return
        if estimate.valid != self._was_valid:
            if estimate.valid:
                self.add(INFO, "leader tracked")
            else:
                lost = "leader lost" if estimate.state is Lifecycle.LOST else "no leader"
                self.add(WARNING, f"{lost}: FOLLOW brakes within 3 s" if self._follows else lost)
        self._was_valid = estimate.valid

    def due(self, now_ns: int) -> list[StatusText]:
        """The text to send now, if any."""
        if now_ns < self._next_ns:
            return []
        self._sent = {text: t for text, t in self._sent.items() if now_ns - t < AGAIN_NS}
        while self._waiting:
            severity, text = self._waiting.popleft()
            if text in self._sent:
                continue
            self._sent[text] = now_ns
            self._next_ns = now_ns + PERIOD_NS
            return [StatusText(t_ns=now_ns, t_recv_ns=now_ns, clock=Clock.HOST, severity=severity, text=text)]
        return []
