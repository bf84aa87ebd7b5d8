"""The leader's absolute state at any time, from its estimate, our pose and the origin."""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from msgspec.structs import replace

from onboard.arrays import Array
from onboard.config import OwnErrors
from onboard.geometry.geodesy import geodetic_from_ned, ned_from_geodetic
from onboard.geometry.path_axes import MIN_COURSE_SPEED_M_S, acceleration_of
from onboard.messages import (
    Estimate,
    GlobalOrigin,
    GlobalPosition,
    LeaderState,
    Lifecycle,
    Message,
    Output,
    OwnPose,
    Quaternion,
    Vec3,
)
from onboard.messages.causes import Cause, Reason
from onboard.units import NS_PER_S

NAME: Final = "leader"
ORIGIN_TOLERANCE_M: Final = 20.0  # from our own positions; a more distant origin is from an earlier boot
MAX_CONVERGENCE_ERROR_M: Final = 0.2  # of local NED where we are
EARTH_RADIUS_M: Final = 6.371e6
MAX_IMAGE_AGE_S: Final = 0.3  # of the last fused image; an older one does not show that the leader is in view
WITHHELD_SIGMA_FACTOR: Final = 2.0
WITHHELD_RANGE_SIGMA_RATIO: Final = 0.35  # of the range, which such a leader leaves open
MAX_PAIR_INTERVAL_NS: Final = 100_000_000  # between the local and the global position that locate the origin

Geodetic = tuple[float, float, float]


class EstimateAndPose(NamedTuple):
    """An estimate with our own pose of about the same time."""

    estimate: Estimate
    own: OwnPose | None


class LeaderStates:
    """Predicts the leader from its estimates and our own poses, for `max_age_s` at most."""

    def __init__(self, errors: OwnErrors, max_age_s: float = 0.5) -> None:
        self._max_age_ns = round(max_age_s * NS_PER_S)
        self.q_nb: Quaternion | None = None  # our newest attitude
        self.origin: Geodetic | None = None
        self._anchor: tuple[Geodetic, Array] | None = None  # our position and r_OF_n, used far from the origin
        self.has_stated_origin = False  # GPS_GLOBAL_ORIGIN has come and agrees with our own positions
        self.delay_ns = 0  # age of our GLOBAL_POSITION_INT at its stamp
        self._own_variance = np.repeat([errors.position_sigma_m**2, errors.velocity_sigma_m_s**2], 3)
        self._own: OwnPose | None = None
        self._latest: EstimateAndPose | None = None

    def restart(self) -> None:
        """Forget clock and origin of an autopilot that has rebooted."""
        self._own = self._latest = self.origin = self._anchor = self.q_nb = None
        self.has_stated_origin = False

    def update(self, output: Output) -> None:
        """Store an output. Our own pose comes before the estimates that use it."""
        if isinstance(output, OwnPose):
            self._own, self.q_nb = output, output.q_nb
        elif output.name == NAME and output.is_primary:
            self._latest = EstimateAndPose(output, self._own)

    def receive(self, messages: Sequence[Message], system: int, component: int) -> None:
        """Learn the origin: from GPS_GLOBAL_ORIGIN, else from our own GLOBAL_POSITION_INT."""
        for m in messages:
            if (m.system, m.component) != (system, component):
                continue
            if isinstance(m, GlobalOrigin):
                self.origin, self.has_stated_origin = (m.lat_deg, m.lon_deg, m.alt_msl), True
            elif isinstance(m, GlobalPosition):
                self._check_origin(m)

    def _check_origin(self, m: GlobalPosition) -> None:
        own = self._own
        t_ns = m.t_ns - self.delay_ns
        if own is None or abs(t_ns - own.t_ns) > MAX_PAIR_INTERVAL_NS or own.r_OF_n[0] is None:
            return
        r, _ = _extrapolate(own, t_ns)
        ours, error = (m.lat_deg, m.lon_deg, m.alt_msl), _convergence_error(m.lat_deg, r)
        if self.has_stated_origin and self.origin is not None:
            apart = ned_from_geodetic(ours, self.origin) - r
            if float(np.abs(apart).max()) <= ORIGIN_TOLERANCE_M + 2.0 * error:
                self._anchor = None if error < MAX_CONVERGENCE_ERROR_M else (ours, r)
                return
            self.has_stated_origin = False
        self.origin, self._anchor = geodetic_from_ned(-r, ours), (ours, r)

    def at(self, t_ns: int, t_host_ns: int) -> LeaderState | None:
        """Return the leader at a time on the boot clock; None before the first estimate."""
        return None if self._latest is None else self._predict(*self._latest, t_ns, t_host_ns)

    def _predict(self, e: Estimate, own: OwnPose | None, t_ns: int, t_host_ns: int) -> LeaderState:
        """Predict an estimate to a time.

        A withheld estimate of a leader in the image stays invalid and has wider sigmas."""
        r_F, v_F = _extrapolate(own, e.t_ns)
        why = None if e.valid else Reason(e.cause, e.reason)
        has_place = bool(np.isfinite(r_F).all() and np.isfinite(v_F).all())
        if not has_place:
            why = why or Reason(Cause.OWN_MOTION_UNKNOWN, "our own position is not known")
        is_silent = t_ns - e.t_ns > self._max_age_ns
        if is_silent:
            words = f"no own motion for {(t_ns - e.t_ns) / NS_PER_S:.1f} s: not predicted further"
            why = why or Reason(Cause.SILENT, words)
        t_ns = max(t_ns, e.t_ns)
        state = e.state if why is None or not e.valid else Lifecycle.LOST
        cause, words = why or Reason(e.cause, e.reason)
        made = LeaderState(
            t_ns=t_ns,
            t_host_ns=t_host_ns,
            sequence=e.sequence,
            state=state,
            valid=why is None,
            cause=cause,
            reason=words,
        )
        is_seen = e.valid or (e.age is not None and e.age < MAX_IMAGE_AGE_S)
        if not (has_place and is_seen) or is_silent or e.mean is None or e.covariance is None:
            return replace(made, valid=False)
        if not e.valid:
            e = _inflate_sigmas(e)
        dt = (t_ns - e.t_ns) / NS_PER_S
        mean, P = np.array(e.mean), np.array(e.covariance)[:6, :6]
        v_L = v_F + mean[3:6]
        a_L = acceleration(e, v_L)
        r_L = r_F + mean[:3] + dt * v_L + 0.5 * dt * dt * a_L
        v_L = v_L + dt * a_L
        F = np.eye(6)
        F[:3, 3:] = dt * np.eye(3)
        relative = (F @ P @ F.T)[:3, :3]
        P = F @ (P + np.diag(self._own_variance)) @ F.T
        made = replace(
            made,
            r_OL_n=as_vec3(r_L),
            v_L_n=as_vec3(v_L),
            a_L_n=as_vec3(a_L),
            covariance=_as_rows(P),
            r_FL_n=as_vec3(r_L - _extrapolate(self._own, t_ns)[0]),
            r_FL_covariance=_as_rows(relative),
            size=float(mean[e.components.index("size")]) if "size" in e.components else None,
            age=None if e.age is None else e.age + dt,
        )
        return self.locate(made)

    def locate(self, state: LeaderState) -> LeaderState:
        """Add latitude, longitude and altitude to a state, where the origin is known.

        Far from the origin they are relative to our own position: north turns with the meridians, and each
        autopilot treats that in its own way."""
        if self.origin is None or state.r_OL_n is None:
            return state
        place, r = self._anchor or (self.origin, np.zeros(3))
        lat, lon, alt = geodetic_from_ned(np.array(state.r_OL_n) - r, place)
        return replace(state, lat_deg=lat, lon_deg=lon, alt_msl=alt)

    @property
    def latest(self) -> EstimateAndPose | None:
        """The newest estimate with our own pose of about the same time."""
        return self._latest

    def own_at(self, t_ns: int) -> tuple[Array, Array]:
        """Return our own position and velocity in n at a time; NaN where not known."""
        own = self._own
        return _extrapolate(None if own is None or t_ns - own.t_ns > self._max_age_ns else own, t_ns)


