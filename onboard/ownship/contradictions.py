"""What cannot be true together of our own motion: attitude and body rates, position and velocity, velocity and
accelerometer, and two statements about one instant.

Nothing here depends on an estimator. Each check compares two streams of the autopilot, so that one that hangs, is
wrong, or comes from another vehicle is contradicted by the other. A single step proves nothing: an autopilot may
correct itself. A contradiction that goes on does. The limits lie well above what recorded flights show, but for
those whose autopilot loses its own state (docs/fly-it.md, "What is noticed").
"""

import math
from bisect import bisect_right
from collections import deque
from collections.abc import Sequence
from operator import itemgetter
from typing import Final, NamedTuple

HOLD_NS: Final = 1_000_000_000  # own motion is in doubt for so long after a contradiction
YAW_HOLD_NS: Final = 10_000_000_000  # one that shows only while we accelerate; a turn and its reversal take less
LASTS_NS: Final = 280_000_000  # every step contradicts for so long: no correction of an autopilot, but a fault
FEWEST: Final = 4  # steps in that time
LONGEST_NS: Final = 150_000_000  # between two samples: what changed in between is not known of slower streams
RATE: Final = math.radians(3.0)  # rad/s, by which a turn may differ from the body rates ...
RATE_SHARE: Final = 0.25  # ... and this share of them
SPEED: Final = 0.5  # m/s, by which position may change otherwise than velocity says ...
SPEED_SHARE: Final = 0.2  # ... and this share of it
SAME_TURN: Final = math.radians(0.1)  # so far turned by its own rates, an attitude cannot be exactly the same
SAME_WAY: Final = 0.02  # m; so far moved by its own velocity, a position cannot be exactly the same
WINDOW_NS: Final = 1_000_000_000  # over which velocity is compared with the accelerometer, and at least this:
SHORTEST_NS: Final = 800_000_000
CHANGE: Final = 1.0  # m/s, horizontally in that time: more than an accelerometer's bias and a degree of tilt
SLOWEST_IMU_NS: Final = 60_000_000
LEAP: Final = 5.0  # m/s; a velocity that changes by more from one sample to the next ...
HARDEST: Final = 60.0  # m/s^2; ... and faster than this is wrong, unless as many samples in a row as
CONFIRM: Final = 4  # agree on it
ELSEWHERE: Final = 1.0  # m; two statements about one instant that differ more are of two sources ...
ANOTHER_WAY: Final = math.radians(3.0)  # ... or attitudes that do


class Sample(NamedTuple):
    """The last sample of a stream, as plain numbers: `x` is what is stated, `rate` how it changes."""

    t_ns: int
    x: tuple[float, ...]
    rate: tuple[float, ...]


class Run:
    """How long every step of a stream has contradicted."""

    def __init__(self) -> None:
        self._since_ns: int | None = None
        self._steps = 0

    def lasts(self, t0_ns: int, t1_ns: int, *, contradicts: bool) -> bool:
        """Whether all steps have contradicted for long enough, after the step from t0 to t1."""
        if not contradicts or t1_ns - t0_ns > LONGEST_NS:
            self._since_ns, self._steps = None, 0
            return False
        self._steps += 1
        if self._since_ns is None:
            self._since_ns = t0_ns
        return self._steps >= FEWEST and t1_ns - self._since_ns >= LASTS_NS


class Still:
    """Since when a stream has stated exactly the same, and how far it has moved meanwhile by its own rates."""

    def __init__(self) -> None:
        self._since_ns = 0
        self._moved = 0.0

    def hangs(self, before: Sample, now: Sample, by: float, limit: float) -> bool:
        """Whether the same is stated for too long, after a step in which the rates say `by`."""
        if now.x != before.x or now.t_ns - before.t_ns > LONGEST_NS:
            self._since_ns, self._moved = now.t_ns, 0.0
            return False
        self._moved += by
        return now.t_ns - self._since_ns >= LASTS_NS and self._moved > limit


