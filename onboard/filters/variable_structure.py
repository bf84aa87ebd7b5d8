"""State, update record and kernel call that the smooth variable structure filters share.

`smooth_variable_structure` and `cubature_smooth` are the filters.
"""

from collections.abc import Callable
from typing import Any, Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.filters import belief as beliefs
from onboard.filters import cubature
from onboard.filters.belief import Belief, Indices, Method, Rows, Update, images_of, mask, over_rows
from onboard.filters.errors import FilterError, require_plain
from onboard.filters.kernels import variable_structure as kernels
from onboard.filters.kernels.calls import call_as_is
from onboard.filters.kernels.variable_structure import Settings
from onboard.filters.unscented_transform import sigma_points

CONVERGENCE_RATE: Final = 0.1  # gamma


class State(NamedTuple):
    """The state of a smooth variable structure filter. Before the first update m is 0.

    Attributes
    ----------
    mean : (..., n)
        Mean.
    covariance : (..., n, n)
        Covariance.
    residual : (..., m)
        Residual after the last update.
    updates_outside : (..., m)
        Number of updates for which each component has been outside its layer.
    switching, slow_switching : (..., m)
        Fading means of sat(e/layer), for the adaptive form.
    model_error : (..., n, n)
        Covariance of the model's error by the slow mean, which widens the belief but not the gain.
    """

    mean: Array
    covariance: Array
    residual: Array
    updates_outside: Array
    switching: Array
    slow_switching: Array
    model_error: Array


class LayerUpdate(NamedTuple):
    """The five fields of `belief.Update`, and the boundary layer.

    Attributes
    ----------
    layer : (..., m)
        Boundary layer in units of the measurement.
    outside, rejected : (..., m)
        Masks of the components outside the layer, and of those rejected.
    """

    belief: Any
    innovation: Array
    innovation_covariance: Array
    predicted: Array
    nis: Any
    layer: Array
    outside: Any
    rejected: Any


def start(mean: Array, covariance: Array) -> State:
    """Return the state before any measurement: mean (..., n), covariance (..., n, n).

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    """
    empty = np.zeros((*beliefs.start(mean, covariance).mean.shape[:-1], 0))
    return State(mean, covariance, empty, empty, empty, empty, np.zeros_like(covariance))


def belief(state: State) -> Belief:
    """Return the mean, and the covariance with that of the model's error."""
    return Belief(state.mean, state.covariance + state.model_error)


def predict(state: State, process: Rows, Q: Array, angular_states: Indices = ()) -> State:
    """Time update over cubature points (eqs 2.2.1-2.2.4).

    Parameters
    ----------
    process, Q, angular_states
        As in `cubature.predict`.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    NotPositiveDefiniteError
        If a covariance is not positive definite, or not finite.
    """
    mean, covariance = cubature.predict(Belief(state.mean, state.covariance), process, Q, angular_states)
    return State(mean, covariance, *state[2:])


def correct(
    state: State,
    y: Array,
    measure: Rows,
    R: Array,
    angular: tuple[int, ...],
    settings: Settings,
    layer: Array | None = None,
) -> tuple[LayerUpdate, Array]:
    """Return the measurement update, and the ratio S_ii / (H P H^T)_ii (..., m) of eq 3.1.

    `layer` (..., m) replaces `scale` standard deviations.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    NotPositiveDefiniteError
        If a covariance is not positive definite, or not finite.
    """
    _check(settings, layer)
    mean, P, residual, updates_outside, switching, slow_switching, _ = state
    points = sigma_points(Belief(mean, P), cubature.weights(mean.shape[-1]))
    if y.__class__ is not np.ndarray:
        require_plain(y=y)
    images = images_of(measure, points, y)
    # The first measurement, or one of another sensor, has no memory yet.
    if residual.shape != y.shape or updates_outside.shape != y.shape:
        residual = updates_outside = switching = slow_switching = np.zeros_like(y)
    angles = mask(angular, y.shape[-1])
    outputs = call_as_is(
        kernels.update_batch,
        mean.shape[:-1],
        *(angles, settings._replace(scale=float(settings.scale), gamma=float(settings.gamma))),
        mean=_batch(mean, 1),
        covariance=_batch(P, 2),
        measure=_batch(images, 2),
        y=_batch(y, 1),
        R=_batch(R, 2),
        residual=_batch(residual, 1),
        updates_outside=_batch(updates_outside, 1),
        switching=_batch(switching, 1),
        slow_switching=_batch(slow_switching, 1),
        layer=_batch(np.empty(0) if layer is None else layer, 1),
    )
    if mean.ndim == 1:
        outputs = [output[0] for output in outputs]
    mean, P, e, S, predicted, width, ratio, outside, rejected, model_error = outputs[:10]
    updates_outside, switching, slow_switching, nis = outputs[10:]
    residual = wrapped(y - over_rows(measure, mean[..., None, :], y)[..., 0, :], angles)
    after = State(mean, P, residual, updates_outside, switching, slow_switching, model_error)
    nis = nis if nis.ndim else float(nis)
    return LayerUpdate(after, e, S, predicted, nis, width, outside, rejected), ratio


def _check(settings: Settings, layer: Array | None) -> None:
    if not 0 <= settings.gamma < 1:
        raise FilterError(f"gamma: must be in [0, 1), not {settings.gamma}")
    if not settings.scale >= 0:
        raise FilterError(f"sigmas, kappa: must not be negative, not {settings.scale}")
    if layer is not None and not (np.asarray(layer) >= 0).all():
        raise FilterError("layer: must be (m,) and not negative")


def method(
    name: str,
    update: Callable[..., LayerUpdate],
    functions: tuple[Any, Any, Any] = (start, predict, belief),
    exempt: dict[str, str] | None = None,
) -> Method:
    """Return a filter as a `Method`, with the five fields of `Update` alone.

    `functions` are start, predict and belief.
    """

    def update_(
        state: Any, y: Array, measure: Rows, R: Array, angular: Indices = (), angular_states: Indices = ()
    ) -> Update:
        if angular_states:
            prior = functions[2](state)
            sigma_points(prior, cubature.weights(prior.mean.shape[-1]), angular_states)  # refuses those too wide
        return Update(*update(state, y, measure, R, angular)[:5])

    return Method(name, functions[0], functions[1], update_, functions[2], None, exempt or {})


def wrapped(difference: Array, angular: Any) -> Array:
    """Return differences (..., m) with those of angles (a mask (m,)) in [-pi, pi]."""
    if not angular.any() or np.abs(difference).max(initial=0.0) <= np.pi:
        return difference
    turns = np.where(angular, np.rint(difference / (2 * np.pi)), 0)
    return np.asarray(difference - 2 * np.pi * turns)


def _batch(array: Any, axes: int) -> Any:
    """Return an array of one filter as a batch of one.

    Anything else stays as it is: the kernel's caller names it in the error.
    """
    return array[None] if isinstance(array, np.ndarray) and array.ndim == axes else array
