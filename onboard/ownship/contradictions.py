"""Consistency checks of our own motion between streams of the autopilot.

They compare attitude with body rates, position with velocity, velocity with accelerometer, and two statements
about one instant. A stream that hangs, is wrong, or comes from another vehicle contradicts the other. One step is
a correction by the autopilot and costs `DOUBT_DURATION_NS`; a contradiction that lasts costs more. The limits lie
well above recorded flights, except those whose autopilot lost its own state (docs/fly-it.md, "Faults it detects").

Noise is learnt from each stream (`scatter`). A stream is compared over strides that are long enough for its noise
to be small compared with the limit. More noise than any such sensor has is a contradiction.
"""

import math
from bisect import bisect_right
from collections import deque
from collections.abc import Sequence
from typing import Final, NamedTuple

from onboard.ownship.scatter import AVERAGING_TIME_S, Ceiling, Scatter, VelocityNoise
from onboard.units import NS_PER_S, S_PER_NS

DOUBT_DURATION_NS: Final = NS_PER_S  # after a contradiction
# A wrong yaw shows only in accelerations, which are at most this far apart.
YAW_DOUBT_DURATION_NS: Final = 10 * NS_PER_S
MIN_FAULT_DURATION_NS: Final = 280_000_000  # Contradictions that last longer are a fault, not a correction.
MIN_STRIDE_COUNT: Final = 4  # in that time
STREAM_SIGMAS: Final = 3.0  # of a stream's own noise
MAX_STRIDE_DURATION_S: Final = 1.0  # Noisier streams are judged by their excess over the noise.
MIN_INCREMENT_COUNT: Final = 50  # With fewer, some wrong increments look like much noise.
MAX_SAMPLE_INTERVAL_NS: Final = 150_000_000  # In slower streams, changes between samples are unknown.
# Several times the noise of cheap sensors on a shaking vehicle.
MAX_ATTITUDE_NOISE: Final = Ceiling(white=math.radians(5.0), walk=0.4**2)  # rad, rad^2/s
RATE_NOISE: Final = 1.5  # rad/s
MAX_POSITION_NOISE: Final = Ceiling(white=3.0, walk=1.0**2)  # m, m^2/s
MAX_SPEED_NOISE: Final = 2.0  # m/s
DEGREES_AS_RADIANS_RATIO: Final = (math.radians(0.5), math.radians(2.0))  # of a turn to such rates: least and most
RATE_TOLERANCE: Final = math.radians(3.0)  # rad/s between attitude and body rates, plus ...
RATE_SHARE: Final = 0.25  # ... this share of the rates
SPEED_TOLERANCE: Final = 0.5  # m/s between position and velocity, plus ...
SPEED_SHARE: Final = 0.2  # ... this share of the velocity
MIN_FROZEN_ANGLE: Final = math.radians(0.1)  # turned by its rates, after which an equal attitude is frozen
MIN_FROZEN_DISTANCE: Final = 0.02  # m, moved by its velocity, after which an equal position is frozen
WINDOW_NS: Final = NS_PER_S  # in which velocity is compared with the accelerometer
MIN_WINDOW_NS: Final = 800_000_000
# m/s horizontally in WINDOW_NS; exceeds an accelerometer's bias and 1 degree of tilt.
VELOCITY_TOLERANCE: Final = 1.0
MAX_IMU_INTERVAL_NS: Final = 60_000_000
DROPPED_SAMPLE_COUNT: Final = 256  # at once, which saves time
ZERO_NOISE: Final = (0.0, 0.0, 0.0)
# A velocity is rejected if it changes by MAX_VELOCITY_STEP plus MAX_ACCELERATION times the time, or by
# VELOCITY_TOLERANCE otherwise than the accelerometer says, unless SAMPLES_TO_CONFIRM samples in a row agree on it.
MAX_VELOCITY_STEP: Final = 5.0  # m/s
MAX_ACCELERATION: Final = 60.0  # m/s^2
MAX_UNSEEN_ACCELERATION: Final = 10.0  # m/s^2 since the newest IMU sample
SAMPLES_TO_CONFIRM: Final = 4
POSITION_TOLERANCE: Final = 1.0  # m; statements about one instant that differ more are of two sources.
ATTITUDE_TOLERANCE: Final = math.radians(3.0)  # likewise


