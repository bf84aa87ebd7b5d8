"""The rate of one message on one link, which a ground station may change."""

from typing import Final

from onboard.units import NS_PER_S

DUE_TOLERANCE_NS: Final = 1_000_000  # a caller with its own time grid may be early by this much
OFF_INTERVAL_US: Final = -1  # MAV_CMD_SET_MESSAGE_INTERVAL; 0 restores the default


class Stream:
    """One message on one link. A `fixed` interval cannot be changed, since others rely on it."""

    def __init__(self, rate_hz: float, *, fixed: bool = False) -> None:
        self._is_fixed = fixed
        self.interval_ns = self._default_ns = round(NS_PER_S / rate_hz)  # 0: off
        self._due_ns: int | None = None
        self._is_requested = False

    def is_due(self, t_ns: int) -> bool:
        """Whether to send a message now, and set the next due time if so.

        It is due also when time has gone back, as after a reboot."""
        if self.take_request():
            return True
        if self.interval_ns == 0:
            return False
        due = self._due_ns
        if due is not None and t_ns < due - DUE_TOLERANCE_NS and due - t_ns <= self.interval_ns:
            return False
        # counted from the due time, so that the rate holds on average; from now after a pause
        is_on_time = due is not None and 0 <= t_ns + DUE_TOLERANCE_NS - due < self.interval_ns
        self._due_ns = (due if is_on_time and due is not None else t_ns) + self.interval_ns
        return True

    def request(self) -> None:
        """Make a message due at the next opportunity."""
        self._is_requested = True

    def take_request(self) -> bool:
        """Whether a message was requested since the last call."""
        is_requested, self._is_requested = self._is_requested, False
        return is_requested

    def set_interval(self, interval_us: float, max_rate_hz: float) -> bool:
        """Apply SET_MESSAGE_INTERVAL. Returns False if it is not finite, too short, or fixed."""
        if self._is_fixed:
            return interval_us in {0, self._default_ns // 1000}
        if interval_us == OFF_INTERVAL_US:
            self.interval_ns = 0
        elif interval_us == 0:
            self.interval_ns = self._default_ns
        elif not 1e6 / max_rate_hz <= interval_us < float(2**31):
            return False
        else:
            self.interval_ns = round(interval_us * 1000)
        self._due_ns = None
        return True

    @property
    def interval_us(self) -> int:
        """The interval that MESSAGE_INTERVAL reports; -1 if it is off."""
        return self.interval_ns // 1000 or OFF_INTERVAL_US
