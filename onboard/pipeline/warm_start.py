"""State of an earlier run, kept until the autopilot's first stamp shows whether it still holds."""

from collections.abc import Callable
from typing import Final

from onboard.clocks import Clocks
from onboard.messages import WarmState
from onboard.messages.causes import Cause, Reason

SOURCE: Final = "warm_state"
MAX_OFFSET_DIFFERENCE_NS: Final = (
    500_000_000  # between two offsets of one boot clock, the new one known by one arrival
)
REBOOTED: Final = Reason(
    Cause.WARM_STATE, "the autopilot has rebooted since, or its clock runs at another rate than this computer's"
)


class WarmStart:
    """At most one state, used or refused at the first stamp. `refuse` takes source, reason and arrival."""

    def __init__(self, refuse: Callable[[str, Reason, int], None]) -> None:
        self._refuse = refuse
        self.waits: WarmState | None = None  # for the first stamp

    def receive(self, state: WarmState) -> None:
        """Keep a state that was read at the start."""
        self.waits = state

    def confirmed(self, clocks: Clocks, offset_ns: int | None, t_recv_ns: int) -> WarmState | None:
        """The state, once, if the boot clock runs on as it did; the clocks then go on with what was learnt.
        `offset_ns`: host clock minus boot clock."""
        state = self.waits
        if state is None or offset_ns is None:
            return None
        self.waits = None
        if abs(offset_ns - state.offset_ns) > MAX_OFFSET_DIFFERENCE_NS:
            self._refuse(SOURCE, REBOOTED, t_recv_ns)
            return None
        if state.round_trip_ns is not None:
            clocks.resume(state.round_trip_ns, state.wall_ns, state.offset_ns)
        return state