class Sample(NamedTuple):
    """The last sample of a stream, as plain numbers."""

    t_ns: int
    x: tuple[float, ...]  # the stated value
    rate: tuple[float, ...]  # (3,) its stated rate of change


class Strides:
    """Detects a stream that contradicts its own rates for long, or has too much noise."""

    def __init__(self, limit: float, share: float, ceiling: Ceiling = Ceiling()) -> None:  # noqa: B008 - frozen
        self._limit, self._share = limit, share  # tolerance of the rate, and as a share of the stated rate
        self._ceiling = ceiling
        self.scatter = Scatter(3)
        self._start_ns = self._end_ns = 0  # of the present stride
        self._sum, self._by, self._steps = [0.0, 0.0, 0.0], 0.0, 0
        self._since_ns: int | None = None  # the start of the first stride of those in a row that contradict
        self._strides = 0

    def contradict(self, t0_ns: int, t1_ns: int, e: Sequence[float], by: float) -> bool:
        """Whether all strides have contradicted for long enough, after a step from t0 to t1.

        In the step the stream has moved by `e` (3,) more than its rates say, which say a length `by`."""
        if t1_ns - t0_ns > MAX_SAMPLE_INTERVAL_NS:
            self._since_ns, self._end_ns = None, 0
            self.scatter.skip()
            return False
        if self._end_ns != t0_ns:
            self._begin(t0_ns)
        self._end_ns = t1_ns
        x, y, z = self._sum
        self._sum = [x + e[0], y + e[1], z + e[2]]
        self._by += by
        self._steps += 1
        elapsed = (t1_ns - self._start_ns) * S_PER_NS
        noise = STREAM_SIGMAS * self.scatter.deviation(self._steps) / elapsed
        self.scatter.add(e, (t1_ns - t0_ns) * S_PER_NS)
        if self.scatter.count >= MIN_INCREMENT_COUNT and self.scatter.exceeds(self._ceiling):
            return True
        contradicts = math.hypot(*self._sum) / elapsed > self._limit + self._share * self._by / elapsed + noise
        if not contradicts and noise > self._limit and elapsed < MAX_STRIDE_DURATION_S:
            return False
        start_ns = self._start_ns
        self._begin(t1_ns)
        if not contradicts:
            self._since_ns = None
            return False
        if self._since_ns is None:
            self._since_ns, self._strides = start_ns, 0
        self._strides += 1
        return self._strides >= MIN_STRIDE_COUNT and t1_ns - self._since_ns >= MIN_FAULT_DURATION_NS

    def _begin(self, t_ns: int) -> None:
        self._start_ns = self._end_ns = t_ns
        self._sum, self._by, self._steps = [0.0, 0.0, 0.0], 0.0, 0


class Still:
    """Detects a stream whose value is frozen although its own rates say that it moves."""

    def __init__(self) -> None:
        self._since_ns = 0
        self._moved = 0.0

    def hangs(self, before: Sample, now: Sample, by: float, limit: float) -> bool:
        """Whether the value is frozen for too long, after a step in which the rates say `by`."""
        if now.x != before.x or now.t_ns - before.t_ns > MAX_SAMPLE_INTERVAL_NS:
            self._since_ns, self._moved = now.t_ns, 0.0
            return False
        self._since_ns = self._since_ns or before.t_ns
        self._moved += by
        return now.t_ns - self._since_ns >= MIN_FAULT_DURATION_NS and self._moved > limit


