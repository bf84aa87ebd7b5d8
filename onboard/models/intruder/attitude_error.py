"""Errors that measurements of an aircraft share: our attitude, our position, its reports.

State rows as in `onboard.models.intruder.motion`.
"""

from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.filters.belief import Belief
from onboard.models.intruder.motion import ATTITUDE_ERROR, BIAS, MotionStep

MIN_DIVISOR: Final = 1e-9  # Prevents a division by zero.


class AttitudeErrorModel(NamedTuple):
    """The attitude error as independent first-order Gauss-Markov processes along three axes.

    Attributes
    ----------
    axes
        The axes, as columns (3, 3), rad.
    variances
        Variances (3,), in units of the squared columns.
    times
        Time constants (3,), s.
    """

    axes: Array
    variances: Array
    times: Array

    @property
    def covariance(self) -> Array:
        """Covariance (3, 3) of the attitude error, rad^2."""
        return np.asarray((self.axes * self.variances) @ self.axes.T)


class ReportErrors(NamedTuple):
    """Errors of the reports of k tracks.

    Attributes
    ----------
    bias_sigma
        Standard deviation (k, 3) of their steady error, m; infinite for tracks without reports.
    attitude_covariance
        Covariance (k, 3, 3), rad, of the attitude error with the state `bias`, whose own variance is 1. It is not
        zero, since registration estimates the attitude error from the reports of the same aircraft.
    """

    bias_sigma: Array
    attitude_covariance: Array


def with_attitude_error(step: MotionStep, model: AttitudeErrorModel) -> MotionStep:
    """Return the step with the attitude error's transition and noise."""
    F, Q = step.F.copy(), step.Q.copy()
    axes, decay = model.axes, np.exp(-step.dt / model.times)
    F[ATTITUDE_ERROR, ATTITUDE_ERROR] = (axes * decay) @ np.linalg.inv(axes)
    Q[ATTITUDE_ERROR, ATTITUDE_ERROR] = (axes * (model.variances * (1.0 - decay**2))) @ axes.T
    return step._replace(F=F, Q=Q)


def with_report_errors(step: MotionStep, errors: ReportErrors, model: AttitudeErrorModel) -> MotionStep:
    """Return the step of k tracks with the attitude error and with correlated report errors.

    An aircraft's reported position does not drift with our own position, but its position relative to ours does.
    So whatever the drift adds to r_OT_n it subtracts from the bias. With independent noises, reports would seem to
    measure the drift, and a track with frequent reports would be overconfident. The same holds for the attitude
    error: echoes of an aircraft whose reports registered the radar would seem to confirm those reports.
    """
    step = with_attitude_error(step, model)
    Q = np.repeat(step.Q[None], len(errors.bias_sigma), axis=0)
    noise = step.Q[BIAS, BIAS][0, 0]
    largest = np.sqrt(step.drift * noise)  # the bias if the reports' whole error is that of our own position
    for i in range(3):
        shared = np.minimum(step.drift / errors.bias_sigma[:, i], largest)
        Q[:, i, BIAS.start + i] -= shared
        Q[:, BIAS.start + i, i] -= shared
    sigma = np.sqrt(model.variances * (1.0 - np.exp(-2.0 * step.dt / model.times)))
    both = np.sqrt(noise) * (model.axes * sigma) @ _correlations(step, errors, model)
    Q[:, ATTITUDE_ERROR, BIAS], Q[:, BIAS, ATTITUDE_ERROR] = both, np.swapaxes(both, 1, 2)
    return step._replace(Q=Q)


def _correlations(step: MotionStep, errors: ReportErrors, model: AttitudeErrorModel) -> Array:
    """Return the correlations (k, 3, 3) of the attitude error along each axis with the bias.

    They are limited by the drift's correlation, so that Q stays positive semidefinite.
    """
    sigma = np.maximum(np.sqrt(model.variances), MIN_DIVISOR)
    found = np.linalg.inv(model.axes * sigma) @ errors.attitude_covariance
    of_drift = step.drift / (errors.bias_sigma**2 * step.Q[BIAS, BIAS][0, 0])  # squared correlation with the drift
    left = 1.0 - np.minimum(of_drift, 1.0).max(axis=1)
    size = np.sum(found**2, axis=(1, 2))
    return np.asarray(found * np.sqrt(left / np.maximum(size, left + MIN_DIVISOR))[:, None, None])


def correct_attitude_error(belief: Belief, rotation: Belief) -> Belief:
    """Return beliefs (..., 15) after the attitude error is known to be `rotation`.

    `rotation` has mean (3,) and covariance (3, 3). The other states follow by their correlation with it. The mean
    of the attitude error is 0 afterwards: it is counted from `rotation`.
    """
    mean, P = belief
    own = P[..., ATTITUDE_ERROR, ATTITUDE_ERROR]
    gain = np.swapaxes(np.linalg.solve(own + 1e-16 * np.eye(3), P[..., ATTITUDE_ERROR, :]), -1, -2)
    gain[..., ATTITUDE_ERROR, :] = np.eye(3)
    after = mean + np.einsum("...ij,...j->...i", gain, rotation.mean - mean[..., ATTITUDE_ERROR])
    after[..., ATTITUDE_ERROR] = 0.0
    covariance = P + gain @ (rotation.covariance - own) @ np.swapaxes(gain, -1, -2)
    return Belief(after, 0.5 * (covariance + np.swapaxes(covariance, -1, -2)))
