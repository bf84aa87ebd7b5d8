"""Motion of a leader whose heading is known, as one of many particles assumes.

One image leaves the heading open, and with it the range. But if the heading is given, the rest is nearly linear:
the wing's apparent length gives the range, its slope the bank. So the heading is sampled (`particles`), and each
sample has a Gaussian over the other states, with the heading as a given number.

State (N = 14), vectors in n: r_FL (3), from the follower F to the leader L, m; v_L (3), m/s; a_L (3), m/s^2;
bank error, rad, beyond the bank that the thrust implies; tilt (2), m/s^2, north and east: what a multirotor's
thrust needs against the air, drag times the airspeed; wing scale error: the logarithm of a slow error of the
apparent length, of a heading that wobbles and of a detector that misplaces a tip; log size: the logarithm of the
wingspan, m, which is constant. Behind these may stand biases of measurements, which decay: W >= N components.

The follower's own errors are no states. An error of our velocity moves the leader's velocity alike, and one of our
attitude turns the whole scene; both are added to what is reported.
"""

from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.compiled import FILLING, FLOAT, MAKING, ROWS, VECTOR, kernel, out
from onboard.estimators.leader import assumptions as given

G: Final = 9.80665
N: Final = 14  # at least: behind these are biases of measurements
RX, RY, RZ, VX, VY, VZ, AX, AY, AZ, BANK_ERROR, TILT_NORTH, TILT_EAST, WING_SCALE_ERROR, LOG_SIZE = range(N)
POSITION: Final = slice(RX, VX)
VELOCITY: Final = slice(VX, AX)
ACCELERATION: Final = slice(AX, BANK_ERROR)
TILT: Final = slice(TILT_NORTH, WING_SCALE_ERROR)
MOTION: Final = slice(RX, AX)  # position and velocity

STEADY: Final = 0  # the regimes
ACCELERATING: Final = 1
HOVERING: Final = 2
COURSE_LOCKED: Final = 1.0  # to its course is a heading,
FREE: Final = 0.0  # or not,
UNDECIDED: Final = -1.0  # or so slow is the leader

NUMBER: Final = FLOAT
HEADINGS: Final = out(FLOAT, 1)
COVARIANCES: Final = out(FLOAT, 3)


class Noise(NamedTuple):
    """The variances that a step adds.

    `fixed` (W,); `broad`, times the square of the fraction that is seen of a wing of `usual` length (its
    logarithm, m), of a steady leader, of one that accelerates, and of one that hovers (3, N); `range_` (N,), times
    the square of the range; and that of `wing scale error` by a heading that wobbles, times the square of the
    share by which a radian shortens the wing."""

    fixed: Array
    broad: Array
    range_: Array
    wobble: float
    usual: float


class Hover(NamedTuple):
    """Decay of velocity and acceleration of a leader that hovers in one step, and the variances that it
    adds to their level components, (m/s)^2 and (m/s^2)^2."""

    velocity_decay: float
    acceleration_decay: float
    velocity: float
    acceleration: float


class Interval(NamedTuple):
    """A step of `dt` seconds, in which the follower moves by `moved` (3,) m, in n.

    The noise that it adds, what it leaves of one that hovers, and of the acceleration along the track, the bank's
    error, the wing scale error and biases: `decay` (3 + W - N,)."""

    dt: float
    moved: Array
    noise: Noise
    hover: Hover
    decay: Array


@kernel(**FILLING)
def course_of(x):
    """The course `COURSE_LEAD_TIME_S` ahead, of a leader with the mean x (N,), rad."""
    u, v = x[VX], x[VY]
    return np.arctan2(v, u) + given.COURSE_LEAD_TIME_S * (u * x[AY] - v * x[AX]) / (
        u * u + v * v + given.MIN_SPEED_SQUARED
    )


@kernel(**FILLING)
def visible2(heading, x, y, square, edge_on_visibility):
    """The square of the fraction that is seen of a level wing of a leader at (x, y).

    `square` is its range's."""
    along = np.cos(heading) * y - np.sin(heading) * x
    return max(1.0 - along * along / square, 0.0) + edge_on_visibility * edge_on_visibility


