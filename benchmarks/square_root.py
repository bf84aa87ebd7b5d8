"""The square-root filter that flies (by triangularisation) beside the unscented one, on the radar problem."""

from collections.abc import Callable
from typing import Any, Final

import numpy as np

from benchmarks import radar
from onboard.arrays import Array
from onboard.filters import Belief, square_root, unscented
from onboard.models.radar import ANGULAR, measure

WEIGHTS: Final = unscented.julier_weights(radar.N, float(radar.N))  # the centre's zero, as a square root needs
RULE: Final = square_root.rule(WEIGHTS, radar.N, 3, ANGULAR)
UNSCENTED_RULE: Final = unscented.rule(WEIGHTS, radar.N, 3, ANGULAR)


def run(count: int | None = None) -> Callable[[int], object]:
    """A run of one square-root filter, or of a batch."""
    belief, measured = _inputs(count)
    start = square_root.start(*belief)

    def steps_of(steps: int) -> object:
        state = start
        for k in range(steps):
            state = square_root.predict(state, radar.process, radar.Q, WEIGHTS)
            y = measured[k % radar.STEPS]
            state = square_root.update(state, y, measure, radar.R, WEIGHTS, ANGULAR).belief
        return square_root.belief(state)

    return steps_of


def ours(steps: int) -> Belief:
    """The square-root filter, a step at a time."""
    belief: Any = square_root.start(*radar.START)
    for k in range(steps):
        y = radar.MEASURED[k % radar.STEPS]
        belief = square_root.step(belief, radar.process, radar.Q, y, measure, radar.R, RULE)
    return Belief(belief.mean, belief.covariance)


def unscented_ours(steps: int) -> Belief:
    """The same of the unscented filter, with the same points."""
    belief: Any = radar.START
    for k in range(steps):
        y = radar.MEASURED[k % radar.STEPS]
        belief = unscented.step(belief, radar.process, radar.Q, y, measure, radar.R, UNSCENTED_RULE)
    return Belief(belief.mean, belief.covariance)


def unscented_run(count: int | None = None) -> Callable[[int], object]:
    """The same of the unscented filter, with the same points."""
    start, measured = _inputs(count)

    def steps_of(steps: int) -> object:
        belief = start
        for k in range(steps):
            belief = unscented.predict(belief, radar.process, radar.Q, WEIGHTS)
            y = measured[k % radar.STEPS]
            belief = unscented.update(belief, y, measure, radar.R, WEIGHTS, ANGULAR).belief
        return belief

    return steps_of


def _inputs(count: int | None) -> tuple[Belief, Array]:
    if count is None:
        return radar.START, radar.MEASURED
    mean, P = radar.START
    return Belief(np.tile(mean, (count, 1)), np.tile(P, (count, 1, 1))), np.tile(
        radar.MEASURED[:, None], (1, count, 1)
    )