class Contradictions:
    """The checks, fed with each sample that own motion takes. `reason(t_ns)` says what is wrong, "" if nothing."""

    def __init__(self) -> None:
        self._found: tuple[int, str] | None = None  # until when, and what
        self._attitude: Sample | None = None
        self._nav: Sample | None = None
        self._turns, self._moves, self._same_q, self._same_r = Run(), Run(), Still(), Still()
        self._leapt: list[tuple[int, Sequence[float]]] = []  # the last velocities, if each was a leap
        self._others: deque[int] = deque(maxlen=FEWEST)  # times of statements that contradict the history
        self._imu: deque[tuple[int, float, float]] = deque()  # time, velocity gained north and east
        self._velocities: deque[Sample] = deque()

    def reason(self, t_ns: int) -> str:
        """What has contradicted itself not long before a time; "" if nothing."""
        if self._found is None or t_ns > self._found[0]:
            return ""
        return self._found[1]

    def note(self, t_ns: int, what: str, hold_ns: int = HOLD_NS) -> None:
        """A contradiction at a time; it is held for as long as nothing says that it is over."""
        until_ns = t_ns + hold_ns
        if self._found is None or until_ns >= self._found[0]:
            self._found = until_ns, what

    def add_attitude(self, t_ns: int, q_nb: Sequence[float], omega_b: Sequence[float]) -> None:
        """The next attitude: unit quaternion (4) and body rates (3), rad/s."""
        before, now = self._attitude, Sample(t_ns, tuple(q_nb), tuple(omega_b))
        self._attitude = now
        if before is None:
            return
        dt = (t_ns - before.t_ns) * 1e-9
        rates = [0.5 * (a + b) for a, b in zip(before.rate, now.rate, strict=True)]
        speed = math.hypot(*rates)
        off = math.dist([angle / dt for angle in turn(before.x, now.x)], rates)
        if self._turns.lasts(before.t_ns, t_ns, contradicts=off > RATE + RATE_SHARE * speed):
            self.note(t_ns, "attitude contradicts the body rates")
        if self._same_q.hangs(before, now, speed * dt, SAME_TURN):
            self.note(t_ns, "attitude hangs")

    def leaps(self, t_ns: int, v: Sequence[float]) -> bool:
        """Whether no aircraft can have changed to this velocity since the last sample: it is not taken then. If
        the next ones agree with it, what was taken before was wrong."""
        if self._nav is None or _is_near((self._nav.t_ns, self._nav.rate), (t_ns, v)):
            self._leapt.clear()
            return False
        if self._leapt and not _is_near(self._leapt[-1], (t_ns, v)):
            self._leapt.clear()
        self._leapt.append((t_ns, v))
        if len(self._leapt) < CONFIRM:
            return True
        self._leapt.clear()
        self.note(t_ns, "velocity has leapt")
        return False

    def add_nav(self, t_ns: int, r: Sequence[float], v: Sequence[float]) -> None:
        """The next position (3), NaN where it is not known, and velocity (3)."""
        before, now = self._nav, Sample(t_ns, tuple(r), tuple(v))
        self._nav = now
        self._compare_with_imu(now)
        if before is None or math.isnan(sum(now.x) + sum(before.x)):
            return
        dt = (t_ns - before.t_ns) * 1e-9
        mean = [0.5 * (a + b) for a, b in zip(before.rate, now.rate, strict=True)]
        speed = math.hypot(*mean)
        off = math.dist([(b - a) / dt for a, b in zip(before.x, now.x, strict=True)], mean)
        if self._moves.lasts(before.t_ns, t_ns, contradicts=off > SPEED + SPEED_SHARE * speed):
            self.note(t_ns, "position contradicts the velocity")
        if self._same_r.hangs(before, now, speed * dt, SAME_WAY):
            self.note(t_ns, "position hangs")

    def add_imu(self, t_ns: int, f_b: Sequence[float], q_nb: Sequence[float] | None) -> None:
        """Specific force (3) in b, m/s^2, and the attitude (4) then, None if it is not known."""
        last = self._imu[-1] if self._imu else None
        if q_nb is None or last is None or not 0 < t_ns - last[0] <= SLOWEST_IMU_NS:
            if last is None or t_ns > last[0]:
                self._imu.clear()
                self._imu.append((t_ns, 0.0, 0.0))
            return
        dt = (t_ns - last[0]) * 1e-9
        north, east = horizontal(q_nb, f_b)
        self._imu.append((t_ns, last[1] + north * dt, last[2] + east * dt))
        while t_ns - self._imu[0][0] > 2 * WINDOW_NS:
            self._imu.popleft()

    def add_other(self, t_ns: int, *, off: float, limit: float) -> None:
        """A statement about an instant that was stated before, `off` from it."""
        if not off > limit:
            return
        self._others.append(t_ns)
        if len(self._others) == FEWEST and abs(t_ns - self._others[0]) < WINDOW_NS:
            self.note(t_ns, "two sources state different own motion")

    def _compare_with_imu(self, now: Sample) -> None:
        """Whether velocity has changed over the window as the accelerometer says, horizontally."""
        self._velocities.append(now)
        while now.t_ns - self._velocities[0].t_ns > WINDOW_NS:
            self._velocities.popleft()
        first = self._velocities[0]
        if now.t_ns - first.t_ns < SHORTEST_NS or not self._imu:
            return
        if self._imu[0][0] > first.t_ns or now.t_ns - self._imu[-1][0] > 2 * SLOWEST_IMU_NS:
            return
        (n0, e0), (n1, e1) = self._gained(first.t_ns), self._gained(now.t_ns)
        north, east = now.rate[0] - first.rate[0], now.rate[1] - first.rate[1]
        if math.hypot(north - (n1 - n0), east - (e1 - e0)) > CHANGE:
            self.note(now.t_ns, "velocity contradicts the accelerometer", YAW_HOLD_NS)

    def _gained(self, t_ns: int) -> tuple[float, float]:
        """Velocity north and east that the accelerometer has gained at the last of its samples until a time."""
        _, north, east = self._imu[max(bisect_right(self._imu, t_ns, key=itemgetter(0)) - 1, 0)]
        return north, east


