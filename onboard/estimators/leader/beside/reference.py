"""Where a leader is that broadcasts its own position, and how large it is: a Kalman filter of both.

A report is of the position, with an error that lasts (multipath, our own receiver's) and one that does not, and of
a time that is off by a lasting delay. What the camera shows is the position for a metre of wingspan. The two agree
for one size only. The lasting error is along the line of sight what a wrong size is, so how well the size becomes
known follows from how much that line turns; the camera measures the other two axes of the error directly.

State (N,): r_FL_n, v_L, a_L (Singer's model), the position's lasting error (3 each, in n), its delay in s, the
size in m, the lasting error of ranges in m, that of our own yaw, rad, which turns all that the camera shows, and
that of our own velocity (3, in n), true minus known. What the camera shows was filtered, so its other errors last
for some seconds, too: their noise is enlarged.

Our own velocity's error is a state, not noise: taken for new in each second, 0.1 m/s would displace the leader by
0.45 m in 20 s, while an error that lasts displaces it by up to 2 m. Without images, reports alone correct that.
"""

from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.filters.belief import Belief, FilterError
from onboard.filters.discretisation import Discrete, van_loan

R: Final = slice(0, 3)
V: Final = slice(3, 6)
A: Final = slice(6, 9)
BIAS: Final = slice(9, 12)
DELAY: Final = 12
SIZE: Final = 13
RANGE_BIAS: Final = 14
YAW: Final = 15
OWN_V: Final = slice(16, 19)
N: Final = 19
ACCELERATION: Final = (3.0, 3.0, 1.5)  # m/s^2, standard deviation, of aircraft that turn and brake
ACCELERATION_TIME: Final = 3.0  # s
DELAY_TIME: Final = 600.0  # s: a link's delay lasts longer than an error of GNSS
OWN_VELOCITY_TIME: Final = 20.0  # s, as the cloud's `settings`
SHOWN_LASTS: Final = 5.0  # s: correlation time of the errors of what the camera shows
OPEN: Final = 0.15  # of the range: one that is less certain for a given size is not used, but its direction
UNKNOWN: Final = 10.0  # of the range: the noise of such a range
ABOUT_DOWN: Final = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
KNOWN: Final = 0.1  # rad, of the direction: a range says nothing of a leader whose direction is known less well
ITERATIONS: Final = 3  # of an update by what the camera shows
LEAST: Final = (0.005, 0.003)  # of the range: the errors of what the camera shows, along and across, at least


class Errors(NamedTuple):
    """Standard deviations of a report's lasting errors: of its position (3,) m, with our own position's, and of
    its delay, s; the correlation time of the former, s; of our own velocity, m/s; of a range, m; and of our own
    yaw, rad, with its correlation time, s."""

    bias: Array
    delay: float
    time: float
    own_velocity: float
    range_bias: float = 0.0
    yaw: float = 0.0
    yaw_time: float = 60.0


class Shown(NamedTuple):
    """What the camera shows: r_FL_n (3,) m of a leader of `size` m, and its covariance (3, 3) for that size."""

    r: Array
    P: Array
    size: float

    @property
    def is_open(self) -> bool:
        """Whether the images leave the range open."""
        return float(self.r @ self.P @ self.r) > (OPEN * float(self.r @ self.r)) ** 2


def shown(r: Array, P: Array, size: float, size_sigma: float) -> Shown:
    """What the camera shows, from a belief of r_FL_n (3,) with covariance P (3, 3) that includes an error of the
    size: it scales the range."""
    range_ = float(np.linalg.norm(r))
    line = r / range_
    whole = float(line @ P @ line)
    along = whole - (size_sigma / size * range_) ** 2
    if along < 0.0:  # the filter has its range from elsewhere, too: nothing is known of it for a given size
        along = whole
    along = max(along, (LEAST[0] * range_) ** 2)
    flat = np.eye(3) - np.outer(line, line)
    across = flat @ P @ flat + (LEAST[1] * range_) ** 2 * flat
    return Shown(r, across + along * np.outer(line, line), size)


def of_any_range(seen: Shown) -> Shown:
    """What a camera shows whose range says nothing of the size: the direction alone."""
    return seen._replace(P=seen.P + UNKNOWN**2 * np.outer(seen.r, seen.r))


