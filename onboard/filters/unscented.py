"""The unscented Kalman filter, generic over models: Oh & Johnson eqs 19-42 (after Julier, and van der Merwe).

    points = spread(belief)            # (2n+1, n)
    points = process(points)           # (2n+1, n) -> (2n+1, n): the model, any function over rows
    belief = gather(points) + Q

Arrays are float64 or float32, all alike. With a leading batch axis B on mean and covariance (and on y), B filters
advance in one call; the model then gets the rows of all of them, (B (2n+1), n), each filter's together.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import Any, Final, NamedTuple

import numpy as np

from onboard.filters import _kernels_points as kernels
from onboard.filters.belief import (
    Belief,
    FilterError,
    Method,
    NotPositiveDefiniteError,
    Rows,
    Update,
    refuse,
    start,
)
from onboard.geometry.rotations import Array


class Weights(NamedTuple):
    """A symmetric sigma-point set: `spread` is gamma, the distance in standard deviations; the centre's weight in
    the mean and in the covariance; and the weight of each of the 2n others."""

    spread: float
    mean: float
    covariance: float
    other: float


def julier_weights(n: int, n_plus_lambda: float = 3.0) -> Weights:
    """Weights with n + lambda given (eqs 23-25): 3 matches the fourth moment of a Gaussian; for n > 3 the centre
    weight is then negative."""
    if not n_plus_lambda > 0:
        raise FilterError("n_plus_lambda: must be positive")
    centre = 1.0 - n / n_plus_lambda
    return Weights(float(np.sqrt(n_plus_lambda)), centre, centre, 0.5 / n_plus_lambda)


def scaled_weights(n: int, alpha: float = 1e-3, beta: float = 2.0, kappa: float = 0.0) -> Weights:
    """Van der Merwe's scaled weights: lambda = alpha^2 (n + kappa) - n; beta = 2 suits a Gaussian."""
    if not (alpha > 0 and n + kappa > 0):
        raise FilterError("alpha and n + kappa: must be positive")
    total = alpha * alpha * (n + kappa)
    centre = 1.0 - n / total
    return Weights(float(np.sqrt(total)), centre, centre + 1.0 - alpha * alpha + beta, 0.5 / total)


class Rule(NamedTuple):
    """What stays the same from step to step, made ready by `rule`: weights, also as an array; the marks of angular
    components and of considered states; and the array that a step fills, by its shape and precision."""

    weights: Weights
    numbers: Array
    marks: Array
    room: tuple[int, int]
    dtype: Any


class Drawn(NamedTuple):
    """What `step` gives: a belief, with the sigma points (2n+1, n) of the next one drawn by `rule`. Read-only.

    `room` (3n+1, n) holds the points, the first of which is the mean, and the covariance.
    """

    points: Array
    room: Array
    nis: float
    rule: Rule

    @property
    def mean(self) -> Array:
        """Mean (n,)."""
        mean: Array = self.points[0]
        return mean

    @property
    def covariance(self) -> Array:
        """Covariance (n, n)."""
        covariance = self.room[len(self.points) :]
        covariance.setflags(write=False)
        return covariance


def rule(
    weights: Weights,
    n: int,
    m: int,
    angular: tuple[int, ...] = (),
    considered: tuple[int, ...] = (),
    dtype: Any = np.float64,
) -> Rule:
    """For `step` of n states and m measured components: weights, and the last arguments of `update`.

    Raises FilterError.
    """
    try:
        marks = np.concatenate([flags(angular, m), flags(considered, n)])
    except IndexError as error:
        raise FilterError(f"angular {angular}, considered {considered}: must be below {m} and {n}") from error
    return Rule(weights, np.array(weights, dtype), marks, (3 * n + 1, n), np.dtype(dtype))


@lru_cache(maxsize=256)
def flags(chosen: tuple[int, ...], size: int) -> Any:
    """A mask (size,) with the chosen components set."""
    mask = np.zeros(size, bool)
    mask[list(chosen)] = True
    mask.flags.writeable = False  # cached, so shared
    return mask


def factor(covariance: Array) -> Array:
    """Lower Cholesky factor (n, n) of a covariance.

    Raises NotPositiveDefiniteError, for NaN and infinity too (LAPACK lets those pass).
    """
    try:
        upper, exists = kernels.factor(covariance)
    except TypeError as error:
        raise wrong_arrays(covariance=covariance) from error
    if not exists:
        raise NotPositiveDefiniteError("covariance: not positive definite")
    return upper.T  # type: ignore[no-any-return]  # Numba's functions are not typed


