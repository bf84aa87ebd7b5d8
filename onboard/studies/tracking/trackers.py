"""The filters that the tracker papers compare, each with all its settings, over batches of runs."""

from collections.abc import Callable
from typing import Final

from onboard.filters import extended, posterior_linearisation, square_root, unscented
from onboard.filters.belief import Belief, Update, Weights
from onboard.filters.cubature import weights as cubature_weights
from onboard.studies.tracking.batch import Tracker


def centred(n: int) -> Weights:
    """The unscented filter's weights with none at the centre: sqrt(n) apart, the cubature filter's points."""
    return cubature_weights(n)


def sigma_point_tracker(name: str, label: str, rule: Callable[[int], Weights]) -> Tracker:
    """The unscented filter with the weights `rule(n)` for n states."""
    return Tracker(
        name,
        label,
        Belief,
        lambda state, process, Q: unscented.predict(state, process, Q, rule(state.mean.shape[-1])),
        lambda state, s: unscented.update(
            state, s.y, s.measure, s.R, rule(state.mean.shape[-1]), angular=s.angular
        ),
        lambda state: state,
    )


def _square_root_tracker(name: str, label: str, update: Callable[..., Update]) -> Tracker:
    return Tracker(
        name,
        label,
        square_root.start,
        lambda state, process, Q: square_root.predict(state, process, Q, centred(state.mean.shape[-1])),
        update,
        square_root.belief,
        lambda state: state.factor,
    )


EKF: Final = Tracker(
    "ekf",
    "EKF, symmetric",
    Belief,
    extended.predict,
    lambda state, s: extended.update(state, s.y, s.measure, s.R, s.angular, jacobian=s.jacobian),
    lambda state: state,
)
UKF: Final = sigma_point_tracker("ukf", "UKF", centred)
UKF_JULIER: Final = sigma_point_tracker("ukf-julier", "UKF, n + κ = 3", unscented.julier_weights)
SRUKF: Final = _square_root_tracker(
    "srukf",
    "square-root UKF by triangularisation",
    lambda state, s: square_root.update(state, s.y, s.measure, s.R, centred(state.mean.shape[-1]), s.angular),
)
SRUKF_JOSEPH: Final = _square_root_tracker(
    "srukf-joseph",
    "square-root UKF, Joseph form of the paper",
    lambda state, s: square_root.update_joseph(
        state, s.y, s.measure, s.R, centred(state.mean.shape[-1]), s.angular, s.jacobian
    ),
)
SRUKF_CLASSICAL: Final = _square_root_tracker(
    "srukf-classical",
    "square-root UKF, downdates",
    lambda state, s: square_root.update_classical(
        state, s.y, s.measure, s.R, centred(state.mean.shape[-1]), s.angular
    ),
)
ITERATED: Final = Tracker(
    "iplf",
    "iterated posterior linearisation",
    Belief,
    posterior_linearisation.predict,
    lambda state, s: posterior_linearisation.update(state, s.y, s.measure, s.R, s.angular),
    lambda state: state,
)
