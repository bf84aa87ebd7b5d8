"""The leader in absolute terms, predicted to now: from the estimate, our own pose and the origin."""

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
ORIGIN_AGREES_M: Final = 20.0  # an origin farther from where our own positions put it is that of an earlier boot
BEND_M: Final = 0.2  # by which local NED may be off where we are, as seen from the origin
RADIUS_M: Final = 6.371e6  # of the Earth
SEEN_S: Final = 0.3  # since the last image that was fused: the leader is in the image
WITHHELD_SIGMA_FACTOR: Final = 2.0  # of an estimate that is withheld
WITHHELD_RANGE_SIGMA_RATIO: Final = 0.35  # of the range, which is open then
PAIRED_NS: Final = 100_000_000  # two messages of our own position this near in time tell where the origin is

Geodetic = tuple[float, float, float]


class EstimateAndPose(NamedTuple):
    """An estimate with our own pose of about its time."""

    estimate: Estimate
    own: OwnPose | None


class LeaderStates:
    """Joins estimates of the leader, our own poses, and where the origin is. An estimate that is older than
    `max_age_s` is not flown on."""

    def __init__(self, errors: OwnErrors, max_age_s: float = 0.5) -> None:
        self._max_age_ns = round(max_age_s * NS_PER_S)
        self.q_nb: Quaternion | None = None  # our newest attitude
        self.origin: Geodetic | None = None
        self._here: tuple[Geodetic, Array] | None = None  # our own place and r_OF_n, where the origin does not do
        self.has_stated_origin = False  # GPS_GLOBAL_ORIGIN has come and agrees with our own positions
        self.delay_ns = 0  # by which our own GLOBAL_POSITION_INT is older than its stamp
        self._own_variance = np.repeat([errors.position_sigma_m**2, errors.velocity_sigma_m_s**2], 3)
        self._own: OwnPose | None = None
        self._joined: EstimateAndPose | None = None

    def restart(self) -> None:
        """The autopilot has rebooted: its clock and its origin are new."""
        self._own = self._joined = self.origin = self._here = self.q_nb = None
        self.has_stated_origin = False

    def note(self, output: Output) -> None:
        """Take an output of the pipeline. Our own pose comes before the estimates that follow from it."""
        if isinstance(output, OwnPose):
            self._own, self.q_nb = output, output.q_nb
        elif output.name == NAME and output.is_primary:
            self._joined = EstimateAndPose(output, self._own)

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
        if own is None or abs(t_ns - own.t_ns) > PAIRED_NS or own.r_OF_n[0] is None:
            return
        r, _ = _carried(own, t_ns)
        ours, bend = (m.lat_deg, m.lon_deg, m.alt_msl), _bend(m.lat_deg, r)
        if self.has_stated_origin and self.origin is not None:
            apart = ned_from_geodetic(ours, self.origin) - r
            if float(np.abs(apart).max()) <= ORIGIN_AGREES_M + 2.0 * bend:
                self._here = None if bend < BEND_M else (ours, r)
                return
            self.has_stated_origin = False
        self.origin, self._here = geodetic_from_ned(-r, ours), (ours, r)

    def at(self, t_ns: int, t_host_ns: int) -> LeaderState | None:
        """The leader at a time on the boot clock; None before the first estimate."""
        return None if self._joined is None else self._made(*self._joined, t_ns, t_host_ns)

    def _made(self, e: Estimate, own: OwnPose | None, t_ns: int, t_host_ns: int) -> LeaderState:
        """The state of an estimate, predicted to a time. One that is withheld although the leader is in the
        image is not valid, and has wider sigmas."""
        r_F, v_F = _carried(own, e.t_ns)
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
        is_seen = e.valid or (e.age is not None and e.age < SEEN_S)
        if not (has_place and is_seen) or is_silent or e.mean is None or e.covariance is None:
            return replace(made, valid=False)
        if not e.valid:
            e = _doubted(e)
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
            covariance=_rows(P),
            r_FL_n=as_vec3(r_L - _carried(self._own, t_ns)[0]),
            r_FL_covariance=_rows(relative),
            size=float(mean[e.components.index("size")]) if "size" in e.components else None,
            age=None if e.age is None else e.age + dt,
        )
        return self.located(made)

    def located(self, state: LeaderState) -> LeaderState:
        """A state with the latitude, longitude and altitude of its position, where the origin is known. Far from
        it, where we are: north is another there, and autopilots have local NED each in its own way."""
        if self.origin is None or state.r_OL_n is None:
            return state
        place, r = self._here or (self.origin, np.zeros(3))
        lat, lon, alt = geodetic_from_ned(np.array(state.r_OL_n) - r, place)
        return replace(state, lat_deg=lat, lon_deg=lon, alt_msl=alt)

    @property
    def joined(self) -> EstimateAndPose | None:
        """The newest estimate with our own pose of about its time."""
        return self._joined

    def own_at(self, t_ns: int) -> tuple[Array, Array]:
        """Our own position and velocity in n at a time; NaN where not known, or not heard of for `max_age_s`."""
        own = self._own
        return _carried(None if own is None or t_ns - own.t_ns > self._max_age_ns else own, t_ns)


def _carried(own: OwnPose | None, t_ns: int) -> tuple[Array, Array]:
    """Our own position and velocity in n, carried on from a pose; NaN where not known."""
    if own is None:
        return np.full(3, np.nan), np.full(3, np.nan)
    dt = (t_ns - own.t_ns) / NS_PER_S
    v, a = np.array(own.v_F_n), np.array(own.a_F_n)
    r = np.array([math.nan if x is None else x for x in own.r_OF_n])
    return r + dt * v + 0.5 * dt * dt * a, v + dt * a


def acceleration(e: Estimate, v_L: Array) -> Array:
    """a_L_n (3,) of the components a_lat, a_long and a_along (`geometry.path_axes`), as far as the estimate has
    them. Zero for a leader that hovers: it has no course."""
    if math.hypot(v_L[0], v_L[1]) <= MIN_COURSE_SPEED_M_S or e.mean is None:
        return np.zeros(3)
    return acceleration_of(dict(zip(e.components, e.mean, strict=True)), v_L)


def _doubted(e: Estimate) -> Estimate:
    """A withheld estimate, with sigmas that say so."""
    if e.mean is None or e.covariance is None:
        return e
    r, P = np.array(e.mean[:3]), WITHHELD_SIGMA_FACTOR**2 * np.array(e.covariance)
    P[:3, :3] += WITHHELD_RANGE_SIGMA_RATIO**2 * np.outer(r, r)
    return replace(e, covariance=_rows(P))


def _bend(lat_deg: float, r_OF_n: Array) -> float:
    """By how much, m, the meridians turn between the origin and us, times our distance from it."""
    distance = math.hypot(r_OF_n[0], r_OF_n[1])
    return distance * distance * abs(math.tan(math.radians(lat_deg))) / RADIUS_M


def as_vec3(v: Array) -> Vec3:
    """A vector (3,) as a record has it."""
    x, y, z = v.tolist()
    return x, y, z


def _rows(P: Array) -> tuple[tuple[float, ...], ...]:
    return tuple(map(tuple, (0.5 * (P + P.T)).tolist()))
