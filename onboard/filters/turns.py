"""A Gaussian filter's step with an angle so wide that sigma points no longer show it: `runs.run` takes it there.

The angle is uniform, of the belief's variance, over one turn at most; the other states move with it as they
correlate. The model becomes its mean tangent over the angle. What it deviates from that is noise. A process's adds
to what the state was already off by, since the next step has the same unknown angle.
"""

from itertools import product
from typing import Any, Final

import numpy as np

from onboard.arrays import Array
from onboard.filters import extended, kalman
from onboard.filters.angles import beside
from onboard.filters.belief import Belief, Indices, Method, Rows, Update, start
from onboard.filters.errors import FARTHEST

WIDE: Final = FARTHEST / 8  # rad, one sigma: a point that is farther out than this is rare, even of an ensemble
UNKNOWN: Final = np.pi / np.sqrt(3)  # rad, one sigma of an angle of which nothing is known
COUNT: Final = 16  # values of an angle over its width


def is_wide(belief: Belief, angular_states: Indices) -> bool:
    """Whether a belief (n,) has an angle that is wide."""
    return bool(_wide(belief, angular_states))


def predict(belief: Belief, process: Rows, Q: Array, angular_states: Indices = ()) -> Belief:
    """Time update; `angular_states` as in `angles`.

    Raises FilterError.
    """
    F, mean, rest = transition(belief, process, angular_states)
    P = F @ belief.covariance @ F.T + Q + rest
    return Belief(mean, 0.5 * (P + P.T))


def transition(belief: Belief, process: Rows, angular_states: Indices) -> tuple[Array, Array, Array]:
    """The process as a line: its slope (n, n), its value at the mean (n,), and the noise (n, n) that it adds. An
    angle that would be wider than a turn is drawn anew, from a turn, and does not depend on the one before.

    Raises FilterError.
    """
    F, mean, rest = _line(belief, process, angular_states, None, angular_states)
    variance, off = np.diagonal(F @ belief.covariance @ F.T).copy(), np.diagonal(rest)
    noise = off + 2 * np.sqrt(variance * off)
    for i in angular_states:
        if variance[i] + noise[i] > UNKNOWN**2:
            F[i], noise[i] = 0, UNKNOWN**2
    return F, mean, np.diag(noise)


def update(
    belief: Belief, y: Array, measure: Rows, R: Array, angular: Indices = (), angular_states: Indices = ()
) -> Update:
    """Measurement update; arguments as in `unscented.update`.

    Raises FilterError, NotPositiveDefiniteError.
    """
    H, predicted, rest = _line(belief, measure, angular_states, y, angular)
    return kalman.correct(belief, y, predicted, H, R + rest, (), angular)


def _wide(belief: Belief, angular_states: Indices) -> list[int]:
    return [i for i in angular_states if belief.covariance[i, i] > WIDE**2]


def _line(
    belief: Belief, model: Rows, angular_states: Indices, y: Array | None, angular: Indices
) -> tuple[Array, Array, Array]:
    """The model's mean tangent over the wide angles: its slope, its value at the mean, and the covariance of what
    it deviates by."""
    mean, P = belief
    angles = _wide(belief, angular_states)
    widths = np.minimum(np.sqrt(P[angles, angles]), UNKNOWN) * np.sqrt(3)
    evenly = (2 * np.arange(COUNT) + 1) / COUNT - 1
    off = np.array([*product(evenly, repeat=len(angles))], P.dtype) * widths.astype(P.dtype)
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
