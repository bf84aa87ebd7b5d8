"""Fixed-interval smoothing of a linear filter (Rauch, Tung & Striebel 1965).

The filter's beliefs and the result are stacked over time, mean (T, n) and covariance (T, n, n), or (T, B, n) and
(T, B, n, n) for a batch. A measurement update, if there was one, is in the belief of its time. Covariances are
smoothed in Joseph's form, so none is a difference.
"""

from typing import Final

import numpy as np

from onboard.arrays import Array
from onboard.filters.angles import beside
from onboard.filters.belief import Belief, Indices, Method
from onboard.filters.errors import FilterError, require_plain
from onboard.filters.kernels import linearisation
from onboard.filters.kernels.calls import call_as_is


def rauch_tung_striebel(
    filtered: Belief, F: Array, Q: Array, inputs: Array | None = None, angular_states: Indices = ()
) -> Belief:
    """Smooth the beliefs of a linear Kalman filter.

    Parameters
    ----------
    filtered
        Beliefs, stacked over time.
    F, Q : (n, n) or (T-1, n, n)
        Transition and noise of all steps, or of each step from t to t + 1; of a batch (T-1, B or 1, n, n).
    inputs : (T-1, n)
        Anything else that each step added to the mean.
    angular_states
        Indices of states that are angles, whose differences wrap.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    NotPositiveDefiniteError
        If a covariance is not positive definite, or not finite.
    """
    _check(filtered)
    mean = filtered.mean[:-1]
    F, Q = _each_step(F, filtered, "F"), _each_step(Q, filtered, "Q")
    predicted = (F @ mean[..., None])[..., 0]
    if inputs is not None:
        require_plain(inputs=inputs)
        if inputs.shape not in {mean.shape, (len(mean), mean.shape[-1])}:
            raise FilterError(
                f"inputs: must be {(len(mean), mean.shape[-1])}, one for each step, not {inputs.shape}"
            )
        predicted = predicted + (inputs[:, None] if inputs.ndim < mean.ndim else inputs)
    return _smoothed(filtered, F, Q, predicted, angular_states)


def _check(filtered: Belief) -> None:
    mean, covariance = filtered
    require_plain(mean=mean, covariance=covariance)
    if mean.ndim not in (2, 3) or len(mean) < 2 or covariance.shape != (*mean.shape, mean.shape[-1]):
        raise FilterError(
            f"shapes do not fit: mean {mean.shape}, covariance {covariance.shape}; must be (T, n) and (T, n, n), "
            "or (T, B, n) and (T, B, n, n), T at least 2"
        )


def _each_step(matrix: Array, filtered: Belief, name: str) -> Array:
    """Return a matrix of all steps, or one for each, as one for each: (T-1, ..., n, n)."""
    shape = filtered.covariance[:-1].shape
    require_plain(**{name: matrix})
    if matrix.shape[-2:] != shape[-2:]:
        raise FilterError(f"{name}: must be {shape[-2:]}, or one for each step before that, not {matrix.shape}")
    if matrix.ndim == 3 and len(shape) == 4:
        matrix = matrix[:, None]
    try:
        return np.broadcast_to(matrix, shape)
    except ValueError as error:
        raise FilterError(f"shapes do not fit: {name} {matrix.shape} for {shape}") from error


def _smoothed(filtered: Belief, F: Array, Q: Array, predicted: Array, angular_states: Indices) -> Belief:
    mean, covariance = filtered
    # a smoothed mean is near the filtered one, whose angles have made any number of turns since the prediction
    predicted = beside(predicted, mean[1:], angular_states)
    lead = mean.shape[1:-1]
    if mean.ndim == 2:
        mean, covariance, F, Q, predicted = (a[:, None] for a in (mean, covariance, F, Q, predicted))
    arrays = {"mean": mean, "covariance": covariance, "F": F, "Q": Q, "predicted": predicted}
    mean, covariance = call_as_is(linearisation.smooth_back, lead, **arrays)
    shape = filtered.mean.shape
    return Belief(mean.reshape(shape), covariance.reshape(filtered.covariance.shape))


METHODS: Final[tuple[Method, ...]] = ()  # a smoother needs the whole record, so it is not a filter
