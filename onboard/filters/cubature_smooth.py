"""Cubature smooth variable structure filter (CSVSF) in four forms.

They are printed, recursive, robust and adaptive. The printed form is that of Al-Shabi, Gadsden & Wilkerson
(section 3); the recursive one is by Gadsden, Al-Shabi, Arasaratnam & Habibi (2014).

The recursive forms are the cubature Kalman filter until |e| + gamma |e_last| of a measured quantity exceeds kappa
standard deviations of its innovation. The model is then assumed wrong: that quantity is moved as with a layer of
zero, and moves no other measured quantity. The robust form first rejects the measurement, since an outlier looks
the same, and follows it once the exceedance has lasted.

But most effects of a wrong model stay within five deviations: innovations that keep to one side. The adaptive form
is the robust one with a prior that is widened in those quantities by as much as explains the mean innovation. So
it separates outliers from a wrong model.

Arrays are float64, with or without a leading batch axis. Errata: `smooth_variable_structure`.
"""

from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.filters.belief import Belief, Method, Rows
from onboard.filters.errors import FilterError
from onboard.filters.kernels.variable_structure import (
    ADAPTIVE_LAYER_TYPE,
    FIXED_LAYER_TYPE,
    SWITCHED_LAYER_TYPE,
    Settings,
)
from onboard.filters.smooth_variable_structure import NOT_OPTIMAL
from onboard.filters.variable_structure import (
    CONVERGENCE_RATE,
    LayerUpdate,
    State,
    belief,
    correct,
    method,
    predict,
    start,
)

__all__ = [
    "METHODS",
    "PrintedState",
    "belief",
    "predict",
    "predict_printed",
    "start",
    "start_printed",
    "update",
    "update_adaptive",
    "update_printed",
    "update_robust",
]

KAPPA: Final = 5.0
MIN_EXCEEDANCE_STEPS: Final = 3  # before an exceedance is followed
FADING_FRACTION: Final = 0.1  # of the newest update in the mean of sat(e/layer), over some ten updates


def update(
    state: State,
    y: Array,
    measure: Rows,
    R: Array,
    angular: tuple[int, ...] = (),
    *,
    kappa: float = KAPPA,
    gamma: float = CONVERGENCE_RATE,
    weighted: bool = True,
) -> LayerUpdate:
    """Recursive CSVSF, with the cubature Kalman filter's gain within `kappa` deviations.

    Outside, the gain is the SVSF's.

    Parameters
    ----------
    state
        State of n states, from `start` or `predict`.
    y : (..., m)
        Measured values.
    measure
        Function of rows (k, n); returns rows (k, m).
    R : (..., m, m)
        Covariance of the measurement noise.
    angular
        Components of y that are angles and wrap.
    kappa
        Half width of the layer, in standard deviations of the innovation.
    gamma
        Convergence rate.
    weighted
        Whether unmeasured states follow by their correlation, see `smooth_variable_structure`.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    NotPositiveDefiniteError
        If a covariance is not positive definite, or not finite.
    """
    settings = Settings(SWITCHED_LAYER_TYPE, kappa, gamma, weighted=weighted)
    return correct(state, y, measure, R, angular, settings)[0]


def update_robust(
    state: State,
    y: Array,
    measure: Rows,
    R: Array,
    angular: tuple[int, ...] = (),
    *,
    kappa: float = KAPPA,
    patience: int = MIN_EXCEEDANCE_STEPS,
    gamma: float = CONVERGENCE_RATE,
    weighted: bool = True,
) -> LayerUpdate:
    """Robust CSVSF: as `update`, but lone exceedances are rejected.

    A component beyond `kappa` deviations is rejected until it has been there for `patience` updates in a row.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    NotPositiveDefiniteError
        If a covariance is not positive definite, or not finite.
    """
    if patience < 1:
        raise FilterError(f"patience: must be at least 1, not {patience}")
    settings = Settings(SWITCHED_LAYER_TYPE, kappa, gamma, patience, weighted)
    return correct(state, y, measure, R, angular, settings)[0]


