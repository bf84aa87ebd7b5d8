"""Pose and motion of our own vehicle over the last seconds, interpolated at any time.

Attitude comes from one stream and position and velocity from another, each at its own rate and with its own
stamps; both are kept as short histories on the boot clock (`histories`), each from its `source`.
"""

import math
from bisect import bisect_left
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.geometry.rotations import matrix_of
from onboard.messages import (
    DOUBT_PREFIX,
    Attitude,
    EstimatorStatus,
    GimbalAttitude,
    GlobalPosition,
    Imu,
    LocalPosition,
    Message,
    OwnPose,
    Quaternion,
    Vec3,
)
from onboard.messages.causes import Cause, Reason
from onboard.ownship.contradictions import ATTITUDE_TOLERANCE, POSITION_TOLERANCE, Contradictions, turn
from onboard.ownship.gimbals import Gimbals
from onboard.ownship.histories import Attitudes, AttitudeSample, Navigation, NavSample, Step
from onboard.ownship.limits import MAX_STATED_DISTANCE, MAX_STATED_RATE, MAX_STATED_SPEED, within
from onboard.ownship.reckoning import Reckoning
from onboard.ownship.source import Comparison, Source, StatedMotion, Wanted
from onboard.ownship.stated_attitude import AttitudeUncertainty
from onboard.ownship.turning import turned, unit
from onboard.units import NS_PER_S

MAX_CACHED_STEPS: Final = 256  # shared by the targets of one image
MAX_STATUS_AGE_NS: Final = 5 * NS_PER_S  # of the autopilot's report on its filter
UNKNOWN: Final = (math.nan, math.nan, 0.0)  # added to a position that is known in height only
NO_VARIANCE: Final = (0.0, 0.0, 0.0)
NO_NOISE: Final = (0.0, 0.0, 0.0)
# rad; until the noise is measured. A quiet autopilot has a tenth of it, but a track that starts with attitudes
# that are taken for exact starts with a velocity of 19 m/s.
INITIAL_ATTITUDE_NOISE: Final = (math.radians(1.5),) * 3
SPEED_TOLERANCE: Final = 1.0  # m/s; velocities of two sources that differ more are of two motions.
MIN_BIAS: Final = 0.2  # m/s of a velocity for 10 s; a sound autopilot has less.
FALLBACK_DELAY_NS: Final = NS_PER_S  # GLOBAL_POSITION_INT is used if LOCAL_POSITION_NED is silent for longer.


class Pose(NamedTuple):
    """Attitude, position and velocity at one time. An unknown horizontal position is NaN."""

    R_nb: Array
    q_nb: Array
    r_OF_n: Array
    v_F_n: Array
    attitude_noise: Array  # (3,) standard deviations of the white noise about b's axes, rad; without biases
    omega_b: Array  # rad/s