@kernel(**FILLING)
def shortens2(seen2, steep2):
    """The square of the share by which a radian of the heading shortens what is seen of a wing. `seen2` is as in
    `visible2`, `steep2` the square of the tangent of its bank: what shows for that does not depend on the
    heading."""
    length2 = seen2 + steep2
    return max(1.0 - seen2, 0.0) * seen2 / (length2 * length2)


class Transition(NamedTuple):
    """A step of `dt` seconds, half its square, the drag, what it makes of the acceleration, level (2, 2) and down,
    and what it leaves of the bank's error and of the wing scale error."""

    dt: float
    half: float
    drag: float
    t00: float
    t01: float
    t10: float
    t11: float
    down: float
    bank_error: float
    stretch: float


@kernel(**FILLING)
def _advance(S, j, side, transition):
    """One column (side 0) or row (side 1) of a covariance through the transition."""
    dt, half, drag, t00, t01, t10, t11, down, bank_error, stretch = transition
    w = S[:, j] if side == 0 else S[j]
    a, b, d = w[AX], w[AY], w[AZ]
    w[RX] += dt * w[VX] + half * a
    w[RY] += dt * w[VY] + half * b
    w[RZ] += dt * w[VZ] + half * d
    w[VX] += dt * a
    w[VY] += dt * b
    w[VZ] += dt * d
    w[TILT_NORTH] += drag * dt * a
    w[TILT_EAST] += drag * dt * b
    w[AX], w[AY], w[AZ] = t00 * a + t01 * b, t10 * a + t11 * b, down * d
    w[BANK_ERROR] *= bank_error
    w[WING_SCALE_ERROR] *= stretch


@kernel(**FILLING)
def _decay_biases(x, S, decay, fixed):
    """Let the biases decay, in place, by `decay` (W - N,), and add the variances (W,)."""
    for i in range(N, S.shape[0]):
        left = decay[i - N]
        x[i] *= left
        for j in range(S.shape[0]):
            S[i, j] *= left
        for j in range(S.shape[0]):
            S[j, i] *= left
        S[i, i] += fixed[i]


@kernel(**FILLING)
def _hover(x, S, hover, drag, bold):
    """The state of a leader that hovers after a step, in place.

    It comes to rest over ground, and tilts less."""
    v_decay, a_decay, v_variance, a_variance = hover
    v_variance, a_variance = bold * v_variance, bold * a_variance
    lost = drag * (1.0 - v_decay)
    for i in range(TILT_NORTH, WING_SCALE_ERROR):
        x[i] -= lost * x[i - TILT_NORTH + VX]
        for j in range(S.shape[0]):
            S[i, j] -= lost * S[i - TILT_NORTH + VX, j]
        for j in range(S.shape[0]):
            S[j, i] -= lost * S[j, i - TILT_NORTH + VX]
    for first, decay, variance in ((VX, v_decay, v_variance), (AX, a_decay, a_variance)):
        for i in range(first, first + 3):
            x[i] *= decay
            for j in range(S.shape[0]):
                S[i, j] *= decay
            for j in range(S.shape[0]):
                S[j, i] *= decay
            S[i, i] += variance * (1.0 if i < first + 2 else given.HOVER_HEIGHT_VARIANCE_RATIO)


