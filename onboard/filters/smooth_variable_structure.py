"""Smooth variable structure filter, with a fixed or a variable boundary layer.

    state = start(mean, covariance)
    state = predict(state, process, Q)
    state = update(state, y, measure, R).belief

Habibi 2007; Gadsden & Habibi 2010. Each measured quantity is moved by s = (|e| + gamma |e_last|) sat(e / layer),
with e the innovation and e_last the residual of the update before. Outside the layer the step is at least the
whole of e, for any prediction of the model; inside it is less. If all states are measured, a layer of zero gives
the measurement back.

Unmeasured states follow by a right inverse of H; there are many for m < n. The default is P H^T (H P H^T)^-1,
which moves them by their correlation with the measured quantities. `weighted=False` is the paper's C^+, which
ignores the covariance: an unmeasured velocity is then not estimated at all.

Arrays are float64, with or without a leading batch axis.

Errata of Al-Shabi, Gadsden & Wilkerson, with their equation numbers: (2.3.3) divides by e, see
`kernels.variable_structure.decide_into`; (2.2.4) and (2.2.8) cancel, deviations are taken from the mean; (2.2.12)
adds what must be subtracted, here it is Joseph's form.
"""

from functools import partial
from typing import Final

from onboard.arrays import Array
from onboard.filters.belief import Method, Rows
from onboard.filters.kernels.variable_structure import FIXED_LAYER_TYPE, VARIABLE_LAYER_TYPE, Settings
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

__all__ = ["METHODS", "LayerUpdate", "State", "belief", "predict", "start", "update", "update_variable"]

LAYER_SIGMAS: Final = 5.0  # a layer's width in standard deviations of the measurement


def update(
    state: State,
    y: Array,
    measure: Rows,
    R: Array,
    angular: tuple[int, ...] = (),
    *,
    layer: Array | None = None,
    sigmas: float = LAYER_SIGMAS,
    gamma: float = CONVERGENCE_RATE,
    weighted: bool = True,
) -> LayerUpdate:
    """SVSF with a fixed boundary layer (eqs 2.3.1-2.3.6).

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
    layer : (m,)
        Width of the layer in the measurement's units; None: `sigmas` standard deviations of R.
    sigmas
        Width of the layer in standard deviations of R.
    gamma
        Convergence rate.
    weighted
        Whether unmeasured states follow by their correlation.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    NotPositiveDefiniteError
        If a covariance is not positive definite, or not finite.
    """
    settings = Settings(FIXED_LAYER_TYPE, sigmas, gamma, weighted=weighted)
    return correct(state, y, measure, R, angular, settings, layer)[0]


def update_variable(
    state: State,
    y: Array,
    measure: Rows,
    R: Array,
    angular: tuple[int, ...] = (),
    *,
    limit: Array | None = None,
    sigmas: float = LAYER_SIGMAS,
    gamma: float = CONVERGENCE_RATE,
    weighted: bool = True,
) -> LayerUpdate:
    """VBL-SVSF: Kalman's gain if the optimal layer is within a limit.

    Otherwise the gain is the SVSF's with that limit. The optimal layer is S_ii / (H P H^T)_ii (|e| + gamma
    |e_last|). It is wide where the prior is good, so a narrow limit discards information of the model.

    Parameters
    ----------
    limit : (m,)
        Limit of the layer in the measurement's units; None: `sigmas` standard deviations of R.
    state, y, measure, R, angular, sigmas, gamma, weighted
        As in `update`.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    NotPositiveDefiniteError
        If a covariance is not positive definite, or not finite.
    """
    settings = Settings(VARIABLE_LAYER_TYPE, sigmas, gamma, weighted=weighted)
    return correct(state, y, measure, R, angular, settings, limit)[0]


NOT_OPTIMAL: Final = {
    "kalman": "its gain is made for robustness against a wrong model, and is not the optimal one"
}

METHODS: Final[tuple[Method, ...]] = (
    method("svsf", update, exempt=NOT_OPTIMAL),
    method("svsf-zero-layer", partial(update, sigmas=0.0), exempt=NOT_OPTIMAL),
    method(
        "vbl-svsf",
        update_variable,
        exempt=NOT_OPTIMAL
        | {"consistent": "its gain depends on the innovation's size, and its covariance does not allow for that"},
    ),
)
