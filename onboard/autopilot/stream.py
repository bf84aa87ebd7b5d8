"""How often one message is sent on one link; a ground station may change it."""

from typing import Final

from onboard.units import NS_PER_S

CLOSE_NS: Final = 1_000_000  # what comes on a grid of its own is due this near to its time
OFF_US: Final = -1  # us, of SET_MESSAGE_INTERVAL
DEFAULT: Final = 0


class Stream:
    """One message on one link. `interval_ns`: 0 if it is off. A `fixed` interval is not changed: others rely on
    it."""

    def __init__(self, rate_hz: float, *, fixed: bool = False) -> None:
        self._is_fixed = fixed
        self.interval_ns = self._default_ns = round(NS_PER_S / rate_hz)
        self._due_ns: int | None = None
        self._is_requested = False

    def is_due(self, t_ns: int) -> bool:
        """Whether to send it now, which the next due time then follows; also when time has gone back, as after a
        reboot."""
        if self.take_request():
            return True
        if self.interval_ns == 0:
            return False
        due = self._due_ns
        if due is not None and t_ns < due - CLOSE_NS and due - t_ns <= self.interval_ns:
            return False
        # counted from the due time, so that the rate holds on average; from now after a pause
        is_on_time = due is not None and 0 <= t_ns + CLOSE_NS - due < self.interval_ns
        self._due_ns = (due if is_on_time and due is not None else t_ns) + self.interval_ns
        return True

    def request(self) -> None:
        """Let one be sent at the next opportunity."""
        self._is_requested = True

    def take_request(self) -> bool:
        """Whether one was requested since the last call."""
        is_requested, self._is_requested = self._is_requested, False
        return is_requested

    def set_interval(self, interval_us: float, fastest_hz: float) -> bool:
        """Take the interval of a SET_MESSAGE_INTERVAL. False for one that is not finite, is too short, or may not
        be changed."""
        if self._is_fixed:
            return interval_us in {DEFAULT, self._default_ns // 1000}
        if interval_us == OFF_US:
            self.interval_ns = 0
        elif interval_us == DEFAULT:
            self.interval_ns = self._default_ns
        elif not 1e6 / fastest_hz <= interval_us < float(2**31):
            return False
        else:
            self.interval_ns = round(interval_us * 1000)
        self._due_ns = None
        return True

    @property
    def interval_us(self) -> int:
        """As MESSAGE_INTERVAL has it."""
        return self.interval_ns // 1000 or OFF_US
