"""The unscented Kalman filter, generic over models: Oh & Johnson eqs 19-42 (after Julier, and van der Merwe).

    points = spread(belief)            # (2n+1, n)
    points = process(points)           # (2n+1, n) -> (2n+1, n): the model, any function over rows
    belief = gather(points) + Q

Arrays are float64 or float32, all alike. With a leading batch axis B on mean and covariance (and on y), B filters
advance in one call; the model then gets the rows of all of them, (B (2n+1), n), each filter's together.
"""

from collections.abc import Callable
from typing import Any, Final

import numpy as np

from onboard.filters import _kernels_points as kernels
from onboard.filters import stepping
from onboard.filters.belief import (
    Belief,
    FilterError,
    Method,
    NotPositiveDefiniteError,
    Rows,
    Update,
    Weights,
    flags,
    refuse,
    start,
    wrong_arrays,
)
from onboard.filters.stepping import Drawn, Rule
from onboard.geometry.rotations import Array


def _keep_pages() -> None:
    """Let a large batch keep its memory from step to step. The C library (glibc) gives free memory at the top of
    the heap back when it is more than twice the largest piece it has seen come and go, and a batch of 500 would
    take it again in each step, page by page, for a tenth of its time. A piece of 8 MB, never touched, will do."""
    np.empty(8 << 20, np.uint8)


_keep_pages()


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


def rule(
    weights: Weights,
    n: int,
    m: int,
    angular: tuple[int, ...] = (),
    considered: tuple[int, ...] = (),
    dtype: Any = np.float64,
) -> Rule:
    """This filter for `step`, of n states and m measured components; the last arguments are those of `update`.

    Raises FilterError.
    """
    return stepping.rule(weights, n, m, angular, considered, dtype, KERNELS)


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


KERNELS: Final = stepping.Kernels(
    sigma_points, kernels.redraw, kernels.correct_and_redraw, factored=False, scratch_size=kernels.scratch_size
)
step: Final = stepping.step  # of this filter, by its `rule`


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
        given = _packed(points), images, _packed(belief.covariance), _packed(y), _batched(R)
        *posterior, innovation, S, predicted, nis, status = kernels.correct_batch(*given, *weights[2:], *marks)
    except (TypeError, AttributeError, IndexError) as error:
        raise wrong_arrays(mean=belief.mean, measure=images, y=y, R=R) from error
    if status:
        refuse(status)
    return Update(Belief(*posterior), innovation, S, predicted, nis)


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
    method("unscented", julier_weights),
    method("unscented-scaled-1", lambda n: scaled_weights(n, 1.0, 2.0), exempt={"long_run_float32": SINGLE}),
    method("unscented-scaled-0.1", lambda n: scaled_weights(n, 0.1, 2.0), exempt={"long_run_float32": SINGLE}),
    method(
        "unscented-considered",
        julier_weights,
        (0,),
        exempt={"kalman": "a considered state is not moved by measurements, which is not optimal (Schmidt 1966)"},
    ),
)
