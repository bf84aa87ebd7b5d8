"""The unscented filter with the noises in the state (Varaprasad et al., section 3.1, after Julier): for noise that
enters the model anywhere, not only as a sum.

    belief = predict_augmented(belief, process, Q)             # process(points (k, n), noises (k, n_w)) -> (k, n)
    belief = update_augmented(belief, y, measure, R).belief    # measure(points (k, n), noises (k, n_v)) -> (k, m)

`weights` is a rule for any number of states, such as `unscented.julier_weights`: the augmented state has
L = n + n_w (+ n_v). `step_augmented` makes both halves from one set of points (eqs 8-12), so that the measurement
sees the process noise's own points; the two calls draw points anew in between, as eq 16 does. Noise covariances
may be singular. Arrays are float64 or float32, all alike, with or without a leading batch axis on mean, covariance
and y.
"""

from collections.abc import Callable
from typing import Any, Final

import numpy as np

from onboard.filters import unscented
from onboard.filters.belief import Belief, FilterError, Method, NotPositiveDefiniteError, Rows, Update, start
from onboard.filters.unscented import Weights, flags, julier_weights, over_rows, scaled_weights
from onboard.geometry.rotations import Array

NoisyRows = Callable[[Array, Array], Array]
Rule = Callable[[int], Weights]


def predict_augmented(belief: Belief, process: NoisyRows, Q: Array, weights: Rule = julier_weights) -> Belief:
    """Time update; Q (..., n_w, n_w) is the covariance of what `process` gets as noises.

    Raises FilterError, NotPositiveDefiniteError.
    """
    n = belief.mean.shape[-1]
    points, rule = _augmented(belief, {"Q": Q}, weights)
    moved = _apply(process, points[..., :n], points[..., n:], n, "process")
    return _gathered(moved, rule)


def update_augmented(
    belief: Belief,
    y: Array,
    measure: NoisyRows,
    R: Array,
    weights: Rule = julier_weights,
    angular: tuple[int, ...] = (),
) -> Update:
    """Measurement update; R (..., n_v, n_v) is the covariance of what `measure` gets as noises. `angular` are the
    components of y that are angles, whose differences wrap.

    Raises FilterError, NotPositiveDefiniteError.
    """
    n, m = belief.mean.shape[-1], _components(belief, y)
    points, rule = _augmented(belief, {"R": R}, weights)
    images = _apply(measure, points[..., :n], points[..., n:], m, "measure, y")
    return _correct(belief, points[..., :n], images, y, rule, angular)


def step_augmented(
    belief: Belief,
    process: NoisyRows,
    Q: Array,
    y: Array,
    measure: NoisyRows,
    R: Array,
    weights: Rule = julier_weights,
    angular: tuple[int, ...] = (),
) -> Update:
    """A prediction and an update from one set of 2L + 1 points, L = n + n_w + n_v (eqs 8-12).

    Raises FilterError, NotPositiveDefiniteError.
    """
    n, m, n_w = belief.mean.shape[-1], _components(belief, y), Q.shape[-1]
    points, rule = _augmented(belief, {"Q": Q, "R": R}, weights)
    moved = _apply(process, points[..., :n], points[..., n : n + n_w], n, "process")
    images = _apply(measure, moved, points[..., n + n_w :], m, "measure, y")
    return _correct(_gathered(moved, rule), moved, images, y, rule, angular)


def _components(belief: Belief, y: Array) -> int:
    if not isinstance(y, np.ndarray) or y.ndim != belief.mean.ndim or y.dtype != belief.mean.dtype:
        raise FilterError(
            f"y: must be an array like the mean, {belief.mean.dtype} {belief.mean.shape[:-1]} + (m,)"
        )
    return int(y.shape[-1])


def _augmented(belief: Belief, noises: dict[str, Array], weights: Rule) -> tuple[Array, Weights]:
    """Points (..., 2L+1, L) of state and noises (eq 9), the mean first, and their weights."""
    n = belief.mean.shape[-1]
    roots = [_root(name, noise, belief) for name, noise in noises.items()]
    L = n + sum(root.shape[-1] for root in roots)
    rule = weights(L)
    own = unscented.sigma_points(belief, rule)
    points = np.zeros((*own.shape[:-2], 2 * L + 1, L), own.dtype)
    points[..., :n] = own[..., :1, :]
    points[..., 1 : n + 1, :n] = own[..., 1 : n + 1, :]
    points[..., L + 1 : L + n + 1, :n] = own[..., n + 1 :, :]
    at = n
    for root in roots:
        size = root.shape[-1]
        offsets = rule.spread * np.swapaxes(root, -1, -2)
        points[..., at + 1 : at + size + 1, at : at + size] = offsets
        points[..., L + at + 1 : L + at + size + 1, at : at + size] = -offsets
        at += size
    return points, rule


