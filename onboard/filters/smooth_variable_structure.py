"""The smooth variable structure filter (Habibi 2007), and with a variable boundary layer (Gadsden & Habibi 2010).

    state = start(mean, covariance)
    state = predict(state, process, Q)
    state = update(state, y, measure, R).belief

Each measured quantity is moved by s = (|e| + gamma |e_last|) sat(e / layer), with e the innovation and e_last
the residual of the update before. Outside the layer the step is all of e and more, whatever the model
predicted; inside it is less. If all states are measured, a layer of zero gives the measurement back.

States that are not measured follow by a right inverse of H; there are many where m < n. The default is
P H^T (H P H^T)^-1, which moves them by their correlation with the measured quantities. `weighted=False` is the
paper's C^+, which ignores the covariance: a velocity that is not measured is then not estimated at all.

Arrays are all float64 or all float32, with or without a leading batch axis.

Errata of Al-Shabi, Gadsden & Wilkerson, whose equation numbers stand here: (2.3.3) divides by e, see
`kernels.variable_structure.decide_into`; (2.2.4) and (2.2.8) cancel, deviations are taken from the mean;
(2.2.12) adds what must be subtracted, here it is Joseph's form.
"""

from functools import partial
from typing import Final

from onboard.arrays import Array
from onboard.filters.belief import Method, Rows
from onboard.filters.kernels.variable_structure import FIXED, VARIABLE
from onboard.filters.variable_structure import (
    GAMMA,
    LayerUpdate,
    Settings,
    State,
    belief,
    correct,
    method,
    predict,
    start,
)

__all__ = ["METHODS", "LayerUpdate", "State", "belief", "predict", "start", "update", "update_variable"]

SIGMAS: Final = 5.0  # a layer's width in standard deviations of the measurement


def update(
    state: State,
    y: Array,
    measure: Rows,
    R: Array,
    angular: tuple[int, ...] = (),
    *,
    layer: Array | None = None,
    sigmas: float = SIGMAS,
    gamma: float = GAMMA,
    weighted: bool = True,
) -> LayerUpdate:
    """SVSF with a fixed boundary layer (eqs 2.3.1-2.3.6): `layer` (m,) in the measurement's units, or `sigmas`
    standard deviations of R. `measure` maps rows (k, n) -> (k, m); `angular` are the components of y that wrap.

    Raises FilterError, NotPositiveDefiniteError.
    """
    settings = Settings(FIXED, sigmas, gamma=gamma, weighted=weighted)
    return correct(state, y, measure, R, angular, settings, layer)[0]


def update_variable(
    state: State,
    y: Array,
    measure: Rows,
    R: Array,
    angular: tuple[int, ...] = (),
    *,
    limit: Array | None = None,
    sigmas: float = SIGMAS,
    gamma: float = GAMMA,
    weighted: bool = True,
) -> LayerUpdate:
    """VBL-SVSF: Kalman's gain where the optimal layer S_ii / (H P H^T)_ii (|e| + gamma |e_last|) is within `limit`
    (m,), or `sigmas` standard deviations of R; elsewhere the SVSF's gain with the limit as its layer. The optimal
    layer is wide where the prior is good, so a narrow limit throws information of the model away.

    Raises FilterError, NotPositiveDefiniteError.
    """
    settings = Settings(VARIABLE, sigmas, gamma=gamma, weighted=weighted)
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
