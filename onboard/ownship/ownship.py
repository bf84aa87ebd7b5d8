"""Our own vehicle over the last seconds: its pose, interpolated at any time, and its motion between two times.

Attitude comes from one stream and position and velocity from another, each at its own rate and with its own
stamps; both are kept as short histories on the boot clock. Velocity is linear between two samples, so the
acceleration over a step is exactly the velocity's difference: integrated, it gives the velocity back, and no
accelerometer bias can part the two.
"""

import math
from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.geometry.rotations import matrix_of
from onboard.messages import (
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
from onboard.ownship.contradictions import ANOTHER_WAY, ELSEWHERE, Contradictions, turn
from onboard.ownship.gimbals import Gimbals
from onboard.ownship.limits import FARTHEST, FASTEST, QUICKEST, within
from onboard.ownship.turning import between, turned, unit

HISTORY_NS: Final = 5_000_000_000
MOST_KEPT: Final = 256  # ways between two times, kept for the next target
STATUS_NS: Final = 5_000_000_000  # the autopilot's word on its filter holds for so long after its arrival
UNKNOWN: Final = np.array([math.nan, math.nan, 0.0])  # added to a position that is known in height only
FALLBACK_NS: Final = 1_000_000_000  # GLOBAL_POSITION_INT serves once LOCAL_POSITION_NED is this long silent


class NavSample(NamedTuple):
    """Position from O and velocity of F, in n. A horizontal position that is not known is NaN."""

    r: Array
    v: Array


class Pose(NamedTuple):
    """Attitude, position and velocity at one time. A horizontal position that is not known is NaN."""

    R_nb: Array
    q_nb: Array
    r_OF_n: Array
    v_F_n: Array


class Step(NamedTuple):
    """`dt` seconds with no navigation sample between: F's velocity at both ends and its constant slope, in n."""

    dt: float
    v0: Array
    v1: Array
    a: Array


class Ownship:
    """Histories of attitude and navigation. `now_ns` is the newest stamp seen, before any delay is taken off:
    the time that estimates are predicted to; `samples` counts those taken, so that whoever keeps what follows from
    them knows when it is old."""

    def __init__(self, *, max_extrapolation: float) -> None:
        self.now_ns = 0
        self.samples = 0
        self.nav_times: list[int] = []
        self.gimbals = Gimbals(max_extrapolation)
        self._max_extrapolation_ns = round(max_extrapolation * 1e9)
        self._nav: list[NavSample] = []
        self._slopes: list[Array] = []  # of the velocity, between each sample and the next
        self._attitude_times: list[int] = []
        self._attitudes: list[tuple[Quaternion, Vec3]] = []
        self._last_local_ns = -FALLBACK_NS
        self._status: EstimatorStatus | None = None
        self._contradictions = Contradictions()
        self._ways: dict[tuple[int, int], Sequence[Step]] = {}  # since the last navigation sample
        self.rejected: dict[str, int] = {}

    def receive(self, message: Message, stamp_ns: int) -> bool:
        """Take one message, true at `message.t_ns` and stamped `stamp_ns` before its delay was taken off.
        True if it brought a new navigation sample."""
        if isinstance(message, Attitude):
            self._add_attitude(message, stamp_ns)
            return False
        if isinstance(message, GimbalAttitude):
            return self._reject(reason) if (reason := self.gimbals.receive(message)) else False
        if isinstance(message, Imu):
            self._contradictions.add_imu(message.t_ns, message.f_b, self._attitude_at(message.t_ns))
            return False
        if isinstance(message, LocalPosition):
            if self._status_at(message) is False:
                return self._reject("filter_has_no_velocity")
            if within(message.r_OF_n, FARTHEST) and within(
                message.v_F_n, FASTEST
            ):  # also if a global position of this stamp came first
                self._last_local_ns = max(self._last_local_ns, stamp_ns)
            return self._add_nav(message, message.r_OF_n, message.v_F_n, stamp_ns)
        if isinstance(message, GlobalPosition) and stamp_ns - self._last_local_ns > FALLBACK_NS:
            # no local origin: velocity and height are known, horizontal position is not needed
            known = self._status_at(message)
            if known is None:
                known = any(message.v_F_n)  # a filter without velocity sends zeros
            if not known:
                return self._reject("filter_has_no_velocity")
            return self._add_nav(message, (0.0, 0.0, -message.height), message.v_F_n, stamp_ns, UNKNOWN)
        return False

    def receive_status(self, status: EstimatorStatus) -> bool:
        """Take the autopilot's word on its own filter. True if the filter has a horizontal velocity."""
        self._status = status
        return status.horizontal_velocity

    def has_position(self, message: Message) -> bool:
        """Whether the autopilot's filter may have a horizontal position when a message arrives."""
        status = self._status
        return status is None or self._status_at(message) is None or status.horizontal_position

    @property
    def doubt(self) -> str:
        """What has contradicted itself within the last second, so that nothing follows from our own motion; ""
        if nothing has."""
        return self._contradictions.reason(self.now_ns)

    def pose_at(self, t_ns: int) -> Pose | None:
        """The pose at a time, interpolated; extrapolated by the newest rates for a short while after the newest
        sample; None where it is not known."""
        q = self._attitude_at(t_ns)
        nav = self._nav_at(t_ns)
        if q is None or nav is None:
            return None
        return Pose(matrix_of(q), np.array(q), nav.r, nav.v)

    def knows(self, t_ns: int) -> bool:
        """Whether pose and motion at a time are interpolated, so that nothing to come can change them."""
        return bool(
            self.nav_times
            and self._attitude_times
            and t_ns <= self.nav_times[-1]
            and t_ns <= self._attitude_times[-1]
        )

    def steps(self, t0_ns: int, t1_ns: int) -> Sequence[Step]:
        """The way from t0 to t1, cut at every navigation sample between. Many targets go the same way."""
        way = self._ways.get((t0_ns, t1_ns))
        if way is None:
            if len(self._ways) >= MOST_KEPT:
                self._ways.clear()
            way = self._ways[t0_ns, t1_ns] = tuple(self._cut(t0_ns, t1_ns))
        return way

    def _cut(self, t0_ns: int, t1_ns: int) -> Iterator[Step]:
        times = self.nav_times
        i = bisect_right(times, t0_ns) - 1  # of the last sample so far
        while t0_ns < t1_ns:
            end_ns = min(times[i + 1], t1_ns) if i + 1 < len(times) else t1_ns
            dt, near = (end_ns - t0_ns) * 1e-9, max(i, 0)
            slope = self._slope(i)
            v0 = self._nav[near].v + slope * ((t0_ns - times[near]) * 1e-9)
            yield Step(dt, v0, v0 + dt * slope, slope)
            i, t0_ns = i + 1, end_ns

    def own_pose(self, t_ns: int) -> OwnPose | None:
        """The pose as a record, to publish."""
        pose = self.pose_at(t_ns)
        if pose is None:
            return None
        a = self._slope(bisect_left(self.nav_times, t_ns) - 1)
        north, east = pose.r_OF_n[:2].tolist()
        horizontal = (north, east) if math.isfinite(north + east) else (None, None)
        return OwnPose(
            t_ns=t_ns,
            r_OF_n=(*horizontal, float(pose.r_OF_n[2])),
            v_F_n=tuple(pose.v_F_n.tolist()),
            a_F_n=tuple(a.tolist()),
            q_nb=tuple(pose.q_nb.tolist()),
        )

    def _reject(self, reason: str) -> bool:
        self.rejected[reason] = self.rejected.get(reason, 0) + 1
        return False

    def _add_attitude(self, m: Attitude, stamp_ns: int) -> bool:
        q, omega = m.q_nb, m.omega_b
        if not (within(q, 2.0) and within(omega, QUICKEST)) or sum(x * x for x in q) < 0.25:
            return self._reject("attitude_unusable")
        q = unit(q)
        if self._attitude_times and m.t_ns <= self._attitude_times[-1]:
            # ATTITUDE and ATTITUDE_QUATERNION of one instant are the same attitude: not an error
            self._compare_attitude(m.t_ns, q)
            return m.t_ns == self._attitude_times[-1] or self._reject("attitude_out_of_order")
        self.now_ns = max(self.now_ns, stamp_ns)
        self.samples += 1
        self._contradictions.add_attitude(m.t_ns, q, omega)
        self._attitude_times.append(m.t_ns)
        self._attitudes.append((q, omega))
        _trim(self._attitude_times, self._attitudes)
        return True

    def _status_at(self, message: Message) -> bool | None:
        """Whether the filter has a horizontal velocity when a message arrives; None if nothing recent says so."""
        status = self._status
        if status is None or not 0 <= message.t_recv_ns - status.t_recv_ns <= STATUS_NS:
            return None
        return status.horizontal_velocity

    def _add_nav(self, m: Message, r_n: Vec3, v_n: Vec3, stamp_ns: int, unknown: Array | float = 0.0) -> bool:
        """Take a sample. What is not known of the position is NaN in `unknown`, added after the checks."""
        if not (within(r_n, FARTHEST) and within(v_n, FASTEST)):
            return self._reject("position_unusable")
        if self.nav_times and m.t_ns <= self.nav_times[-1]:
            self._compare_position(m.t_ns, np.array(r_n) + unknown)
            return self._reject("position_out_of_order")
        if self._contradictions.leaps(m.t_ns, v_n):
            return self._reject("velocity_leaps")
        r = np.array(r_n) + unknown
        self._contradictions.add_nav(m.t_ns, r.tolist(), v_n)
        self.now_ns = max(self.now_ns, stamp_ns)
        self.samples += 1
        self._ways.clear()
        v = np.array(v_n)
        if self._nav:
            slope = (v - self._nav[-1].v) / ((m.t_ns - self.nav_times[-1]) * 1e-9)
            slope.flags.writeable = False  # many steps share it
            self._slopes.append(slope)
        self.nav_times.append(m.t_ns)
        self._nav.append(NavSample(r, v))
        _trim(self.nav_times, self._nav)
        del self._slopes[: len(self._slopes) - len(self._nav) + 1]
        return True

    def _compare_attitude(self, t_ns: int, q: Quaternion) -> None:
        """An attitude that comes late beside the history's."""
        known = self._attitude_at(t_ns)
        if known is not None:
            off = turn(known, q)
            self._contradictions.add_other(self.now_ns, off=math.hypot(*off), limit=ANOTHER_WAY)

    def _compare_position(self, t_ns: int, r: Array) -> None:
        """A position that comes late beside the history's."""
        known = self._nav_at(t_ns)
        if known is not None:
            self._contradictions.add_other(self.now_ns, off=float(np.linalg.norm(known.r - r)), limit=ELSEWHERE)

    def _attitude_at(self, t_ns: int) -> Quaternion | None:
        times = self._attitude_times
        i = bisect_left(times, t_ns)
        if i == len(times):
            if not times or t_ns - times[-1] > self._max_extrapolation_ns:
                return None
            q, omega = self._attitudes[-1]
            return turned(q, omega, (t_ns - times[-1]) * 1e-9)
        if times[i] == t_ns:
            return self._attitudes[i][0]
        if i == 0:
            return None
        fraction = (t_ns - times[i - 1]) / (times[i] - times[i - 1])
        return between(self._attitudes[i - 1][0], self._attitudes[i][0], fraction)

    def _nav_at(self, t_ns: int) -> NavSample | None:
        times = self.nav_times
        if not times or t_ns < times[0] or t_ns - times[-1] > self._max_extrapolation_ns:
            return None
        i = max(bisect_right(times, t_ns) - 1, 0)
        ahead = (t_ns - times[i]) * 1e-9
        near = self._nav[i]
        a = self._slope(i)
        if i + 1 < len(times):
            fraction = (t_ns - times[i]) / (times[i + 1] - times[i])
            r = near.r + fraction * (self._nav[i + 1].r - near.r)
        else:
            r = near.r + ahead * (near.v + 0.5 * ahead * a)
        return NavSample(r, near.v + ahead * a)

    def _slope(self, i: int) -> Array:
        """The slope of the velocity after sample i; before the first sample and after the last, the nearest."""
        return self._slopes[min(max(i, 0), len(self._slopes) - 1)] if self._slopes else np.zeros(3)


def _trim(times: list[int], values: list[Any]) -> None:
    """Forget what is older than the history, a good deal at a time."""
    if times[-1] - times[0] > 2 * HISTORY_NS:
        keep = bisect_left(times, times[-1] - HISTORY_NS)
        del times[:keep], values[:keep]
