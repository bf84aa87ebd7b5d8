"""The smooth variable structure filter (Habibi 2007), and with a variable boundary layer (Gadsden & Habibi 2010).

    state = start(mean, covariance)
    state = predict(state, process, Q)
    state = update(state, y, measure, R).belief

Each measured quantity is moved by s = (|e| + gamma |e_last|) sat(e / layer), with e the innovation and e_last the
residual after the update before: outside the layer by all of e and more, whatever the model said; inside less.
Of a state that is fully measured, a layer of zero repeats the measurement.

States that are not measured follow by a right inverse of H, of which there are many where m < n. By default it is
P H^T (H P H^T)^-1, which moves them by their correlation with what is measured. `weighted=False` is the paper's
C^+, which is blind to the covariance: a velocity that is not measured is then not estimated at all.

Arrays are float64 or float32, all alike, with or without a leading batch axis.

Errata of Al-Shabi, Gadsden & Wilkerson, whose equation numbers stand here: (2.3.3) divides by e, see
`_kernels_smooth.decide_into`; (2.2.4) and (2.2.8) cancel, deviations are taken from the mean; (2.2.12) adds what
must be subtracted, here it is Joseph's form.
"""

from functools import partial
from typing import Final

from onboard.arrays import Array
from onboard.filters._smooth import (
    GAMMA,
    Settings,
    SmoothState,
    SmoothUpdate,
    believed,
    correct,
    method,
    predict,
    start,
)
from onboard.filters.belief import Method, Rows
from onboard.filters.kernels.variable_structure import FIXED, VARIABLE

__all__ = ["METHODS", "SmoothState", "SmoothUpdate", "believed", "predict", "start", "update", "update_variable"]

SIGMAS: Final = 5.0  # a layer's width in standard deviations of the measurement


def update(
    state: SmoothState,
    y: Array,
    measure: Rows,
    R: Array,
    angular: tuple[int, ...] = (),
    *,
    layer: Array | None = None,
    sigmas: float = SIGMAS,
    gamma: float = GAMMA,
    weighted: bool = True,
) -> SmoothUpdate:
    """SVSF with a fixed boundary layer (eqs 2.3.1-2.3.6): `layer` (m,) in the measurement's units, or `sigmas`
    standard deviations of R. `measure` maps rows (k, n) -> (k, m); `angular` are the components of y that wrap.

    Raises FilterError, NotPositiveDefiniteError.
    """
    settings = Settings(FIXED, sigmas, gamma=gamma, weighted=weighted)
    return correct(state, y, measure, R, angular, settings, layer)[0]


def update_variable(
    state: SmoothState,
    y: Array,
    measure: Rows,
    R: Array,
    angular: tuple[int, ...] = (),
    *,
    limit: Array | None = None,
    sigmas: float = SIGMAS,
    gamma: float = GAMMA,
    weighted: bool = True,
) -> SmoothUpdate:
    """VBL-SVSF: Kalman's gain where the optimal layer S_ii / (H P H^T)_ii (|e| + gamma |e_last|) is within `limit`
    (m,), or `sigmas` standard deviations of R; elsewhere the SVSF's gain with the limit as its layer. The optimal
    layer is wide where the prior is good, so a narrow limit gives away what the model knows.

    Raises FilterError, NotPositiveDefiniteError.
    """
    settings = Settings(VARIABLE, sigmas, gamma=gamma, weighted=weighted)
    return correct(state, y, measure, R, angular, settings, limit)[0]


SWITCHING: Final = {
    "kalman": "its gain is chosen for robustness against a wrong model, and is not the optimal one"
}

METHODS: Final[tuple[Method, ...]] = (
    method("svsf", update, exempt=SWITCHING),
    method("svsf-zero-layer", partial(update, sigmas=0.0), exempt=SWITCHING),
    method(
        "vbl-svsf",
        update_variable,
        exempt=SWITCHING
        | {"consistent": "its gain depends on the innovation's size, of which its covariance takes no account"},
    ),
)
