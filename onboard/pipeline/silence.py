"""The last word on each target: it must not stay valid when nothing arrives any more."""

from collections.abc import Callable
from typing import Final

from msgspec.structs import replace

from onboard.messages import Estimate, Lifecycle, invalidate
from onboard.messages.causes import Cause, Reason
from onboard.units import NS_PER_S

# If no message of our own motion arrives for this long, estimates are invalid: they can no longer be predicted.
TIMEOUT_NS: Final = NS_PER_S
WITHDRAWN: Final = Reason(Cause.SILENT, "withdrawn: nothing usable of our own motion arrives")
HELD_UP: Final = Reason(Cause.HELD_UP, "the autopilot's messages are held up on their way")
BEHIND: Final = Reason(Cause.BEHIND, "this program is late: what it reads has waited in it")


class LastWords:
    """The newest valid estimate of each target."""

    def __init__(self) -> None:
        self._valid: dict[tuple[str, str], Estimate] = {}

    def note(self, estimate: Estimate) -> None:
        """Remember what has been published."""
        if estimate.valid:
            self._valid[estimate.name, estimate.target] = estimate
        else:
            self._valid.pop((estimate.name, estimate.target), None)

    def withdraw(self, is_silent: Callable[[Estimate], bool]) -> list[Estimate]:
        """The same estimates, not valid, where nothing can follow; each once."""
        silent = [e for e in self._valid.values() if is_silent(e)]
        for estimate in silent:
            del self._valid[estimate.name, estimate.target]
        return [_withdrawn(e) for e in silent]


def _withdrawn(estimate: Estimate) -> Estimate:
    return replace(
        invalidate(estimate, WITHDRAWN),
        sequence=estimate.sequence + 1,
        state=Lifecycle.LOST,
        state_since_ns=estimate.t_ns,
        measurement=None,
    )