def _extrapolate(own: OwnPose | None, t_ns: int) -> tuple[Array, Array]:
    """Extrapolate our own position and velocity in n from a pose; NaN where not known."""
    if own is None:
        return np.full(3, np.nan), np.full(3, np.nan)
    dt = (t_ns - own.t_ns) / NS_PER_S
    v, a = np.array(own.v_F_n), np.array(own.a_F_n)
    r = np.array([math.nan if x is None else x for x in own.r_OF_n])
    return r + dt * v + 0.5 * dt * dt * a, v + dt * a


def acceleration(e: Estimate, v_L: Array) -> Array:
    """Return a_L_n (3,) from an estimate's components along its path (`geometry.path_axes`).

    It is zero for a leader that hovers, since that has no course.
    """
    if math.hypot(v_L[0], v_L[1]) <= MIN_COURSE_SPEED_M_S or e.mean is None:
        return np.zeros(3)
    return acceleration_of(dict(zip(e.components, e.mean, strict=True)), v_L)


def _inflate_sigmas(e: Estimate) -> Estimate:
    """Widen the sigmas of a withheld estimate."""
    if e.mean is None or e.covariance is None:
        return e
    r, P = np.array(e.mean[:3]), WITHHELD_SIGMA_FACTOR**2 * np.array(e.covariance)
    P[:3, :3] += WITHHELD_RANGE_SIGMA_RATIO**2 * np.outer(r, r)
    return replace(e, covariance=_as_rows(P))


def _convergence_error(lat_deg: float, r_OF_n: Array) -> float:
    """Error (m) of local NED where we are: meridian convergence times distance."""
    distance = math.hypot(r_OF_n[0], r_OF_n[1])
    return distance * distance * abs(math.tan(math.radians(lat_deg))) / EARTH_RADIUS_M


def as_vec3(v: Array) -> Vec3:
    """Convert a vector (3,) to the tuple of a record."""
    x, y, z = v.tolist()
    return x, y, z


def _as_rows(P: Array) -> tuple[tuple[float, ...], ...]:
    return tuple(map(tuple, (0.5 * (P + P.T)).tolist()))