def sigma_points(belief: Belief | Drawn, weights: Weights) -> Array:
    """Sigma points (..., 2n+1, n), the mean first (eqs 29-30).

    Raises FilterError, NotPositiveDefiniteError.
    """
    mean, covariance = belief.mean, belief.covariance
    try:
        if mean.ndim == 1:
            n = len(mean)
            points = np.empty((2 * n + 1, n), mean.dtype)
            status = kernels.spread(mean, covariance, weights.spread, points)
        else:
            points, status = kernels.spread_batch(_packed(mean), _packed(covariance), weights.spread)
    except (TypeError, AttributeError) as error:
        raise wrong_arrays(mean=mean, covariance=covariance) from error
    if status:
        refuse(status)
    return points


def recombine(points: Array, weights: Weights, noise: Array) -> Belief:
    """Weighted mean and covariance of points (..., 2n+1, n), plus noise (n, n) (eqs 32-33).

    Raises FilterError.
    """
    _, w_mean, w_cov, w = weights
    try:
        if points.ndim == 2:
            n = points.shape[1]
            out = np.empty((n + 1, n), points.dtype)
            mean, covariance = out[0], out[1:]
            status = kernels.gather(points, w_mean, w_cov, w, noise, out)
        else:
            mean, covariance, status = kernels.gather_batch(_packed(points), w_mean, w_cov, w, _batched(noise))
    except (TypeError, AttributeError) as error:
        raise wrong_arrays(process=points, Q=noise) from error
    if status:
        refuse(status)
    return Belief(mean, covariance)


def predict(belief: Belief, process: Rows, Q: Array, weights: Weights) -> Belief:
    """Time update (eqs 29-33). `process` maps rows (k, n) -> (k, n); `Q` (n, n) is that of the whole step.

    Raises FilterError, NotPositiveDefiniteError.
    """
    return recombine(over_rows(process, sigma_points(belief, weights)), weights, Q)


def update(
    belief: Belief,
    y: Array,
    measure: Rows,
    R: Array,
    weights: Weights,
    angular: tuple[int, ...] = (),
    considered: tuple[int, ...] = (),
) -> Update:
    """Measurement update (eqs 34-42). `measure` maps rows (k, n) -> (k, m); `angular` are the components of y that
    are angles, whose differences wrap. States in `considered` keep their mean and variance: their uncertainty is
    carried in the others' covariance, but no measurement moves them (Schmidt 1966).

    Raises FilterError, NotPositiveDefiniteError for the prior and for an innovation covariance without factor.
    """
    points = sigma_points(belief, weights)
    images = over_rows(measure, points)
    return correct(belief, points, images, y, R, weights, angular, considered)


def correct(
    belief: Belief,
    points: Array,
    images: Array,
    y: Array,
    R: Array,
    weights: Weights,
    angular: tuple[int, ...],
    considered: tuple[int, ...],
) -> Update:
    """The second half of `update`: from sigma points (..., 2n+1, n) and their images (..., 2n+1, m)."""
    if points.ndim == 2:
        return _correct(points, images, belief.covariance, y, R, weights, angular, considered)
    try:
        marks = flags(angular, y.shape[-1]), flags(considered, points.shape[-1])
        given = _packed(points), _packed(images), _packed(belief.covariance), _packed(y), _batched(R)
        *posterior, innovation, S, predicted, nis, status = kernels.correct_batch(*given, *weights[2:], *marks)
    except (TypeError, AttributeError, IndexError) as error:
        raise wrong_arrays(mean=belief.mean, measure=images, y=y, R=R) from error
    if status:
        refuse(status)
    return Update(Belief(*posterior), innovation, S, predicted, nis)


