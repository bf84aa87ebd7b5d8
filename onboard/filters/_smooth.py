"""What the smooth variable structure filters share: their state, their answer, and the call of their kernel."""

from collections.abc import Callable
from typing import Any, Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.filters import belief as beliefs
from onboard.filters import cubature
from onboard.filters._calls import straight
from onboard.filters.belief import Belief, FilterError, Method, Rows, Update, flags
from onboard.filters.kernels import variable_structure as kernels
from onboard.filters.unscented_transform import over_rows, sigma_points

GAMMA: Final = 0.1  # the convergence rate
NAMES: Final = ("mean", "covariance", "measure", "y", "R", "residual", "lasted", "switching", "leaning", "layer")
AXES: Final = {"covariance": 2, "measure": 2, "R": 2}


class SmoothState(NamedTuple):
    """A belief, mean (..., n) and covariance (..., n, n); the residual (..., m) after the last update; for how
    many updates each component has been outside of its layer (..., m); and, of the adaptive form, the fading mean
    of sat(e/layer) (..., m), one that fades more slowly, and the covariance (..., n, n) of the model's error that
    the latter finds, which is told but not followed. Before the first update m is 0."""

    mean: Array
    covariance: Array
    residual: Array
    lasted: Array
    switching: Array
    leaning: Array
    doubt: Array


class SmoothUpdate(NamedTuple):
    """`belief.Update`'s five fields, the boundary layer (..., m) in units of the measurement, and which components
    were outside of it (..., m) and which were rejected (..., m)."""

    belief: Any
    innovation: Array
    innovation_covariance: Array
    predicted: Array
    nis: Any
    layer: Array
    outside: Any
    rejected: Any


class Settings(NamedTuple):
    """What tells the filters apart: the kind of layer (`_kernels_smooth`), `scale` standard deviations (of R, for
    SWITCHED and ADAPTIVE of the innovation), for how many updates an exceedance must last, gamma, the right
    inverse, and by what share each update renews the mean of sat(e/layer)."""

    kind: int
    scale: float
    patience: int = 1
    gamma: float = GAMMA
    weighted: bool = True
    fading: float = 0.0


def start(mean: Array, covariance: Array) -> SmoothState:
    """A state that has seen no measurement: mean (..., n), covariance (..., n, n).

    Raises FilterError.
    """
    nothing = np.zeros((*beliefs.start(mean, covariance).mean.shape[:-1], 0), mean.dtype)
    return SmoothState(mean, covariance, nothing, nothing, nothing, nothing, np.zeros_like(covariance))


def believed(state: SmoothState) -> Belief:
    """What the filter believes: with the error of its model that it knows of and does not follow."""
    return Belief(state.mean, state.covariance + state.doubt)


def predict(state: SmoothState, process: Rows, Q: Array) -> SmoothState:
    """Time update over cubature points (eqs 2.2.1-2.2.4). `process` maps rows (k, n) -> (k, n), Q is (..., n, n).

    Raises FilterError, NotPositiveDefiniteError.
    """
    mean, covariance = cubature.predict(Belief(state.mean, state.covariance), process, Q)
    return state._replace(mean=mean, covariance=covariance)


def correct(
    state: SmoothState,
    y: Array,
    measure: Rows,
    R: Array,
    angular: tuple[int, ...],
    settings: Settings,
    layer: Array | None = None,
) -> tuple[SmoothUpdate, Array]:
    """Measurement update, and the ratio S_ii / (H P H^T)_ii (..., m) of eq 3.1. `layer` (..., m) is in place of
    `scale` standard deviations.

    Raises FilterError, NotPositiveDefiniteError.
    """
    if not 0 <= settings.gamma < 1:
        raise FilterError(f"gamma: must be in [0, 1), not {settings.gamma}")
    if not settings.scale >= 0:
        raise FilterError(f"sigmas, kappa: must not be negative, not {settings.scale}")
    if layer is not None and not (np.asarray(layer) >= 0).all():
        raise FilterError("layer: must be (m,) and not negative")
    mean, P, residual, lasted, switching, leaning, _ = state
    points = sigma_points(Belief(mean, P), cubature.weights(mean.shape[-1]))
    images = over_rows(measure, points)
    if not isinstance(y, np.ndarray) or y.ndim != mean.ndim:
        raise FilterError(f"y: must be an array, with the axes of the mean {mean.shape}: has {np.shape(y)}")
    if residual.shape != y.shape or lasted.shape != y.shape:  # the first measurement, or one of another sensor
        residual = lasted = switching = leaning = np.zeros_like(y, mean.dtype)
    given = dict(zip(NAMES, (mean, P, images, y, R, residual, lasted, switching, leaning, layer), strict=True))
    if layer is None:
        given["layer"] = np.empty(0, mean.dtype)
    lifted = {name: _lifted(array, AXES.get(name, 1)) for name, array in given.items()}
    marks = flags(angular, y.shape[-1])
    outputs = straight(
        kernels.update_batch,
        marks,
        settings.kind,
        settings.gamma,
        settings.scale,
        settings.patience,
        settings.weighted,
        settings.fading,
        **lifted,
    )
    if mean.ndim == 1:
        outputs = [output[0] for output in outputs]
    mean, P, e, S, predicted, width, smoothing, outside, rejected, doubt, lasted, switching, leaning, nis = outputs
    residual = wrapped(y - over_rows(measure, mean[..., None, :])[..., 0, :], marks)
    after = SmoothState(mean, P, residual, lasted, switching, leaning, doubt)
    return SmoothUpdate(
        after, e, S, predicted, nis if nis.ndim else float(nis), width, outside, rejected
    ), smoothing


def method(
    name: str,
    update: Callable[..., SmoothUpdate],
    functions: tuple[Any, Any, Any] = (start, predict, believed),
    exempt: dict[str, str] | None = None,
) -> Method:
    """A filter as every method is called: its answer is cut to that of all. `functions` are start, predict and
    believed."""

    def update_(state: Any, y: Array, measure: Rows, R: Array, angular: tuple[int, ...]) -> Update:
        return Update(*update(state, y, measure, R, angular)[:5])

    return Method(name, functions[0], functions[1], update_, functions[2], None, exempt or {})


def wrapped(difference: Array, angular: Any) -> Array:
    """Differences (..., m) with those of angles (a mask (m,)) in [-pi, pi]."""
    if not angular.any():
        return difference
    turns = np.where(angular, np.rint(difference / (2 * np.pi)), 0).astype(difference.dtype)
    return np.asarray(difference - 2 * np.pi * turns)


def _lifted(array: Any, axes: int) -> Any:
    """One filter's array as a batch of one; what is no array is left for the kernel's caller to name."""
    return array[None] if isinstance(array, np.ndarray) and array.ndim == axes else array
