"""The cubature smooth variable structure filter: as Al-Shabi, Gadsden & Wilkerson print it (section 3), recursive
(Gadsden, Al-Shabi, Arasaratnam & Habibi 2014), a robust form that first rejects what it later follows, and an
adaptive one that tells outliers from a wrong model.

The recursive forms are the cubature Kalman filter until |e| + gamma |e_last| of a measured quantity exceeds kappa
standard deviations of its innovation. The model is then taken to be wrong: that quantity is moved as by a layer of
zero, and moves no other measured quantity. The robust form rejects it at first, since an outlier looks the same,
and believes it once it has lasted.

Yet most of what a wrong model does stays within five deviations: it shows in innovations that keep to one side.
The adaptive form is the robust one, of a prior that is widened in those quantities by as much as explains it.

Arrays are float64 or float32, all alike, with or without a leading batch axis. Errata:
`smooth_variable_structure`.
"""

from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.filters import _smooth
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
from onboard.filters.belief import Belief, FilterError, Method, Rows
from onboard.filters.kernels.variable_structure import ADAPTIVE, FIXED, SWITCHED
from onboard.filters.smooth_variable_structure import SWITCHING

__all__ = [
    "METHODS",
    "PrintedState",
    "believed",
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
PATIENCE: Final = 3  # samples that an exceedance must last before it is followed
FADING: Final = 0.1  # share of the newest in the mean of sat(e/layer), which so remembers some ten updates


def update(
    state: SmoothState,
    y: Array,
    measure: Rows,
    R: Array,
    angular: tuple[int, ...] = (),
    *,
    kappa: float = KAPPA,
    gamma: float = GAMMA,
    weighted: bool = True,
) -> SmoothUpdate:
    """Recursive CSVSF: the cubature Kalman filter's gain within `kappa` deviations, the SVSF's outside.

    Raises FilterError, NotPositiveDefiniteError.
    """
    settings = Settings(SWITCHED, kappa, gamma=gamma, weighted=weighted)
    return correct(state, y, measure, R, angular, settings)[0]


def update_robust(
    state: SmoothState,
    y: Array,
    measure: Rows,
    R: Array,
    angular: tuple[int, ...] = (),
    *,
    kappa: float = KAPPA,
    patience: int = PATIENCE,
    gamma: float = GAMMA,
    weighted: bool = True,
) -> SmoothUpdate:
    """Robust CSVSF: as `update`, but what exceeds `kappa` deviations is rejected until it has done so for
    `patience` updates in a row.

    Raises FilterError, NotPositiveDefiniteError.
    """
    if patience < 1:
        raise FilterError(f"patience: must be at least 1, not {patience}")
    settings = Settings(SWITCHED, kappa, patience, gamma, weighted)
    return correct(state, y, measure, R, angular, settings)[0]


def update_adaptive(
    state: SmoothState,
    y: Array,
    measure: Rows,
    R: Array,
    angular: tuple[int, ...] = (),
    *,
    kappa: float = KAPPA,
    patience: int = PATIENCE,
    fading: float = FADING,
    gamma: float = GAMMA,
) -> SmoothUpdate:
    """Adaptive CSVSF: as `update_robust`, of a prior that is widened where the model is wrong.

    Of each measured quantity w is the mean of sat(e / psi) over the updates, the newest having the share `fading`,
    and psi `kappa` standard deviations of its innovation. In sliding mode the mean of the switching term, Utkin's
    equivalent control, is what the model lacks: where |w| exceeds `kappa` of the deviations that white innovations
    give it, the prior's variance of that quantity grows by (w psi)^2, the square of the persistent innovation, and
    of states that are not measured by their correlation with it. One outlier moves w by no more than `fading`.

    What this leaves below its limit, a mean five times slower finds: beyond two deviations it is added to the
    covariance that is `believed`, and not followed.

    w is the state's `switching`, a meter of the model's error: within sqrt(fading / (2 - fading)) if there is
    none. `innovation_covariance` and NIS are those of the prior before it was widened, `layer` is that after.

    Raises FilterError, NotPositiveDefiniteError.
    """
    if patience < 1:
        raise FilterError(f"patience: must be at least 1, not {patience}")
    if not 0 < fading <= 1:
        raise FilterError(f"fading: must be in (0, 1], not {fading}")
    settings = Settings(ADAPTIVE, kappa, patience, gamma, fading=fading)
    return correct(state, y, measure, R, angular, settings)[0]


# --------------------------------------------------------------------------------- as the paper prints it


class PrintedState(NamedTuple):
    """The paper's two filters, each a SmoothState: the first has a layer of zero, the second is the estimate."""

    first: SmoothState
    second: SmoothState


def start_printed(mean: Array, covariance: Array) -> PrintedState:
    """A state that has seen no measurement: mean (..., n), covariance (..., n, n).

    Raises FilterError.
    """
    state = start(mean, covariance)
    return PrintedState(state, state)


def predict_printed(state: PrintedState, process: Rows, Q: Array) -> PrintedState:
    """Time update of both filters.

    Raises FilterError, NotPositiveDefiniteError.
    """
    return PrintedState(predict(state.first, process, Q), predict(state.second, process, Q))


def update_printed(
    state: PrintedState,
    y: Array,
    measure: Rows,
    R: Array,
    angular: tuple[int, ...] = (),
    *,
    gamma: float = GAMMA,
    weighted: bool = True,
) -> SmoothUpdate:
    """Section 3: the first filter's innovation and Pzz give the second filter's layer (eq 3.1).

    Pzz comes of one cubature prediction from the first filter's posterior, which a zero layer makes anew of R at
    every update: it is not recursive. `belief` of the answer is a PrintedState, all else is the second filter's.

    Raises FilterError, NotPositiveDefiniteError.
    """
    settings = Settings(FIXED, 0.0, gamma=gamma, weighted=weighted)
    first, ratio = correct(state.first, y, measure, R, angular, settings)
    layer = np.asarray(ratio * np.abs(first.innovation))
    second, _ = correct(state.second, y, measure, R, angular, settings, layer)
    return second._replace(belief=PrintedState(first.belief, second.belief))


def believed_printed(state: PrintedState) -> Belief:
    """What the second filter believes."""
    return _smooth.believed(state.second)


FAR: Final = {
    "kalman": "a measurement five deviations off, which the problem has, is not weighed but followed or rejected"
}

METHODS: Final[tuple[Method, ...]] = (
    method("csvsf-printed", update_printed, (start_printed, predict_printed, believed_printed), SWITCHING),
    method("csvsf", update, exempt=FAR),
    method("csvsf-robust", update_robust, exempt=FAR),
    method("csvsf-adaptive", update_adaptive, exempt=FAR),
)
