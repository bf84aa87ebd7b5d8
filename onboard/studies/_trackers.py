"""The filters that the tracker papers compare, each with all its settings, over batches of runs."""

from collections.abc import Callable
from typing import Final

import numpy as np

from onboard.filters import extended, posterior_linearisation, square_root, unscented
from onboard.filters.belief import Belief, NotPositiveDefiniteError, Rows, Update
from onboard.filters.cubature import weights as cubature_weights
from onboard.filters.gating import normalised_squared
from onboard.geometry.rotations import Array
from onboard.studies._tracking import Sight, Tracker


def centred(n: int) -> unscented.Weights:
    """The unscented filter's weights with none at the centre: sqrt(n) apart, the cubature filter's points."""
    return cubature_weights(n)


def sigma_point_tracker(name: str, label: str, rule: Callable[[int], unscented.Weights]) -> Tracker:
    """The unscented filter with weights by the number of states."""
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


def _rooted(name: str, label: str, update: Callable[..., Update]) -> Tracker:
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
SRUKF: Final = _rooted(
    "srukf",
    "square-root UKF by triangularisation",
    lambda state, s: square_root.update(state, s.y, s.measure, s.R, centred(state.mean.shape[-1]), s.angular),
)
SRUKF_JOSEPH: Final = _rooted(
    "srukf-joseph",
    "square-root UKF, Joseph form of the paper",
    lambda state, s: square_root.update_joseph(
        state, s.y, s.measure, s.R, centred(state.mean.shape[-1]), s.angular, s.jacobian
    ),
)
SRUKF_CLASSICAL: Final = _rooted(
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


def _plain_predict(state: Belief, process: Rows, Q: Array) -> Belief:
    # differences need a scale; this covariance may have lost what it takes to give one
    scale = np.broadcast_to(1e4 * np.eye(state.mean.shape[-1]), state.covariance.shape)
    mean, F = extended.tangent(Belief(state.mean, scale), process)
    return Belief(mean, F @ state.covariance @ np.swapaxes(F, -1, -2) + Q)


def _plain_update(state: Belief, s: Sight) -> Update:
    predicted, H = extended.tangent(state, s.measure, s.jacobian, s.y, s.angular)
    innovation = s.y - predicted
    angular = list(s.angular)
    innovation[..., angular] -= 2 * np.pi * np.rint(innovation[..., angular] / (2 * np.pi))
    P, Ht = state.covariance, np.swapaxes(H, -1, -2)
    S = H @ P @ Ht + s.R
    K = P @ Ht @ np.linalg.inv(S)
    mean = state.mean + (K @ innovation[..., None])[..., 0]
    covariance = P - K @ S @ np.swapaxes(K, -1, -2)
    if not (np.einsum("...ii->...i", covariance) > 0).all():  # NaN too
        raise NotPositiveDefiniteError("covariance: a variance is not positive")
    return Update(Belief(mean, covariance), innovation, S, predicted, normalised_squared(innovation, S))


EKF_PLAIN: Final = Tracker(
    "ekf-plain",
    "EKF as printed: P − K S Kᵀ, never made symmetric",
    Belief,
    _plain_predict,
    _plain_update,
    lambda s: s,
)