def update_adaptive(
    state: State,
    y: Array,
    measure: Rows,
    R: Array,
    angular: tuple[int, ...] = (),
    *,
    kappa: float = KAPPA,
    patience: int = MIN_EXCEEDANCE_STEPS,
    fading: float = FADING_FRACTION,
    gamma: float = CONVERGENCE_RATE,
) -> LayerUpdate:
    """Adaptive CSVSF: as `update_robust`, with a prior that is widened where the model is wrong.

    For each measured quantity w is the mean of sat(e / psi) over the updates, the newest having the share
    `fading`, and psi `kappa` standard deviations of its innovation. In sliding mode the mean of the switching term
    (Utkin's equivalent control) is the model's error. Where |w| exceeds `kappa` of the deviations that white
    innovations give it, the prior's variance of that quantity grows by (w psi)^2, the square of the persistent
    innovation, and the variances of unmeasured states grow by their correlation with it. One outlier moves w by at
    most `fading`.

    A mean five times slower finds smaller errors: beyond two deviations their variance is added to the covariance
    of `belief`, and not followed.

    w is the state's `switching`, a measure of the model's error: within sqrt(fading / (2 - fading)) without one.
    `innovation_covariance` and NIS are those of the prior before it was widened, `layer` is that after.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    NotPositiveDefiniteError
        If a covariance is not positive definite, or not finite.
    """
    if patience < 1:
        raise FilterError(f"patience: must be at least 1, not {patience}")
    if not 0 < fading <= 1:
        raise FilterError(f"fading: must be in (0, 1], not {fading}")
    settings = Settings(ADAPTIVE_LAYER_TYPE, kappa, gamma, patience, fading=fading)
    return correct(state, y, measure, R, angular, settings)[0]


# --------------------------------------------------------------------------------- as the paper prints it


class PrintedState(NamedTuple):
    """The paper's two filters, each a State.

    The first has a layer of zero, the second is the estimate.
    """

    first: State
    second: State


def start_printed(mean: Array, covariance: Array) -> PrintedState:
    """Return the state before any measurement: mean (..., n), covariance (..., n, n).

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    """
    state = start(mean, covariance)
    return PrintedState(state, state)


def predict_printed(
    state: PrintedState, process: Rows, Q: Array, angular_states: tuple[int, ...] = ()
) -> PrintedState:
    """Time update of both filters; parameters as in `predict`.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    NotPositiveDefiniteError
        If a covariance is not positive definite, or not finite.
    """
    return PrintedState(*(predict(one, process, Q, angular_states) for one in state))


def update_printed(
    state: PrintedState,
    y: Array,
    measure: Rows,
    R: Array,
    angular: tuple[int, ...] = (),
    *,
    gamma: float = CONVERGENCE_RATE,
    weighted: bool = True,
) -> LayerUpdate:
    """CSVSF as printed in section 3.

    The first filter's innovation and Pzz give the second filter's layer (eq 3.1). Pzz is that of one cubature
    prediction from the first filter's posterior. A zero layer makes that posterior from R alone at every update,
    so Pzz is not recursive. `belief` of the result is a PrintedState; all other fields are the second filter's.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    NotPositiveDefiniteError
        If a covariance is not positive definite, or not finite.
    """
    settings = Settings(FIXED_LAYER_TYPE, 0.0, gamma, weighted=weighted)
    first, ratio = correct(state.first, y, measure, R, angular, settings)
    layer = np.asarray(ratio * np.abs(first.innovation))
    second, _ = correct(state.second, y, measure, R, angular, settings, layer)
    return second._replace(belief=PrintedState(first.belief, second.belief))


def belief_printed(state: PrintedState) -> Belief:
    """Return the belief of the second filter."""
    return belief(state.second)


OUTLIERS: Final = {
    "kalman": "a measurement five deviations off, which the problem has, is followed or rejected, not weighed"
}

METHODS: Final[tuple[Method, ...]] = (
    method("csvsf-printed", update_printed, (start_printed, predict_printed, belief_printed), NOT_OPTIMAL),
    method("csvsf", update, exempt=OUTLIERS),
    method("csvsf-robust", update_robust, exempt=OUTLIERS),
    method("csvsf-adaptive", update_adaptive, exempt=OUTLIERS),
)