class Gained:
    """Horizontal velocity gained by the accelerometer over the last two windows."""

    def __init__(self) -> None:
        self._times: list[int] = []
        self._sums: list[tuple[float, float]] = []
        self._first = 0  # index of the oldest that counts

    def since_newest(self, t_ns: int) -> int | None:
        """Return the time from the newest sample to another time, ns; None without a sample."""
        return t_ns - self._times[-1] if self._times else None

    @property
    def first_ns(self) -> int:
        """The time of the oldest sample."""
        return self._times[self._first]

    def begin(self, t_ns: int) -> None:
        """Start with a first sample."""
        self._times, self._sums, self._first = [t_ns], [(0.0, 0.0)], 0

    def add(self, t_ns: int, north: float, east: float) -> None:
        """Add a sample, accelerations in m/s^2."""
        times = self._times
        dt = (t_ns - times[-1]) * S_PER_NS
        before = self._sums[-1]
        times.append(t_ns)
        self._sums.append((before[0] + north * dt, before[1] + east * dt))
        while t_ns - times[self._first] > 2 * WINDOW_NS:
            self._first += 1
        if self._first >= DROPPED_SAMPLE_COUNT:
            del times[: self._first], self._sums[: self._first]
            self._first = 0

    def until(self, t_ns: int) -> tuple[float, float]:
        """Return the gain at the last sample before or at a time, or at the first sample."""
        return self._sums[max(bisect_right(self._times, t_ns, self._first) - 1, self._first)]


