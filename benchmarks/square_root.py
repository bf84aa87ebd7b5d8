"""The square-root filter (by triangularisation) and the unscented one on the radar problem."""

from collections.abc import Callable
from functools import partial
from typing import Any, Final

from benchmarks import radar
from onboard.filters import Belief, square_root, unscented
from onboard.models.radar import ANGULAR, measure

WEIGHTS: Final = unscented.julier_weights(radar.N, float(radar.N))  # the centre's zero, as a square root needs
RULE: Final = square_root.rule(WEIGHTS, radar.N, 3, ANGULAR)
UNSCENTED_RULE: Final = unscented.rule(WEIGHTS, radar.N, 3, ANGULAR)


def run(count: int | None = None) -> Callable[[int], object]:
    """Return a run of one square-root filter, or of a batch."""
    belief, measured = (radar.START, radar.MEASURED) if count is None else radar.tile_start(count)
    start = square_root.start(*belief)
    return lambda steps: square_root.belief(radar.in_two_calls(square_root, start, measured, WEIGHTS, steps))


def ours(steps: int) -> Belief:
    """Run the square-root filter, a step at a time."""
    belief: Any = square_root.start(*radar.START)
    for k in range(steps):
        y = radar.MEASURED[k % radar.STEPS]
        belief = square_root.step(belief, radar.process, radar.Q, y, measure, radar.R, RULE)
    return Belief(belief.mean, belief.covariance)


def unscented_ours(steps: int) -> Belief:
    """Run the unscented filter with the same points, a step at a time."""
    belief: Any = radar.START
    for k in range(steps):
        y = radar.MEASURED[k % radar.STEPS]
        belief = unscented.step(belief, radar.process, radar.Q, y, measure, radar.R, UNSCENTED_RULE)
    return Belief(belief.mean, belief.covariance)


def unscented_run(count: int | None = None) -> Callable[[int], object]:
    """Return a run of one unscented filter with the same points, or of a batch."""
    start, measured = (radar.START, radar.MEASURED) if count is None else radar.tile_start(count)
    return partial(radar.in_two_calls, unscented, start, measured, WEIGHTS)