def _is_near(before: tuple[int, Sequence[float]], now: tuple[int, Sequence[float]]) -> bool:
    """Whether an aircraft can change from one velocity to the other in the time."""
    return math.dist(before[1], now[1]) < LEAP + HARDEST * (now[0] - before[0]) * 1e-9


def turn(q0: Sequence[float], q1: Sequence[float]) -> tuple[float, float, float]:
    """The rotation vector, rad in b, from one unit quaternion to the next, for small angles."""
    w0, x0, y0, z0 = q0
    w1, x1, y1, z1 = q1
    sign = 2.0 if w0 * w1 + x0 * x1 + y0 * y1 + z0 * z1 > 0.0 else -2.0
    return (
        sign * (w0 * x1 - x0 * w1 - y0 * z1 + z0 * y1),
        sign * (w0 * y1 + x0 * z1 - y0 * w1 - z0 * x1),
        sign * (w0 * z1 - x0 * y1 + y0 * x1 - z0 * w1),
    )


def horizontal(q_nb: Sequence[float], f_b: Sequence[float]) -> tuple[float, float]:
    """North and east components of a vector in b."""
    w, x, y, z = q_nb
    a, b, c = f_b
    north = (1 - 2 * (y * y + z * z)) * a + 2 * (x * y - w * z) * b + 2 * (x * z + w * y) * c
    east = 2 * (x * y + w * z) * a + (1 - 2 * (x * x + z * z)) * b + 2 * (y * z - w * x) * c
    return north, east