class Contradictions:
    """The checks, which each sample of our own motion updates."""

    def __init__(self) -> None:
        self._found: tuple[int, str] | None = None  # end of the doubt, and its reason
        self.has_misled = False  # The present or last one was more than one step: estimates since then are wrong.
        self._attitude: Sample | None = None
        self._nav: Sample | None = None
        self._turns = Strides(RATE_TOLERANCE, RATE_SHARE, MAX_ATTITUDE_NOISE)
        self._turned = self._by_rates = 0.0  # fading sums: turn along the rates, and square of the rates' turn
        self._moves = Strides(SPEED_TOLERANCE, SPEED_SHARE, MAX_POSITION_NOISE)
        # The vertical alone: a share of the way forward would hide it.
        self._climbs = Strides(SPEED_TOLERANCE, SPEED_SHARE, MAX_POSITION_NOISE)
        self._same_q, self._same_r = Still(), Still()
        self._speeds = VelocityNoise(3, MAX_SAMPLE_INTERVAL_NS)
        self._leapt: list[tuple[int, Sequence[float]]] = []  # the last velocities, if each was a jump
        # times of statements that contradict the history
        self._others: deque[int] = deque(maxlen=MIN_STRIDE_COUNT)
        self._imu = Gained()
        self._velocities: deque[Sample] = deque()

    def reason(self, t_ns: int) -> str:
        """Return the reason to doubt own motion at a time; "" if there is none."""
        if self._found is None or t_ns > self._found[0]:
            return ""
        return self._found[1]

    def note(self, t_ns: int, what: str, hold_ns: int = DOUBT_DURATION_NS, *, is_step: bool = False) -> None:
        """Start or prolong the doubt."""
        until_ns = t_ns + hold_ns
        self.has_misled = not is_step or (self.has_misled and bool(self.reason(t_ns)))
        if self._found is None or until_ns >= self._found[0]:
            self._found = until_ns, what

    @property
    def attitude_noise(self) -> tuple[float, float, float] | None:
        """Standard deviations (3,) of the attitudes' white noise about b's axes, rad, or None."""
        white = self._turns.scatter.white
        if white is None:
            return None
        (a, b, c), most = white, MAX_ATTITUDE_NOISE.white
        return min(a, most), min(b, most), min(c, most)

    @property
    def velocity_noise(self) -> tuple[float, ...] | None:
        """Standard deviations (3,) of the velocities' white noise in n, m/s, or None."""
        white = self._speeds.white
        return None if white is None else tuple([min(sigma, MAX_SPEED_NOISE) for sigma in white])

    def add_attitude(self, t_ns: int, q_nb: Sequence[float], omega_b: Sequence[float]) -> None:
        """Check the next attitude: unit quaternion (4) and body rates (3), rad/s."""
        before, now = self._attitude, Sample(t_ns, tuple(q_nb), tuple(omega_b))
        self._attitude = now
        if before is None:
            return
        dt = (t_ns - before.t_ns) * S_PER_NS
        a, b, c = _mean(before.rate, now.rate)
        speed = math.hypot(a, b, c)
        roll, pitch, yaw = turn(before.x, now.x)
        off = roll - a * dt, pitch - b * dt, yaw - c * dt
        fading = math.exp(-dt / AVERAGING_TIME_S)
        along = (roll * a + pitch * b + yaw * c) * dt
        self._turned, self._by_rates = fading * self._turned + along, fading * self._by_rates + (speed * dt) ** 2
        if self._turns.contradict(before.t_ns, t_ns, off, speed * dt):
            self.note(t_ns, "attitude contradicts the body rates" + self._likely_mistake())
        if self._same_q.hangs(before, now, speed * dt, MIN_FROZEN_ANGLE):
            self.note(t_ns, "attitude hangs")

    def _likely_mistake(self) -> str:
        """Return words for the likely mistake in body rates that contradict the attitude."""
        least, most = DEGREES_AS_RADIANS_RATIO
        in_degrees = least * self._by_rates < self._turned < most * self._by_rates
        return ": they look like degrees per second, not radians" if in_degrees else ""

    def leaps(self, t_ns: int, v: Sequence[float]) -> bool:
        """Whether no aircraft can have changed to this velocity since the last sample.

        If the next ones agree with it, the earlier samples were wrong, or the autopilot has corrected itself."""
        if self._nav is None or self._is_near((self._nav.t_ns, self._nav.rate), (t_ns, v)):
            self._leapt.clear()
            return False
        if self._leapt and not self._is_near(self._leapt[-1], (t_ns, v)):
            self._leapt.clear()
        self._leapt.append((t_ns, v))
        if len(self._leapt) < SAMPLES_TO_CONFIRM:
            return True
        self.correct(t_ns, "velocity has leapt")
        return False

    def correct(self, t_ns: int, what: str) -> None:
        """Restart the comparisons, since the autopilot has corrected its state in one step."""
        self._leapt.clear()
        self._velocities.clear()
        self._speeds.skip()
        self._nav = None
        self.note(t_ns, what, is_step=True)

    def _is_near(self, before: tuple[int, Sequence[float]], now: tuple[int, Sequence[float]]) -> bool:
        """Whether an aircraft can change from one velocity to the other in the time between.

        The accelerometer decides where it is known."""
        dt_ns = now[0] - before[0]
        if math.dist(before[1], now[1]) >= MAX_VELOCITY_STEP + MAX_ACCELERATION * dt_ns * S_PER_NS:
            return False
        # In a longer stride, a wrong yaw looks like a step.
        most_ns = WINDOW_NS if self._leapt else MAX_SAMPLE_INTERVAL_NS
        gained = self._gained(before[0], now[0]) if 0 < dt_ns <= most_ns else None
        if gained is None:
            return True
        north, east, unseen = gained
        off = math.hypot(now[1][0] - before[1][0] - north, now[1][1] - before[1][1] - east)
        return off < VELOCITY_TOLERANCE + self._change_noise + MAX_UNSEEN_ACCELERATION * unseen

    def _gained(self, from_ns: int, to_ns: int) -> tuple[float, float, float] | None:
        """Integrate the accelerometer to the velocity north and east; None if it has a gap.

        Also returns the time, s, since its newest sample.
        """
        imu = self._imu
        newest_ns = imu.since_newest(to_ns)
        if newest_ns is None or imu.first_ns > from_ns or newest_ns > 2 * MAX_IMU_INTERVAL_NS:
            return None
        (n0, e0), (n1, e1) = imu.until(from_ns), imu.until(to_ns)
        return n1 - n0, e1 - e0, max(newest_ns, 0) * S_PER_NS

    @property
    def _change_noise(self) -> float:
        """Largest difference of two velocities, m/s, that noise explains."""
        return STREAM_SIGMAS * math.sqrt(2.0) * math.hypot(*(self.velocity_noise or ZERO_NOISE)[:2])

    def add_nav(self, t_ns: int, r: Sequence[float], v: Sequence[float]) -> None:
        """Check the next position (3), NaN where it is not known, and velocity (3)."""
        before, now = self._nav, Sample(t_ns, tuple(r), tuple(v))
        self._nav = now
        self._speeds.add(t_ns, now.rate)
        self._compare_with_imu(now)
        if before is None or math.isnan(sum(now.x) + sum(before.x)):
            return
        dt = (t_ns - before.t_ns) * S_PER_NS
        u, v_, w = _mean(before.rate, now.rate)
        speed = math.hypot(u, v_, w)
        (x0, y0, z0), (x1, y1, z1) = before.x, now.x
        off = x1 - x0 - u * dt, y1 - y0 - v_ * dt, z1 - z0 - w * dt
        moves = self._moves.contradict(before.t_ns, t_ns, off, speed * dt)
        down = max(abs(w) * dt, abs(z1 - z0))
        climbs = self._climbs.contradict(before.t_ns, t_ns, (0.0, 0.0, off[2]), down)
        if moves or climbs:
            self.note(t_ns, "position contradicts the velocity")
        if self._same_r.hangs(before, now, speed * dt, MIN_FROZEN_DISTANCE):
            self.note(t_ns, "position hangs")

    def add_imu(self, t_ns: int, f_b: Sequence[float], q_nb: Sequence[float] | None) -> None:
        """Add a specific force (3) in b, m/s^2, and the attitude (4) then, None if unknown."""
        dt = self._imu.since_newest(t_ns)
        if q_nb is None or dt is None or not 0 < dt <= MAX_IMU_INTERVAL_NS:
            if dt is None or dt > 0:
                self._imu.begin(t_ns)
            return
        north, east = horizontal(q_nb, f_b)
        self._imu.add(t_ns, north, east)

    def add_other(self, t_ns: int, *, off: float, limit: float) -> None:
        """Check another statement about an instant, which differs by `off` from the first one."""
        if not off > limit:
            return
        self._others.append(t_ns)
        if len(self._others) == MIN_STRIDE_COUNT and abs(t_ns - self._others[0]) < WINDOW_NS:
            self.note(t_ns, "two sources state different own motion")

    def _compare_with_imu(self, now: Sample) -> None:
        """Compare the horizontal velocity's change in the window with the accelerometer."""
        self._velocities.append(now)
        while now.t_ns - self._velocities[0].t_ns > WINDOW_NS:
            self._velocities.popleft()
        first = self._velocities[0]
        if now.t_ns - first.t_ns < MIN_WINDOW_NS or (gained := self._gained(first.t_ns, now.t_ns)) is None:
            return
        (n, e, _), limit = gained, VELOCITY_TOLERANCE + self._change_noise
        north, east = now.rate[0] - first.rate[0], now.rate[1] - first.rate[1]
        if math.hypot(north - n, east - e) > limit:
            may_be_yaw = abs(math.hypot(north, east) - math.hypot(n, e)) < limit  # it turns what is gained
            hold_ns = YAW_DOUBT_DURATION_NS if may_be_yaw else DOUBT_DURATION_NS
            self.note(now.t_ns, "velocity contradicts the accelerometer", hold_ns)


