"""Steps of a Gaussian filter with an angle too wide for sigma points, for `runs.run`.

The angle is uniform, with the belief's variance, over at most one turn; the other states move with it by their
correlation. The model becomes its mean tangent over the angle, and the deviation from it is noise. The deviation
of a process adds to the state's earlier one, since the next step has the same unknown angle.
"""

from itertools import product
from typing import Any, Final

import numpy as np

from onboard.arrays import Array
from onboard.filters import extended, kalman
from onboard.filters.angles import beside
from onboard.filters.belief import Belief, Indices, Method, Rows, Update, start
from onboard.filters.errors import MAX_ANGLE_SPREAD

MAX_NARROW_SIGMA: Final = MAX_ANGLE_SPREAD / 8  # rad; points beyond MAX_ANGLE_SPREAD are rare, even in an ensemble
UNIFORM_ANGLE_SIGMA: Final = np.pi / np.sqrt(3)  # rad; standard deviation of a completely unknown angle
ANGLE_COUNT: Final = 16  # number of values over the width of an angle


def is_wide(belief: Belief, angular_states: Indices) -> bool:
    """Return whether a belief (n,) has a wide angle."""
    return bool(_wide(belief, angular_states))


def predict(belief: Belief, process: Rows, Q: Array, angular_states: Indices = ()) -> Belief:
    """Time update; `angular_states` as in `angles`.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    """
    F, mean, rest = transition(belief, process, angular_states)
    P = F @ belief.covariance @ F.T + Q + rest
    return Belief(mean, 0.5 * (P + P.T))


def transition(belief: Belief, process: Rows, angular_states: Indices) -> tuple[Array, Array, Array]:
    """Return the process as a line: its slope, its value at the mean, and the added noise.

    They are (n, n), (n,) and (n, n). An angle that would be wider than a turn is drawn from a whole turn, and does
    not depend on the one before.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    """
    F, mean, rest = _line(belief, process, angular_states, None, angular_states)
    variance, off = np.diagonal(F @ belief.covariance @ F.T).copy(), np.diagonal(rest)
    noise = off + 2 * np.sqrt(variance * off)
    for i in angular_states:
        if variance[i] + noise[i] > UNIFORM_ANGLE_SIGMA**2:
            F[i], noise[i] = 0, UNIFORM_ANGLE_SIGMA**2
    return F, mean, np.diag(noise)


def update(
    belief: Belief, y: Array, measure: Rows, R: Array, angular: Indices = (), angular_states: Indices = ()
) -> Update:
    """Measurement update; parameters as in `unscented.update`.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    NotPositiveDefiniteError
        If a covariance is not positive definite, or not finite.
    """
    H, predicted, rest = _line(belief, measure, angular_states, y, angular)
    return kalman.correct(belief, y, predicted, H, R + rest, (), angular)


def _wide(belief: Belief, angular_states: Indices) -> list[int]:
    return [i for i in angular_states if belief.covariance[i, i] > MAX_NARROW_SIGMA**2]


def _line(
    belief: Belief, model: Rows, angular_states: Indices, y: Array | None, angular: Indices
) -> tuple[Array, Array, Array]:
    """Return the model's mean tangent over the wide angles.

    That is its slope, its value at the mean, and the covariance of the deviation from it.
    """
    mean, P = belief
    angles = _wide(belief, angular_states)
    widths = np.minimum(np.sqrt(P[angles, angles]), UNIFORM_ANGLE_SIGMA) * np.sqrt(3)
    evenly = (2 * np.arange(ANGLE_COUNT) + 1) / ANGLE_COUNT - 1
    off = np.array([*product(evenly, repeat=len(angles))]) * widths
    moved = off @ np.linalg.solve(P[np.ix_(angles, angles)], P[angles])
    points = np.concatenate([mean[None], mean + moved])
    each = Belief(points, np.broadcast_to(P, (len(points), *P.shape)).copy())
    values, slopes = extended.tangent(
        each, model, None, None if y is None else np.tile(y, (len(points), 1)), angular
    )
    slope = slopes[1:].mean(axis=0)
    rest = values[1:] - values[0] - moved @ slope.T
    rest = beside(rest, np.zeros_like(rest), angular)
    shift = rest.mean(axis=0)
    return slope, values[0] + shift, (rest - shift).T @ (rest - shift) / len(rest)


def _identity(belief: Any) -> Any:
    return belief


METHOD: Final = Method("turns", start, predict, update, _identity)
