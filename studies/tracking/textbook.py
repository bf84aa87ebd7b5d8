"""Two filters as printed in textbooks, to show their failures.

They are the extended filter whose covariance is never symmetrised, and the square-root filter with rank-one
downdates (van der Merwe & Wan 2001).
"""

from typing import Final

import numpy as np

from onboard.arrays import Array
from onboard.filters import cubature, extended, kalman
from onboard.filters.belief import Belief, NotPositiveDefiniteError, Rows, Update
from onboard.filters.gating import normalised_squared
from onboard.filters.square_root import SquareRoot
from studies.tracking.batch import Measurement, Tracker
from studies.tracking.trackers import SRUKF


def _plain(state: Belief, mean: Array, F: Array, Q: Array) -> Belief:
    return Belief(mean, F @ state.covariance @ np.swapaxes(F, -1, -2) + Q)


def _plain_predict_linear(state: Belief, process: Rows, Q: Array) -> Belief:
    F, mean = kalman.affine(process, state.mean)
    return _plain(state, mean, F, Q)


def _plain_predict(state: Belief, process: Rows, Q: Array) -> Belief:
    # differences need a scale, which this covariance may no longer give: it need not be positive definite
    scale = np.broadcast_to(1e4 * np.eye(state.mean.shape[-1]), state.covariance.shape)
    mean, F = extended.tangent(Belief(state.mean, scale), process)
    return _plain(state, mean, F, Q)


def _plain_update(state: Belief, s: Measurement) -> Update:
    predicted, H = extended.tangent(state, s.measure, s.jacobian, s.y, s.angular)
    innovation = s.y - predicted
    angular = list(s.angular)
    innovation[..., angular] -= _whole_turns(innovation[..., angular])
    P, Ht = state.covariance, np.swapaxes(H, -1, -2)
    S = H @ P @ Ht + s.R
    K = P @ Ht @ np.linalg.inv(S)
    mean = state.mean + (K @ innovation[..., None])[..., 0]
    covariance = P - K @ S @ np.swapaxes(K, -1, -2)
    if not (np.einsum("...ii->...i", covariance) > 0).all():  # NaN too
        raise NotPositiveDefiniteError("covariance: a variance is not positive")
    return Update(Belief(mean, covariance), innovation, S, predicted, normalised_squared(innovation, S))


EKF_PLAIN: Final = Tracker(
    "ekf-plain", "EKF as printed: P − K S Kᵀ, never made symmetric", _plain_predict_linear, _plain_update
)
EKF_PLAIN_NONLINEAR: Final = EKF_PLAIN._replace(predict=_plain_predict)  # for processes that are not linear


def _downdated(lower: Array, x: Array) -> Array:
    """Return the factors (B, n, n) of L L^T - x x^T, for x (B, n), as mostly written.

    d^2 - x^2 is under the root. Raises NotPositiveDefiniteError.
    """
    L, x = lower.copy(), x.copy()
    for j in range(L.shape[-1]):
        square = L[:, j, j] * L[:, j, j] - x[:, j] * x[:, j]
        if not (square > 0).all():
            raise NotPositiveDefiniteError("downdate: leaves a factor that is not positive definite")
        root = np.sqrt(square)
        c, s = (root / L[:, j, j])[:, None], (x[:, j] / L[:, j, j])[:, None]
        L[:, j, j] = root
        L[:, j + 1 :, j] = (L[:, j + 1 :, j] - s * x[:, j + 1 :]) / c
        x[:, j + 1 :] = c * x[:, j + 1 :] - s * L[:, j + 1 :, j]
    return L


def _downdating_update(state: SquareRoot, s: Measurement) -> Update:
    n, m = state.mean.shape[-1], s.y.shape[-1]
    w = cubature.weights(n).other
    offsets = cubature.weights(n).spread * np.swapaxes(state.factor, 1, 2)
    points = state.mean[:, None] + np.concatenate([offsets, -offsets], axis=1)
    spread = points - state.mean[:, None]  # rounded, as the paper's X - x
    images = s.measure(points.reshape(-1, n)).reshape(len(points), -1, m)
    angular = list(s.angular)
    images[..., angular] -= _whole_turns((images - images[:, :1])[..., angular])
    predicted = np.mean(images, axis=1)
    d = images - predicted[:, None]
    S = w * np.swapaxes(d, 1, 2) @ d + s.R
    try:
        root = np.linalg.cholesky(S)
    except np.linalg.LinAlgError as error:
        raise NotPositiveDefiniteError("innovation covariance: not positive definite") from error
    K = w * np.swapaxes(spread, 1, 2) @ d @ np.linalg.inv(S)
    innovation = s.y - predicted
    innovation[..., angular] -= _whole_turns(innovation[..., angular])
    factor, U = state.factor, K @ root
    for column in range(m):
        factor = _downdated(factor, U[..., column])
    mean = state.mean + (K @ innovation[..., None])[..., 0]
    return Update(SquareRoot(mean, factor), innovation, S, predicted, normalised_squared(innovation, S))


def _whole_turns(angle: Array) -> Array:
    """The whole turns in differences of angles, rad."""
    return np.asarray(2 * np.pi * np.rint(angle / (2 * np.pi)))


SRUKF_TEXTBOOK: Final = SRUKF._replace(
    name="srukf-textbook", label="square-root UKF, downdates as textbooks write them", update=_downdating_update
)