class Ownship:
    """Histories of attitude and navigation."""

    def __init__(self, *, max_extrapolation: float, source: Wanted = "autopilot") -> None:
        self.now_ns = 0  # newest stamp, before its delay is subtracted; estimates are predicted to this time
        self.samples = 0  # count of those taken, which invalidates caches
        self.gimbals = Gimbals(max_extrapolation)
        longest_ns = round(max_extrapolation * NS_PER_S)
        self._attitudes, self._nav = Attitudes(longest_ns), Navigation(longest_ns)
        self._source_of_attitude, self._source_of_velocity = Source("attitude", source), Source("velocity", source)
        is_fixed = self._source_of_attitude.is_fixed
        # What the autopilot states: the same histories, unless another source may be used.
        self._stated_attitudes = self._attitudes if is_fixed else Attitudes(longest_ns)
        self._stated_nav = self._nav if is_fixed else Navigation(longest_ns)
        self._last_local_ns = -FALLBACK_DELAY_NS
        self._status: EstimatorStatus | None = None
        self._resets: int | None = None  # the autopilot's own count
        self._uncertainty = AttitudeUncertainty()
        self._contradictions = Contradictions()
        self._reckoning = Reckoning()
        self._ways: dict[tuple[int, int], Sequence[Step]] = {}  # since the last navigation sample
        self._posed: tuple[int, int, Pose | None] | None = None  # the last pose, with its time and `samples`
        self.rejected: dict[str, int] = {}

    def receive(self, message: Message, stamp_ns: int, own: StatedMotion | None = None) -> bool:
        """Update with a message of time `message.t_ns`; return whether it has navigation.

        `stamp_ns` is its stamp before the delay was subtracted; `own` is an estimator's statement of that time.
        """
        if isinstance(message, Attitude):
            self._add_attitude(message, stamp_ns, own)
            return False
        if isinstance(message, GimbalAttitude):
            return self._reject(reason) if (reason := self.gimbals.receive(message)) else False
        if isinstance(message, Imu):
            attitude = self._attitudes.at(message.t_ns)
            self._contradictions.add_imu(message.t_ns, message.f_b, attitude.q if attitude else None)
            return False
        if isinstance(message, LocalPosition):
            if not self._has_velocity(message):
                return self._reject("filter_has_no_velocity")
            if within(message.r_OF_n, MAX_STATED_DISTANCE) and within(
                message.v_F_n, MAX_STATED_SPEED
            ):  # also if a global position of this stamp came first
                self._last_local_ns = max(self._last_local_ns, stamp_ns)
            return self._add_nav(message, message.r_OF_n, message.v_F_n, stamp_ns, own)
        if isinstance(message, GlobalPosition) and stamp_ns - self._last_local_ns > FALLBACK_DELAY_NS:
            # no local origin: velocity and height are known, horizontal position is not needed
            if not self._has_velocity(message):
                return self._reject("filter_has_no_velocity")
            return self._add_nav(message, (0.0, 0.0, -message.height), message.v_F_n, stamp_ns, own, UNKNOWN)
        return False

    def receive_status(self, status: EstimatorStatus) -> bool:
        """Update with the autopilot's filter report; return whether it may have a velocity."""
        self._uncertainty.receive(status)
        if status.resets is None:
            self._status = status
            return status.horizontal_velocity is not False
        if self._resets not in (None, status.resets):
            self._contradictions.correct(self.now_ns, "the autopilot has reset its filter")
        self._resets = status.resets
        return True

    @property
    def attitude_sigma(self) -> Vec3:
        """Sigmas of roll, pitch and yaw that the autopilot reports, rad; 0 without a report."""
        return self._uncertainty.tilt, self._uncertainty.tilt, self._uncertainty.sigma

    def has_position(self, message: Message) -> bool:
        """Whether the autopilot's filter may have a horizontal position when a message arrives."""
        status = self._recent_status(message)
        return status is None or status.horizontal_position is not False

    @property
    def doubt(self) -> str:
        """Reason to doubt our own motion, so that estimates are withheld; "" if there is none."""
        return self._contradictions.reason(self.now_ns)

    @property
    def has_misled(self) -> bool:
        """Whether the last doubt was more than one step, so that estimates since are wrong."""
        return self._contradictions.has_misled

    def pose_at(self, t_ns: int) -> Pose | None:
        """Return the interpolated pose at a time; None where it is not known.

        It is extrapolated by the newest rates for a short while after the newest sample."""
        posed = self._posed  # Several callers ask for the same time.
        if posed is None or posed[0] != t_ns or posed[1] != self.samples:
            posed = self._posed = t_ns, self.samples, self._pose_at(t_ns)
        return posed[2]

    def _pose_at(self, t_ns: int) -> Pose | None:
        attitude = self._attitudes.at(t_ns)
        nav = self._nav.at(t_ns)
        if attitude is None or nav is None:
            return None
        q, omega, noise = attitude
        arrays = map(np.array, (q, nav.r, nav.v, noise, omega))
        return Pose(matrix_of(q), *arrays)

    @property
    def nav_times(self) -> list[int]:
        """Times of the navigation samples."""
        return self._nav.times

    @property
    def attitude_noise(self) -> tuple[float, ...] | None:
        """Measured sigmas (3,) of the attitude's white noise about b's axes, rad, or None."""
        return self._contradictions.attitude_noise

    @property
    def velocity_bias(self) -> Reason | None:
        """Reason if our estimator's and the autopilot's velocities differ by more than noise."""
        bias, used = (
            self._source_of_velocity.bias,
            "ours" if self._source_of_velocity.is_own else "the autopilot's",
        )
        if bias < MIN_BIAS:
            return None
        words = f"the autopilot's velocity and ours have differed by {bias:.2f} m/s for 10 s; {used} is used"
        return Reason(Cause.OWN_MOTION_DOUBT, f"{DOUBT_PREFIX}{words}")

    @property
    def source_changes(self) -> dict[str, int]:
        """Counts of changes of the source of attitude and velocity, by source and reason."""
        return {**self._source_of_attitude.changes, **self._source_of_velocity.changes}

    @property
    def known_ns(self) -> float:
        """End of the time in which pose and motion are final, minus infinity if unknown."""
        nav, attitudes = self._nav.times, self._attitudes.times
        return min(nav[-1], attitudes[-1]) if nav and attitudes else -math.inf

    def knows(self, t_ns: int) -> bool:
        """Whether pose and motion at a time are interpolated, and final."""
        return t_ns <= self.known_ns

    def motion(self, from_ns: int, to_ns: int) -> tuple[Array, Array, Array]:
        """Return our own motion between two times, at those of the attitudes.

        Times (n,) in s, positions (n, 3), attitudes q_nb (n, 4)."""
        times, attitudes = self._attitudes.between(from_ns, to_ns)
        nav_times, nav = self._nav.between(from_ns, to_ns)
        if not times or not nav_times:
            return np.zeros(0), np.zeros((0, 3)), np.zeros((0, 4))
        t, positions = 1e-9 * np.array(times), np.array([sample.r for sample in nav])
        r = [np.interp(t, 1e-9 * np.array(nav_times), column) for column in positions.T]
        return t, np.column_stack(r), np.array([sample.q for sample in attitudes])

    def lead_ns(self, t_ns: int) -> int:
        """Return the time since the newest attitude or navigation sample, the older of both."""
        return t_ns - min((times[-1] for times in (self._nav.times, self._attitudes.times) if times), default=t_ns)

    def steps(self, t0_ns: int, t1_ns: int) -> Sequence[Step]:
        """Return the steps from t0 to t1 between navigation samples. All targets share them."""
        way = self._ways.get((t0_ns, t1_ns))
        if way is None:
            if len(self._ways) >= MAX_CACHED_STEPS:
                self._ways.clear()
            way = self._ways[t0_ns, t1_ns] = tuple(self._nav.cut(t0_ns, t1_ns))
        return way

    def own_pose(self, t_ns: int) -> OwnPose | None:
        """The pose as a record, to publish."""
        attitude, nav = self._attitudes.at(t_ns), self._nav.at(t_ns)
        if attitude is None or nav is None:
            return None
        north, east, down = nav.r
        return OwnPose(
            t_ns=t_ns,
            r_OF_n=(north, east, down) if math.isfinite(north + east) else (None, None, down),
            v_F_n=nav.v,
            a_F_n=self._nav.slope(bisect_left(self.nav_times, t_ns) - 1),
            q_nb=attitude.q,
        )

    def _reject(self, reason: str) -> bool:
        self.rejected[reason] = self.rejected.get(reason, 0) + 1
        return False

    def _add_attitude(self, m: Attitude, stamp_ns: int, own: StatedMotion | None) -> bool:
        q, omega = m.q_nb, m.omega_b
        if not (within(q, 2.0) and within(omega, MAX_STATED_RATE)) or sum(x * x for x in q) < 0.25:
            return self._reject("attitude_unusable")
        q = unit(q)
        newest_ns = self._attitudes.times[-1] if self._attitudes.times else None
        if newest_ns is not None and m.t_ns <= newest_ns:
            # ATTITUDE and ATTITUDE_QUATERNION of one instant are the same attitude, which is no error.
            self._compare_attitude(m.t_ns, q)
            return m.t_ns == newest_ns or self._reject("attitude_out_of_order")
        self.now_ns = max(self.now_ns, stamp_ns)
        self.samples += 1
        self._contradictions.add_attitude(m.t_ns, q, omega)
        stated = AttitudeSample(q, omega, NO_NOISE)
        self._attitudes.append(m.t_ns, self._select_attitude(m.t_ns, stated, own))
        if self._stated_attitudes is not self._attitudes:
            self._stated_attitudes.append(m.t_ns, stated)
        return True

    def _select_attitude(self, t_ns: int, stated: AttitudeSample, own: StatedMotion | None) -> AttitudeSample:
        """Return an attitude as its source states it, with its noise."""
        noise = self._contradictions.attitude_noise
        if own is None and self._source_of_attitude.is_fixed:
            return AttitudeSample(stated.q, stated.omega, noise or INITIAL_ATTITUDE_NOISE)
        apart = None if own is None else turn(stated.q, own.q_nb)
        sigma = NO_NOISE if own is None else own.attitude_sigma
        compared = Comparison(apart, sigma, noise, ATTITUDE_TOLERANCE)
        weight, correction = self._source_of_attitude.correction(t_ns, compared)
        x, y, z = [
            math.hypot((1.0 - weight) * a, weight * b)
            for a, b in zip(noise or INITIAL_ATTITUDE_NOISE, sigma, strict=True)
        ]
        if weight == 0.0:
            return stated._replace(noise=(x, y, z))
        omega = stated.omega if own is None or weight < 1.0 else own.omega_b
        a, b, c = correction
        return AttitudeSample(unit(turned(stated.q, (a, b, c), 1.0)), omega, (x, y, z))

    def _recent_status(self, message: Message) -> EstimatorStatus | None:
        """Return the autopilot's last report on its filter, None if too old for a message."""
        status = self._status
        is_recent = status is not None and 0 <= message.t_recv_ns - status.t_recv_ns <= MAX_STATUS_AGE_NS
        return status if is_recent else None

    def _has_velocity(self, message: LocalPosition | GlobalPosition) -> bool:
        """Whether a message's velocity is known. A filter without one sends zeros.

        Zeros in GLOBAL_POSITION_INT are unknown unless the filter reports a velocity; if its report is empty,
        all zeros are."""
        status = self._recent_status(message)
        if status is not None and status.horizontal_velocity is not None:
            return status.horizontal_velocity
        return (status is None and isinstance(message, LocalPosition)) or any(message.v_F_n)

    def _add_nav(
        self,
        m: Message,
        r_n: Vec3,
        v_n: Vec3,
        stamp_ns: int,
        own: StatedMotion | None,
        unknown: Vec3 = NO_VARIANCE,
    ) -> bool:
        """Add a sample; NaN in `unknown` is added after the checks to unknown components."""
        if not (within(r_n, MAX_STATED_DISTANCE) and within(v_n, MAX_STATED_SPEED)):
            return self._reject("position_unusable")
        r = r_n[0] + unknown[0], r_n[1] + unknown[1], r_n[2] + unknown[2]
        if self.nav_times and m.t_ns <= self.nav_times[-1]:
            self._compare_position(m.t_ns, r)
            return self._reject("position_out_of_order")
        if self._contradictions.leaps(m.t_ns, v_n):
            return self._reject("velocity_leaps")
        self._contradictions.add_nav(m.t_ns, self._reckoning.complete(m.t_ns, r, v_n), v_n)
        self.now_ns = max(self.now_ns, stamp_ns)
        self.samples += 1
        self._ways.clear()
        self._uncertainty.move(m.t_ns, v_n)
        stated = NavSample(r, v_n)
        self._nav.append(m.t_ns, self._select_navigation(m.t_ns, stated, own))
        if self._stated_nav is not self._nav:
            self._stated_nav.append(m.t_ns, stated)
        return True

    def _select_navigation(self, t_ns: int, stated: NavSample, own: StatedMotion | None) -> NavSample:
        """Return position and velocity as their source states them."""
        if own is None and self._source_of_velocity.is_fixed:
            return stated
        apart = None
        if own is not None:
            pairs = zip((*own.v_F_n, *own.r_OF_n), (*stated.v, *stated.r), strict=True)
            apart = [a - b for a, b in pairs]
        sigma = NO_NOISE if own is None else own.velocity_sigma
        compared = Comparison(apart, sigma, self._contradictions.velocity_noise, SPEED_TOLERANCE)
        weight, correction = self._source_of_velocity.correction(t_ns, compared)
        if weight == 0.0:
            return stated
        u, v, w, x, y, z = [a + b for a, b in zip((*stated.v, *stated.r), correction, strict=True)]
        return NavSample((x, y, z), (u, v, w))

    def _compare_attitude(self, t_ns: int, q: Quaternion) -> None:
        """Compare a late attitude with the history."""
        known = self._stated_attitudes.at(t_ns)
        if known is not None:
            off = turn(known.q, q)
            self._contradictions.add_other(self.now_ns, off=math.hypot(*off), limit=ATTITUDE_TOLERANCE)

    def _compare_position(self, t_ns: int, r: Vec3) -> None:
        """Compare a late position with the history."""
        known = self._stated_nav.at(t_ns)
        if known is not None:
            self._contradictions.add_other(self.now_ns, off=math.dist(known.r, r), limit=POSITION_TOLERANCE)
