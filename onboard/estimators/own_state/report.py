"""The published record of our own state, and its parts."""

from typing import Any, Final

import numpy as np

from onboard.arrays import Array
from onboard.estimators.kit.reports import update_fields
from onboard.estimators.own_state.config import Config
from onboard.estimators.own_state.innovations import LAYER_SIGMAS, Innovation
from onboard.estimators.own_state.track import Posterior, Track
from onboard.geometry.rotations import euler_from_quaternion, quaternion_from_matrix
from onboard.messages import Fault, Lifecycle, MeasurementReport, Message, NavState, Vec3, Verdict
from onboard.messages.causes import Reason
from onboard.models import own_motion as model
from onboard.models.quadrotor import POSITION, RATES, VELOCITY
from onboard.ownship import StatedMotion

NAME: Final = "own_state"
FIELDS_OF_TRACK: Final = ("age", "switch_fraction", "nis_ratio", "mean", "covariance", "q_nb", "omega_b")

Reported = tuple[MeasurementReport, tuple[float, ...] | None]  # with the width of the layer


def report(message: Message, sensor: str, found: Innovation | Verdict) -> Reported:
    """Return the report of a message, by its innovation or by the verdict if it did not reach the filter."""
    head: dict[str, Any] = {"source": sensor, "t_ns": message.t_ns, "t_recv_ns": message.t_recv_ns}
    if isinstance(found, Verdict):
        return MeasurementReport(**head, verdict=found), None
    measurement, update = found.measurement, found.update
    reported = MeasurementReport(
        **head,
        verdict=Verdict.FUSED if found.fused else Verdict.GATED,
        components=measurement.components,
        units=measurement.units,
        measured=tuple((update.predicted + update.innovation).tolist()),
        **update_fields(update),
    )
    return reported, tuple((LAYER_SIGMAS * found.sigma).tolist())


def nav_state(
    track: Track | None,
    reported: Reported | None,
    *,
    config: Config,
    sequence: int,
    t_ns: int,
    life: tuple[Lifecycle, Reason],
    resets: int,
    origin: Vec3 | None,
    faults: tuple[Fault, ...],
) -> NavState:
    """Return the record at a time. `reported` is the newest measurement."""
    measurement, layer = reported if reported is not None else (None, None)
    state, (cause, reason) = life
    valid = track is not None and state.is_valid
    return NavState(
        name=NAME,
        target=NAME,
        sequence=sequence,
        state=state,
        valid=valid,
        cause=cause,
        reason=reason,
        frame="n",
        components=model.COMPONENTS,
        units=model.UNITS,
        reset_count=resets,
        measurement=measurement,
        origin=origin,
        layer=layer,
        quality=_quality(track, t_ns, config) if track is not None and valid else -1,
        faults=faults,
        **_of_track(track, t_ns, config),
    )


def own_motion(posterior: Posterior) -> StatedMotion:
    """Return the belief at a time as our own motion."""
    _, R_na, (x, P) = posterior
    w, a, b, c = quaternion_from_matrix(R_na @ model.rotations(x[None])[0]).tolist()
    sigma = np.sqrt(np.diag(model.navigation_covariance(P, x)))
    p, q, r = x[list(RATES)].tolist()
    return StatedMotion(
        (w, a, b, c),
        (p, q, r),
        _vec3(sigma[6:9]),
        _vec3(x[list(POSITION)]),
        _vec3(x[list(VELOCITY)]),
        _vec3(sigma[3:6]),
    )


def _vec3(v: Array) -> Vec3:
    x, y, z = v.tolist()
    return x, y, z


def _of_track(track: Track | None, t_ns: int, config: Config) -> dict[str, Any]:
    """Return the fields that the track determines; all but the time are None without one."""
    if track is None:
        return {"t_ns": t_ns, **dict.fromkeys(FIELDS_OF_TRACK)}
    at_ns, R_na, (x, P) = track.posterior_at(t_ns)
    R_nb = R_na @ model.rotations(x[None])[0]
    q = quaternion_from_matrix(R_nb)
    omega = x[list(RATES)]
    pose = (*x[list(POSITION)].tolist(), *x[list(VELOCITY)].tolist(), *euler_from_quaternion(q))
    covariance = model.navigation_covariance(P, x) + _attitude_error(R_nb, config)
    return {
        "t_ns": at_ns,
        "age": track.age(t_ns),
        "switch_fraction": track.counts.switch_fraction,
        "nis_ratio": track.counts.nis_ratio,
        "mean": (*pose, *omega.tolist()),
        "covariance": tuple(tuple(row) for row in (0.5 * (covariance + covariance.T)).tolist()),
        "q_nb": tuple(q.tolist()),
        "omega_b": tuple(omega.tolist()),
    }


def _attitude_error(R_nb: Array, config: Config) -> Array:
    """Return the covariance (12, 12) of a constant error of the autopilot's attitude.

    No number of messages averages it out.
    """
    tilt, yaw = np.radians([config.own_tilt_sigma_deg, config.own_yaw_sigma_deg]) ** 2
    covariance = np.zeros((12, 12))
    covariance[6:9, 6:9] = R_nb.T @ np.diag([tilt, tilt, yaw]) @ R_nb
    return covariance


def _quality(track: Track, t_ns: int, config: Config) -> int:
    """Return the share of explained measurements, per cent.

    It is reduced with the time since the last fix.
    """
    explained = 1.0 - (track.counts.switch_fraction or 0.0)
    fresh = 1.0 - max(track.age(t_ns) - config.coast_after_s, 0.0) / max(config.validity_timeout_s, 1e-9)
    return max(round(100 * explained * max(fresh, 0.0)), 1)