def _mean(a: Sequence[float], b: Sequence[float]) -> tuple[float, float, float]:
    """Return the mean (3,) of two rates."""
    return 0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]), 0.5 * (a[2] + b[2])


def turn(q0: Sequence[float], q1: Sequence[float]) -> tuple[float, float, float]:
    """Return the rotation vector, rad in b, between unit quaternions, for small angles."""
    w0, x0, y0, z0 = q0
    w1, x1, y1, z1 = q1
    sign = 2.0 if w0 * w1 + x0 * x1 + y0 * y1 + z0 * z1 > 0.0 else -2.0
    return (
        sign * (w0 * x1 - x0 * w1 - y0 * z1 + z0 * y1),
        sign * (w0 * y1 + x0 * z1 - y0 * w1 - z0 * x1),
        sign * (w0 * z1 - x0 * y1 + y0 * x1 - z0 * w1),
    )


def horizontal(q_nb: Sequence[float], f_b: Sequence[float]) -> tuple[float, float]:
    """Return the north and east components of a vector in b."""
    w, x, y, z = q_nb
    a, b, c = f_b
    north = (1 - 2 * (y * y + z * z)) * a + 2 * (x * y - w * z) * b + 2 * (x * z + w * y) * c
    east = 2 * (x * y + w * z) * a + (1 - 2 * (x * x + z * z)) * b + 2 * (y * z - w * x) * c
    return north, east