def step(belief: Belief | Drawn, process: Rows, Q: Array, y: Array, measure: Rows, R: Array, rule: Rule) -> Drawn:
    """`predict`, and `update` of what it gave, in one call: the same belief and NIS in half the time, for those
    who need no more of the update. What it gives goes into the next step. Arguments as theirs, of one filter. The
    rows that `measure` is given are written over when it has returned.

    Raises FilterError, NotPositiveDefiniteError (for the posterior, too).
    """
    if type(belief) is Drawn and belief.rule is rule:
        points = belief.points
    else:
        points = sigma_points(belief, rule.weights)
        if points.ndim > 2:
            raise FilterError("step: takes one filter; a batch takes predict and update")
    moved = process(points)
    room = np.empty(rule.room, rule.dtype)
    try:
        status = kernels.redraw(moved, rule.numbers, Q, room)
    except TypeError as error:
        raise wrong_arrays(mean=points, process=moved, Q=Q) from error
    if status:
        refuse(status)
    points = room[: 2 * rule.room[1] + 1]
    points.setflags(False)  # the parts depend on one another, and a model could write into its rows
    images = measure(points)
    try:
        status, nis = kernels.correct_and_redraw(room, images, y, R, rule.numbers, rule.marks)
    except TypeError as error:
        raise wrong_arrays(mean=points, measure=images, y=y, R=R) from error
    if status:
        refuse(status)
    return Drawn(points, room, nis, rule)


def _correct(
    points: Array,
    images: Array,
    P: Array,
    y: Array,
    R: Array,
    weights: Weights,
    angular: tuple[int, ...],
    considered: tuple[int, ...],
) -> Update:
    """`correct` of one filter."""
    _, _, w_cov, w = weights
    try:
        n, m, dtype = points.shape[1], len(y), points.dtype
        marks = flags(angular, m), flags(considered, n)
        out, told = np.empty((n + 1, n), dtype), np.empty((m + 2, m), dtype)
        status, nis = kernels.correct(points, images, P, y, R, w_cov, w, *marks, out, told)
    except (TypeError, AttributeError, IndexError) as error:
        raise wrong_arrays(mean=points, measure=images, y=y, R=R) from error
    if status:
        refuse(status)
    return Update(Belief(out[0], out[1:]), told[0], told[2:], told[1], nis)


def over_rows(model: Rows, points: Array) -> Array:
    """A model over points (k, n), or over the rows of a batch (B, k, n)."""
    if points.ndim == 2:
        return model(points)
    given = points.reshape(-1, points.shape[-1])
    rows = model(given)
    if rows.ndim != 2 or len(rows) != len(given):
        raise FilterError(f"process or measure: gave {rows.shape} for rows {given.shape}")
    return rows.reshape(*points.shape[:-1], rows.shape[-1])


def _batched(noise: Array) -> Array:
    return _packed(noise if noise.ndim == 3 else noise[None])


def _packed(array: Array) -> Array:
    """As the kernels of batches take it: without gaps."""
    return array if array.flags.c_contiguous else array.copy()


def wrong_arrays(**arrays: Any) -> FilterError:
    """The error for arrays that no kernel takes: no arrays, no floating point, of different precision or rank."""
    for name, array in arrays.items():
        if not isinstance(array, np.ndarray):
            return FilterError(f"{name}: must be a NumPy array, not {type(array).__name__}")
        if array.dtype not in (np.float64, np.float32):
            return FilterError(f"{name}: must be float64 or float32, not {array.dtype}")
    described = ", ".join(f"{name} {array.dtype} {array.shape}" for name, array in arrays.items())
    return FilterError(f"arrays must agree in precision and in batch axes: {described}")


# ------------------------------------------------------------------------------------- as methods


def method(name: str, weights: Callable[[int], Weights], considered: tuple[int, ...] = (), **more: Any) -> Method:
    """The filter with given weights, as every method is called."""

    def predict_(state: Belief, process: Rows, Q: Array) -> Belief:
        return predict(state, process, Q, weights(state.mean.shape[-1]))

    def update_(state: Belief, y: Array, measure: Rows, R: Array, angular: tuple[int, ...]) -> Update:
        return update(state, y, measure, R, weights(state.mean.shape[-1]), angular, considered)

    return Method(name, start, predict_, update_, lambda state: state, **more)


SINGLE: Final = "a millimetre after a kilometre needs more digits than float32 has; a square root halves the need"

METHODS: Final = (
    method("unscented", julier_weights, exempt={"long_run_float32": SINGLE}),
    method("unscented-scaled-1", lambda n: scaled_weights(n, 1.0, 2.0), exempt={"long_run_float32": SINGLE}),
    method("unscented-scaled-0.1", lambda n: scaled_weights(n, 0.1, 2.0), exempt={"long_run_float32": SINGLE}),
    method(
        "unscented-considered",
        julier_weights,
        (0,),
        exempt={"kalman": "a considered state is not moved by measurements, which is not optimal (Schmidt 1966)"},
    ),
)