@kernel(**FILLING)
def fly_on(k, particles, interval, edge_on_visibility):
    """Mean and covariance of a particle, in place, after an interval.

    Its heading turns with its course."""
    headings, _, regimes, means, P, intensities, course_locked, drags, _ = particles
    dt, moved, noise, hover, decay = interval
    fixed, broad, range_, wobble, usual = noise
    half, width = 0.5 * dt * dt, P.shape[2]
    x, S = means[k], P[k]
    u, v, a, b, drag = x[VX], x[VY], x[AX], x[AY], drags[k]
    square = x[RX] * x[RX] + x[RY] * x[RY] + x[RZ] * x[RZ]
    seen2 = visible2(headings[k], x[RX], x[RY], square, edge_on_visibility)
    mode = int(regimes[k])
    bold = np.exp(2.0 * intensities[k, 0])
    scale2 = seen2 * np.exp(2.0 * (x[LOG_SIZE] - usual))
    banks, wobbles = np.exp(2.0 * intensities[k, 1]), np.exp(2.0 * intensities[k, 2])
    speed2 = u * u + v * v
    rate = (u * b - v * a) / (speed2 + given.MIN_SPEED_SQUARED)
    aside = headings[k] - course_of(x)
    headings[k] += speed2 * speed2 / (speed2 * speed2 + given.FOLLOWING_SPEED_POWER4) * rate * dt
    turn = rate * dt * speed2 / (speed2 + given.TURN_SPEED_SQUARED)
    c, s = np.cos(turn), np.sin(turn)
    # what is along the track decays, and all of a slow leader's
    slow = 1.0 - (1.0 - decay[0]) * given.TURN_SPEED_SQUARED / (speed2 + given.TURN_SPEED_SQUARED)
    lost = (1.0 - decay[0]) / (speed2 + given.MIN_SPEED_SQUARED)
    k00, k01 = slow * (1.0 - lost * u * u), -slow * lost * u * v
    k11 = slow * (1.0 - lost * v * v)
    t00, t01 = c * k00 - s * k01, c * k01 - s * k11
    t10, t11 = s * k00 + c * k01, s * k01 + c * k11
    down = decay[0] * slow
    transition = Transition(dt, half, drag, t00, t01, t10, t11, down, decay[1], decay[2])
    for side in range(2):
        for j in range(width):
            _advance(S, j, side, transition)
    for i in range(N):
        factor2 = bold if i < BANK_ERROR else (banks if i == BANK_ERROR else 1.0)
        S[i, i] += fixed[i] + factor2 * scale2 * broad[mode, i] + square * range_[i]
        for j in range(i):
            S[i, j] = S[j, i] = 0.5 * (S[i, j] + S[j, i])
    steep = ((x[AY] + x[TILT_EAST]) * np.cos(headings[k]) - (x[AX] + x[TILT_NORTH]) * np.sin(headings[k])) / (
        G - x[AZ]
    )
    S[WING_SCALE_ERROR, WING_SCALE_ERROR] += wobbles * wobble * shortens2(seen2, steep * steep)
    for i in range(3):
        x[i] += dt * x[VX + i] + half * x[AX + i] - moved[i]
        x[VX + i] += dt * x[AX + i]
    x[TILT_NORTH] += drag * dt * a
    x[TILT_EAST] += drag * dt * b
    x[AX], x[AY], x[AZ] = t00 * a + t01 * b, t10 * a + t11 * b, down * x[AZ]
    x[BANK_ERROR] *= decay[1]
    x[WING_SCALE_ERROR] *= decay[2]
    if width > N:
        _decay_biases(x, S, decay[3:], fixed)
    if mode == HOVERING:
        _hover(x, S, hover, drag, bold)
    if course_locked[k] == COURSE_LOCKED:
        headings[k] = course_of(x) + aside


def courses(means: Array) -> Array:
    """Return the courses (K,) rad of means (K, W)."""
    u, v = means[:, VX], means[:, VY]
    found: Array = np.arctan2(v, u) + given.COURSE_LEAD_TIME_S * (u * means[:, AY] - v * means[:, AX]) / (
        u * u + v * v + given.MIN_SPEED_SQUARED
    )
    return found


def visible(headings: Array, directions: Array, edge_on_visibility: float = given.MIN_VISIBLE_FRACTION) -> Array:
    """The fraction (k,) that is seen of a level wing's length.

    Its headings are `headings` (k,), the leader in the unit `directions` (k, 3). Seen along the wing, it shows
    `edge_on_visibility` of it: a tip, or its fuselage."""
    found: Array = np.sqrt(_all_visible2(headings, directions, edge_on_visibility))
    return found


@kernel((VECTOR, ROWS, NUMBER), **MAKING)
def _all_visible2(headings, directions, edge_on_visibility):
    found = np.empty(headings.shape[0])
    for k in range(headings.shape[0]):
        found[k] = visible2(headings[k], directions[k, 0], directions[k, 1], 1.0, edge_on_visibility)
    return found