def start(errors: Errors, seen: Shown, size: float, size_sigma: float, v: Array, v_sigma: float) -> Belief:
    """The belief before the first report: what the camera shows of a leader of `size` m, which moves with v (3,)
    m/s."""
    mean, P = np.zeros(N), np.zeros((N, N))
    y = seen.r / seen.size
    mean[R], mean[V], mean[SIZE] = size * y, v, size
    P[R, R] = _usable(seen) * (size / seen.size) ** 2 * _enlarged(SHOWN_LASTS) + size_sigma**2 * np.outer(y, y)
    P[R, SIZE] = P[SIZE, R] = size_sigma**2 * y
    P[SIZE, SIZE] = size_sigma**2
    P[V, V] = v_sigma**2 * np.eye(3)
    P[A, A] = np.diag(np.square(ACCELERATION))
    P[BIAS, BIAS] = np.diag(np.square(errors.bias))
    P[DELAY, DELAY] = errors.delay**2
    P[RANGE_BIAS, RANGE_BIAS] = errors.range_bias**2
    P[YAW, YAW] = errors.yaw**2
    P[OWN_V, OWN_V] = errors.own_velocity**2 * np.eye(3)
    return Belief(mean, P)


def predict(errors: Errors, belief: Belief, dt: float, moved: Array) -> Belief:
    """The belief after `dt` seconds, in which we move by `moved` (3,) m, as far as we know."""
    if dt <= 0.0:
        return belief
    F, Q = _model(round(dt * 1e6), tuple(errors.bias.tolist()), *errors[1:])
    mean = F @ belief.mean
    mean[R] -= moved
    return Belief(mean, F @ belief.covariance @ F.T + Q)


def knows_direction(belief: Belief) -> bool:
    """Whether the direction is known. Else a range is a sphere, of which a tangent says nothing: the mean, once
    it has passed through us, would be held on the wrong side, and the size would pay for it."""
    r = belief.mean[R]
    square = float(r @ r)
    across = float(np.trace(belief.covariance[R, R])) - float(r @ belief.covariance[R, R] @ r) / max(square, 1e-9)
    return across < 2.0 * KNOWN**2 * square


def misfit(belief: Belief, seen: Shown, since: float) -> float:
    """The NIS of the place that the camera shows, `since` seconds after it was used last."""
    x, y, turned = belief.mean, seen.r / seen.size, ABOUT_DOWN @ belief.mean[R]
    H = np.zeros((3, N))  # of r - size y, which is linear: no place is mirrored through us
    H[:, R], H[:, SIZE], H[:, YAW] = np.eye(3), -y, turned
    R_y = _usable(seen) * (float(x[SIZE]) / seen.size) ** 2 * _enlarged(since)
    off = x[R] - x[SIZE] * y + x[YAW] * turned
    return float(off @ np.linalg.solve(H @ belief.covariance @ H.T + R_y, off))


def see(belief: Belief, seen: Shown, since: float) -> Belief:
    """The belief after what the camera shows, `since` seconds after it was used last: r / size, linearised again
    about each correction. Not as r - size y = 0, which is linear: where y itself is the slope, its noise is taken
    for motion, and a size of nothing would explain that best. Raises FilterError."""
    y, x = seen.r / seen.size, belief.mean
    R_y = _usable(seen) / seen.size**2 * _enlarged(since)
    H, after = np.zeros((3, N)), belief
    for _ in range(ITERATIONS):
        size, turned = float(x[SIZE]), np.eye(3) + x[YAW] * ABOUT_DOWN
        predicted = turned @ x[R] / size
        H[:, R], H[:, SIZE], H[:, YAW] = turned / size, -predicted / size, ABOUT_DOWN @ x[R] / size
        after, _nis = correct(belief, H, y - predicted - H @ (belief.mean - x), R_y)
        x = after.mean
    return after


def report(belief: Belief, r: Array, v: Array, R_y: Array) -> tuple[Belief, float]:
    """The belief after a report of r_FL_n (3,) and v_L (3,) with noise R_y (6, 6), and the NIS. Raises
    FilterError."""
    H, x = np.zeros((6, N)), belief.mean
    H[:3, R] = H[:3, BIAS] = H[3:, V] = np.eye(3)
    H[:3, DELAY] = -x[V]
    predicted = np.concatenate([x[R] + x[BIAS] - x[DELAY] * x[V], x[V] - x[DELAY] * x[A]])
    return correct(belief, H, np.concatenate([r, v]) - predicted, R_y)


