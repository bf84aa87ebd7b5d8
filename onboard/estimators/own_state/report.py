"""Our own state as it is published: the record and its parts."""

import math
from typing import Any, Final

import numpy as np

from onboard.arrays import Array
from onboard.estimators.own_state.config import Config
from onboard.estimators.own_state.consistency import Counts
from onboard.estimators.own_state.measurements import Measurement
from onboard.estimators.own_state.track import Outcome, Posterior
from onboard.geometry.rotations import euler_from_quaternion, quaternion_from_matrix
from onboard.messages import Fault, Lifecycle, MeasurementReport, Message, NavState, Vec3, Verdict
from onboard.models import own_motion
from onboard.models.quadrotor import POSITION, RATES, VELOCITY

NAME: Final = "own_state"

Reported = tuple[MeasurementReport, tuple[float, ...] | None]  # with the innovation's standard deviations


def refused(message: Message, sensor: str, verdict: Verdict) -> Reported:
    """The report of a message that did not reach the filter."""
    return MeasurementReport(source=sensor, t_ns=message.t_ns, t_recv_ns=message.t_recv_ns, verdict=verdict), None


def report(measurement: Measurement, outcome: Outcome | None) -> Reported:
    """A measurement's report; `outcome` is None while there is no state."""
    head: dict[str, Any] = {
        "source": measurement.sensor,
        "t_ns": measurement.t_ns,
        "t_recv_ns": measurement.t_recv_ns,
    }
    if outcome is None:
        return MeasurementReport(**head, verdict=Verdict.INITIALISING), None
    update = outcome.update
    sigma = tuple(np.sqrt(np.diag(update.innovation_covariance)).tolist())
    reported = MeasurementReport(
        **head,
        verdict=Verdict.FUSED if outcome.fused else Verdict.GATED,
        components=measurement.components,
        units=measurement.units,
        measured=tuple((update.predicted + update.innovation).tolist()),
        predicted=tuple(update.predicted.tolist()),
        innovation=tuple(update.innovation.tolist()),
        innovation_sigma=sigma,
        nis=float(update.nis),
    )
    return reported, sigma


def nav_state(
    posterior: Posterior | None,
    reported: Reported | None,
    *,
    config: Config,
    sequence: int,
    t_ns: int,
    life: tuple[Lifecycle, str],
    age: float,
    resets: int,
    origin: Vec3 | None,
    counts: Counts,
    faults: tuple[Fault, ...],
) -> NavState:
    """The record. `reported` is the newest measurement; `age` (s) is that of the newest fix."""
    measurement, sigma = reported if reported is not None else (None, None)
    state, reason = life
    valid = posterior is not None and state in (Lifecycle.TRACKING, Lifecycle.COASTING)
    return NavState(
        name=NAME,
        target=NAME,
        sequence=sequence,
        t_ns=t_ns if posterior is None else posterior.t_ns,
        state=state,
        valid=valid,
        reason=reason,
        frame="n",
        components=own_motion.COMPONENTS,
        units=own_motion.UNITS,
        age=None if math.isinf(age) else age,
        reset_count=resets,
        measurement=measurement,
        origin=origin,
        layer=None if sigma is None else tuple(config.layer_sigmas * s for s in sigma),
        switch_fraction=counts.switch_fraction,
        nis_ratio=counts.nis_ratio,
        quality=_quality(counts, age, config) if valid else -1,
        faults=faults,
        **_values(posterior, config),
    )


def _values(posterior: Posterior | None, config: Config) -> dict[str, Any]:
    """The record's mean, covariance, attitude and rates."""
    if posterior is None:
        return dict.fromkeys(("mean", "covariance", "q_nb", "omega_b"))
    x, P = posterior.belief
    R_nb = posterior.R_na @ own_motion.rotations(x[None])[0]
    q = quaternion_from_matrix(R_nb)
    omega = x[list(RATES)]
    pose = (*x[list(POSITION)].tolist(), *x[list(VELOCITY)].tolist(), *euler_from_quaternion(q))
    covariance = own_motion.navigation_covariance(P, x) + _attitude_error(R_nb, config)
    return {
        "mean": (*pose, *omega.tolist()),
        "covariance": tuple(tuple(row) for row in (0.5 * (covariance + covariance.T)).tolist()),
        "q_nb": tuple(q.tolist()),
        "omega_b": tuple(omega.tolist()),
    }


def _attitude_error(R_nb: Array, config: Config) -> Array:
    """Covariance (12, 12) of a constant error of the autopilot's attitude, which no number of messages averages
    out."""
    tilt, yaw = np.radians([config.own_tilt_sigma_deg, config.own_yaw_sigma_deg]) ** 2
    covariance = np.zeros((12, 12))
    covariance[6:9, 6:9] = R_nb.T @ np.diag([tilt, tilt, yaw]) @ R_nb
    return covariance


def _quality(counts: Counts, age: float, config: Config) -> int:
    """Per cent: the share of measurements that the filter explains, reduced with the time since the last fix."""
    explained = 1.0 - (counts.switch_fraction or 0.0)
    fresh = 1.0 - max(age - config.coast_after_s, 0.0) / max(config.validity_timeout_s, 1e-9)
    return max(round(100 * explained * max(fresh, 0.0)), 1)