def _root(name: str, noise: Array, belief: Belief) -> Array:
    """A square root (..., k, k) of a noise's covariance, which may be singular, so it is made of eigenvectors."""
    if not isinstance(noise, np.ndarray) or noise.dtype != belief.mean.dtype:
        raise FilterError(f"{name}: must be a NumPy array of the mean's precision, {belief.mean.dtype}")
    if noise.ndim < 2 or noise.shape[-1] != noise.shape[-2] or not np.isfinite(noise).all():
        raise FilterError(f"{name}: must be finite and (..., k, k), not {noise.shape}")
    values, vectors = np.linalg.eigh(0.5 * (noise + np.swapaxes(noise, -1, -2)))
    rounding = (
        10 * noise.shape[-1] * np.finfo(noise.dtype).eps * np.abs(values).max(axis=-1, initial=0, keepdims=True)
    )
    if (values < -rounding).any():
        raise NotPositiveDefiniteError(f"{name}: not positive semi-definite")
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0))[..., None, :])


def _apply(model: NoisyRows, points: Array, noises: Array, size: int, name: str) -> Array:
    """Images (..., 2L+1, size) of points with their noises. Raises FilterError."""
    n = points.shape[-1]
    joined = np.concatenate([points, noises], axis=-1)
    images = over_rows(lambda rows: model(rows[:, :n], rows[:, n:]), joined)
    if images.shape != (*points.shape[:-1], size):
        raise FilterError(f"{name}: gave {images.shape} for points {points.shape}, not {size} components")
    if images.dtype != points.dtype or not np.isfinite(images).all():
        raise FilterError(f"{name}: gave values that are not finite, or not {points.dtype}")
    return images


def _moments(points: Array, rule: Weights, angular: Any = None) -> tuple[Array, Array, Array]:
    """Mean (..., n), deviations from it (..., k, n), and those weighted and transposed (..., n, k)."""
    d = points - points[..., :1, :]
    if angular is not None:
        d = _wrapped(d, angular)
    shift = rule.other * np.sum(d[..., 1:, :], axis=-2, keepdims=True)
    d = d - shift
    weight = np.full(points.shape[-2], rule.other, d.dtype)
    weight[0] = rule.covariance
    return points[..., 0, :] + shift[..., 0, :], d, np.swapaxes(d * weight[:, None], -1, -2)


def _gathered(points: Array, rule: Weights) -> Belief:
    mean, d, weighted = _moments(points, rule)
    return Belief(mean, _symmetric(weighted @ d))


def _correct(
    prior: Belief, points: Array, images: Array, y: Array, rule: Weights, angular: tuple[int, ...]
) -> Update:
    """Eq 12 from points (..., k, n), which need not be symmetric about the mean, and their images (..., k, m)."""
    marks = flags(angular, y.shape[-1])
    predicted, d, weighted = _moments(images, rule, marks)
    e = _wrapped(y - predicted, marks)
    if not np.isfinite(e).all():
        raise FilterError("y: not finite")
    S, cross = _symmetric(weighted @ d), weighted @ (points - prior.mean[..., None, :])
    try:
        lower = np.linalg.cholesky(S)
    except np.linalg.LinAlgError as error:
        raise NotPositiveDefiniteError("innovation covariance, with R: not positive definite") from error
    solved = np.linalg.solve(lower, np.concatenate([cross, e[..., None]], axis=-1))
    half, white = solved[..., :-1], solved[..., -1:]  # K S K^T = half^T half
    half_t = np.swapaxes(half, -1, -2)
    posterior = Belief(prior.mean + (half_t @ white)[..., 0], _symmetric(prior.covariance - half_t @ half))
    nis = np.sum(white * white, axis=(-1, -2))
    return Update(posterior, e, S, predicted, nis if nis.ndim else float(nis))


def _symmetric(matrix: Array) -> Array:
    return np.asarray(0.5 * (matrix + np.swapaxes(matrix, -1, -2)))


def _wrapped(difference: Array, angular: Any) -> Array:
    if not angular.any():
        return difference
    turns = np.where(angular, np.rint(difference / (2 * np.pi)), 0).astype(difference.dtype)
    return np.asarray(difference - 2 * np.pi * turns)


# ------------------------------------------------------------------------------------- as methods


def additive(model: Rows, names: str = "model, noise") -> NoisyRows:
    """A model whose noise is a sum, as one that takes its noise. The result raises FilterError, with `names`."""

    def noisy(points: Array, noises: Array) -> Array:
        images = model(points)
        if images.shape != noises.shape:
            raise FilterError(f"{names}: gave {images.shape}, where noises are {noises.shape}")
        return images + noises

    return noisy


def _method(name: str, weights: Rule, **more: Any) -> Method:
    def predict_(state: Belief, process: Rows, Q: Array) -> Belief:
        return predict_augmented(state, additive(process, "process, Q"), Q, weights)

    def update_(state: Belief, y: Array, measure: Rows, R: Array, angular: tuple[int, ...]) -> Update:
        return update_augmented(state, y, additive(measure, "measure, R"), R, weights, angular)

    return Method(name, start, predict_, update_, lambda state: state, **more)


SINGLE: Final = {"long_run_float32": unscented.SINGLE}

METHODS: Final[tuple[Method, ...]] = (
    _method("augmented", julier_weights, exempt=SINGLE),
    _method("augmented-scaled-1", lambda n: scaled_weights(n, 1.0, 2.0), exempt=SINGLE),
)