def measure_range(belief: Belief, distance: float, sigma: float) -> tuple[Belief, float]:
    """The belief after a range, m, with its standard deviation, and the NIS. Raises FilterError."""
    r = belief.mean[R]
    range_ = float(np.linalg.norm(r))
    H = np.zeros((1, N))
    H[0, R], H[0, RANGE_BIAS] = r / range_, 1.0
    innovation = np.array([distance - range_ - belief.mean[RANGE_BIAS]])
    return correct(belief, H, innovation, np.array([[sigma**2]]))


def size_variance(errors: Errors, belief: Belief) -> float:
    """The variance of the size, m^2, with what a lasting delay does to it.

    In a turn a delay shortens positions and velocities alike, as a smaller size does, and the filter's own
    derivatives do not show that: they hold for a straight line. So the whole of it is added, as far as the leader
    flies along the line of sight."""
    r, v, size = belief.mean[R], belief.mean[V], float(belief.mean[SIZE])
    share = errors.delay * float(r @ v) / float(r @ r)
    return float(belief.covariance[SIZE, SIZE]) + (share * size) ** 2


def with_delay(errors: Errors, belief: Belief) -> Belief:
    """The belief as it is to be published: a lasting delay moves the leader along its course."""
    P, v = belief.covariance.copy(), belief.mean[V]
    P[R, R] += errors.delay**2 * np.outer(v, v)
    P[SIZE, SIZE] = size_variance(errors, belief)
    return Belief(belief.mean, P)


def correct(belief: Belief, H: Array, innovation: Array, R_y: Array) -> tuple[Belief, float]:
    """A Kalman update in Joseph's form, and its NIS. Raises FilterError.

    The delay is considered, not estimated: see `size_variance`.
    """
    P = belief.covariance
    S = H @ P @ H.T + R_y
    try:
        K = np.linalg.solve(S, H @ P).T
        K[DELAY] = 0.0
        nis = float(innovation @ np.linalg.solve(S, innovation))
    except np.linalg.LinAlgError as error:
        raise FilterError("the innovation's covariance is singular") from error
    mean = belief.mean + K @ innovation
    left = np.eye(N) - K @ H
    covariance = left @ P @ left.T + K @ R_y @ K.T
    if not (np.isfinite(mean).all() and np.isfinite(covariance).all() and mean[SIZE] > 0.0):
        raise FilterError("the reference is not finite, or its size not positive")
    return Belief(mean, 0.5 * (covariance + covariance.T)), nis


def _usable(seen: Shown) -> Array:
    """The noise of what the camera shows; without its range, if the images leave that open."""
    if not seen.is_open:
        return seen.P
    return seen.P + UNKNOWN**2 * np.outer(seen.r, seen.r)


def _enlarged(since: float) -> float:
    """By how much a variance grows so that measurements of an error that lasts, `since` seconds apart, together
    count as often as they are independent."""
    return 1.0 + 2.0 * SHOWN_LASTS / max(since, 0.02)


@lru_cache(maxsize=256)
def _model(
    dt_us: int,
    bias: tuple[float, ...],
    delay: float,
    time: float,
    own_velocity: float,
    range_bias: float,
    yaw: float,
    yaw_time: float,
) -> Discrete:
    """Transition and process noise over so many microseconds."""
    M, W = np.zeros((N, N)), np.zeros((N, N))
    M[R, V] = M[V, A] = np.eye(3)
    M[A, A] = -np.eye(3) / ACCELERATION_TIME
    W[A, A] = np.diag(np.square(ACCELERATION)) * 2.0 / ACCELERATION_TIME
    M[BIAS, BIAS] = -np.eye(3) / time
    M[DELAY, DELAY] = -1.0 / DELAY_TIME
    W[BIAS, BIAS] = np.diag(np.square(bias)) * 2.0 / time
    W[DELAY, DELAY] = delay**2 * 2.0 / DELAY_TIME
    M[RANGE_BIAS, RANGE_BIAS] = -1.0 / time
    W[RANGE_BIAS, RANGE_BIAS] = range_bias**2 * 2.0 / time
    M[YAW, YAW] = -1.0 / yaw_time
    W[YAW, YAW] = yaw**2 * 2.0 / yaw_time
    M[R, OWN_V] = -np.eye(3)
    M[OWN_V, OWN_V] = -np.eye(3) / OWN_VELOCITY_TIME
    W[OWN_V, OWN_V] = own_velocity**2 * 2.0 / OWN_VELOCITY_TIME * np.eye(3)
    F, Q = van_loan(M, W, dt_us * 1e-6)
    for array in (F, Q):
        array.flags.writeable = False
    return Discrete(F, Q)
