"""The filters that the tracker papers compare, each with all its settings, over batches of runs."""

from collections.abc import Callable
from typing import Final

from onboard.filters import cubature, extended, posterior_linearisation, square_root, unscented
from onboard.filters.belief import Update, Weights
from studies.tracking.batch import Tracker


def sigma_point_tracker(name: str, label: str, rule: Callable[[int], Weights]) -> Tracker:
    """The unscented filter with the weights `rule(n)` for n states."""
    return Tracker(
        name,
        label,
        lambda state, process, Q: unscented.predict(state, process, Q, rule(state.mean.shape[-1])),
        lambda state, s: unscented.update(
            state, s.y, s.measure, s.R, rule(state.mean.shape[-1]), angular=s.angular
        ),
    )


def _square_root_tracker(name: str, label: str, update: Callable[..., Update]) -> Tracker:
    return Tracker(
        name,
        label,
        lambda state, process, Q: square_root.predict(state, process, Q, cubature.weights(state.mean.shape[-1])),
        update,
        square_root.start,
        square_root.belief,
        lambda state: state.factor,
    )


EKF: Final = Tracker(
    "ekf",
    "EKF, symmetric",
    extended.predict,
    lambda state, s: extended.update(state, s.y, s.measure, s.R, s.angular, jacobian=s.jacobian),
)
UKF: Final = sigma_point_tracker("ukf", "UKF", cubature.weights)
SRUKF: Final = _square_root_tracker(
    "srukf",
    "square-root UKF by triangularisation",
    lambda state, s: square_root.update(
        state, s.y, s.measure, s.R, cubature.weights(state.mean.shape[-1]), s.angular
    ),
)
SRUKF_JOSEPH: Final = _square_root_tracker(
    "srukf-joseph",
    "square-root UKF, Joseph form of the paper",
    lambda state, s: square_root.update_joseph(
        state, s.y, s.measure, s.R, cubature.weights(state.mean.shape[-1]), s.angular, s.jacobian
    ),
)
SRUKF_CLASSICAL: Final = _square_root_tracker(
    "srukf-classical",
    "square-root UKF, downdates",
    lambda state, s: square_root.update_classical(
        state, s.y, s.measure, s.R, cubature.weights(state.mean.shape[-1]), s.angular
    ),
)
ITERATED: Final = Tracker(
    "iplf",
    "iterated posterior linearisation",
    posterior_linearisation.predict,
    lambda state, s: posterior_linearisation.update(state, s.y, s.measure, s.R, s.angular),
)
