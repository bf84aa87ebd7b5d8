"""Another aircraft's motion in a Cartesian frame n, and what a radar and its own reports say of it.

State rows: [r_OT_n (3), v_T_n (3), a_T_n (3), bias (3), turned (3)], SI. The acceleration is Singer's (1970): it
fades with a time constant and is driven by white noise; gusts add to the velocity. Of an aircraft that keeps its
turn the acceleration goes round with the velocity (`moved`).

`bias` is by how much the positions that the aircraft reports of itself are steadily off (its GNSS, its altimeter,
the age of its reports), in units of what is expected of that kind of report; `turned` is the rotation (rad, about
n's axes) by which our radar sees everything turned, because our own attitude is off, or what remains of it where
others have told (`Turning`). Both are first-order Gauss-Markov processes, known apart only where an aircraft is
both heard and seen. Without them, a position that errs the same way for seconds or minutes would be averaged as if
every measurement were news.

A measurement may be older than the state: `lag` seconds, for each row. The state is then moved back as if its
acceleration were constant; what noise does in a second is small against any reported position.
"""

from typing import Any, Final, NamedTuple

import numpy as np
from numba import njit, types

from onboard.arrays import Array
from onboard.filters.belief import Belief
from onboard.filters.compiled import CUBE, ROWS, VECTOR, array
from onboard.filters.discretisation import van_loan
from onboard.geometry.arctangent import arctan2

N: Final = 15
R: Final = slice(0, 3)
V: Final = slice(3, 6)
A: Final = slice(6, 9)
BIAS: Final = slice(9, 12)
TURNED: Final = slice(12, 15)
SLOWEST: Final = 5.0  # m/s: what is slower has no turn rate to speak of ...
FASTEST_TURN: Final = 0.5  # rad/s: ... and nothing turns faster
LEAST: Final = 1e-9  # by which is divided
BLOCK: Final = 64  # rows computed at a time
COMPONENTS: Final = ("r_north", "r_east", "r_down", "v_north", "v_east", "v_down")
UNITS: Final = ("m", "m", "m", "m/s", "m/s", "m/s")
FRAME: Final = "n (local NED at our vehicle), the other aircraft relative to us"
POLAR: Final = ("range", "azimuth", "elevation")
POLAR_UNITS: Final = ("m", "rad", "rad")
POLAR_ANGULAR: Final = (1, 2)


class Noise(NamedTuple):
    """Acceleration: standard deviation on each axis (3,), m/s^2, and time constant (s), and whether it goes round
    with the velocity. Gusts: by how much velocity walks on each axis (3,), m/s per square root of a second.
    `drift`: by how much our own position does, and with it all that is measured from it, m per square root of a
    second. The time constant (s) of the bias."""

    acceleration: Array
    acceleration_time: float
    keeps_turn: bool
    gust: Array
    drift: float
    bias_time: float


class Turning(NamedTuple):
    """How `turned` goes on: along the columns of `axes` (3, 3), rad, independent Gauss-Markov processes of first
    order with these `variances` (3,) and time constants `times` (3,), s."""

    axes: Array
    variances: Array
    times: Array

    @property
    def covariance(self) -> Array:
        """(3, 3), rad^2."""
        return np.asarray((self.axes * self.variances) @ self.axes.T)


class Reports(NamedTuple):
    """What k tracks have heard: by about how much their reports are steadily off, `bias` (k, 3), m, infinity where
    there are none; and `shared` (k, 3, 3), rad, the covariance of `turned` and of the state of that, whose own is
    one, since the reports of an aircraft that is seen are among those that tell what is turned."""

    bias: Array
    shared: Array


class Step(NamedTuple):
    """What `dt` seconds do: x' = F x + noise of covariance Q, both (15, 15), or Q (k, 15, 15) of tracks that
    differ; with `keeps_turn` the acceleration turns on beside. `drift`: the variance (m^2) by which our own
    position moves in error."""

    F: Array
    Q: Array
    dt: float
    keeps_turn: bool
    drift: float


def step(dt: float, noise: Noise) -> Step:
    """The transition over `dt` > 0 seconds and its noise, but for `turned` (see `with_turning`) and reports (see
    `with_reports`).

    Raises FilterError.
    """
    fade = 1.0 / noise.acceleration_time
    axis = van_loan(
        np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -fade]]),
        np.diag([0.0, 0.0, 2.0 * fade]),
        dt,
    )
    F, Q = np.zeros((N, N)), np.zeros((N, N))
    F[:9, :9], Q[:9, :9] = np.kron(axis.F, np.eye(3)), np.kron(axis.Q, np.diag(noise.acceleration**2))
    walk = np.array([[dt**3 / 3.0, dt**2 / 2.0], [dt**2 / 2.0, dt]])
    Q[:6, :6] += np.kron(walk, np.diag(noise.gust**2))
    drift = noise.drift**2 * dt
    Q[R, R] += drift * np.eye(3)
    F[BIAS, BIAS] = np.exp(-dt / noise.bias_time) * np.eye(3)
    Q[BIAS, BIAS] = (1.0 - np.exp(-2.0 * dt / noise.bias_time)) * np.eye(3)
    return Step(F, Q, dt, noise.keeps_turn, drift)


def with_turning(step: Step, turning: Turning) -> Step:
    """The step with `turned` going on so."""
    F, Q = step.F.copy(), step.Q.copy()
    axes, fade = turning.axes, np.exp(-step.dt / turning.times)
    F[TURNED, TURNED] = (axes * fade) @ np.linalg.inv(axes)
    Q[TURNED, TURNED] = (axes * (turning.variances * (1.0 - fade**2))) @ axes.T
    return step._replace(F=F, Q=Q)


def with_reports(step: Step, reports: Reports, turning: Turning) -> Step:
    """The step of tracks that have heard reports, with `turned` going on as `turning`.

    Where an aircraft says it is does not drift with our own position. Measured from that it does, so what the
    drift adds to r_OT_n it takes from what reports are off. Were the two noises independent, reports would seem to
    tell of the drift, and a track that is often told would be too sure. It is alike with `turned`: an echo of an
    aircraft whose reports have turned the radar would seem to confirm them.
    """
    step = with_turning(step, turning)
    Q = np.repeat(step.Q[None], len(reports.bias), axis=0)
    noise = step.Q[BIAS, BIAS][0, 0]
    most = np.sqrt(step.drift * noise)  # where all that reports are off is our own position
    for i in range(3):
        drifted = np.minimum(step.drift / reports.bias[:, i], most)
        Q[:, i, BIAS.start + i] -= drifted
        Q[:, BIAS.start + i, i] -= drifted
    sigma = np.sqrt(turning.variances * (1.0 - np.exp(-2.0 * step.dt / turning.times)))
    both = np.sqrt(noise) * (turning.axes * sigma) @ _correlations(step, reports, turning)
    Q[:, TURNED, BIAS], Q[:, BIAS, TURNED] = both, np.swapaxes(both, 1, 2)
    return step._replace(Q=Q)


def _correlations(step: Step, reports: Reports, turning: Turning) -> Array:
    """Of `turned`, along each of its axes, and `bias`, (k, 3, 3): no more than that of the drift leaves."""
    sigma = np.maximum(np.sqrt(turning.variances), LEAST)
    found = np.linalg.inv(turning.axes * sigma) @ reports.shared
    of_drift = step.drift / (reports.bias**2 * step.Q[BIAS, BIAS][0, 0])  # squared
    left = 1.0 - np.minimum(of_drift, 1.0).max(axis=1)
    there = np.sum(found**2, axis=(1, 2))
    return np.asarray(found * np.sqrt(left / np.maximum(there, left + LEAST))[:, None, None])


def moved(rows: Array, step: Step) -> Array:
    """Rows (k, 15) a step later, without noise. Where the aircraft keeps its turn, its horizontal acceleration is
    that of the middle of the step and goes round with the velocity: steps much shorter than a turn make an arc."""
    if not step.keeps_turn:
        return np.asarray(rows @ step.F.T)
    angle = 0.5 * step.dt * turn_rate(rows[:, V], rows[:, A])
    c, s = np.cos(angle), np.sin(angle)
    later = _turned_on(rows.copy(), c, s) @ step.F.T
    return _turned_on(later, c, s)


def _turned_on(rows: Array, c: Array, s: Array) -> Array:
    """The same rows, with accelerations turned to the right by angles of these cosines and sines (k,)."""
    north, east = rows[:, 6].copy(), rows[:, 7].copy()
    rows[:, 6], rows[:, 7] = c * north - s * east, s * north + c * east
    return rows


def turn_rate(v: Array, a: Array) -> Array:
    """By how much the course of velocities (k, 3) turns to the right under accelerations (k, 3), rad/s, (k,)."""
    speed2 = np.maximum(v[:, 0] ** 2 + v[:, 1] ** 2, SLOWEST**2)
    rate = (v[:, 0] * a[:, 1] - v[:, 1] * a[:, 0]) / speed2
    return np.asarray(np.clip(rate, -FASTEST_TURN, FASTEST_TURN))


def back(lag: float) -> Array:
    """Position, velocity and acceleration `lag` seconds before, (9, 9) of those now."""
    return np.kron(np.array([[1.0, -lag, 0.5 * lag * lag], [0.0, 1.0, -lag], [0.0, 0.0, 1.0]]), np.eye(3))


def reported(rows: Array, lag: Array, bias: Array) -> Array:
    """Position and velocity (k, 6) that the aircraft said it had `lag` (k,) seconds before; its reports are
    steadily off by about `bias` (k, 3), m."""
    said = np.empty((len(rows), 6))
    said[:, R] = located(rows, lag) + bias * rows[:, BIAS]
    said[:, V] = rows[:, V] - lag[:, None] * rows[:, A]
    return said


def located(rows: Array, lag: Array) -> Array:
    """Position (k, 3) `lag` (k,) seconds before."""
    back = lag[:, None]
    return np.asarray(rows[:, R] - back * rows[:, V] + 0.5 * back * back * rows[:, A])


def gone(means: Array, covariances: Array, lag: Array) -> tuple[Array, Array]:
    """How far aircraft have gone in the last `lag` (k,) seconds, (k, 3), by beliefs (k, 15) and (k, 15, 15), and
    the covariance (k, 3, 3) of that."""
    t, half = lag[:, None], 0.5 * lag[:, None] ** 2
    of_velocity = t[..., None] * covariances[:, V, :] - half[..., None] * covariances[:, A, :]
    spread = t[..., None] * of_velocity[:, :, V] - half[..., None] * of_velocity[:, :, A]
    return t * means[:, V] - half * means[:, A], spread


def seen(rows: Array, lag: Array, r_OR_n: Array, R_rn: Array) -> Array:
    """Range (m), azimuth (positive right) and elevation (positive up, rad), (k, 3), seen `lag` (k,) seconds before
    by a radar at r_OR_n (3,) with attitude R_rn (3, 3)."""
    polar: Array = _seen(rows, lag, r_OR_n, R_rn)
    return polar


def position(polar: Array, r_OR_n: Array, R_rn: Array) -> Array:
    """r_OT_n (k, 3) of polar measurements (k, 3)."""
    r, azimuth, elevation = polar[:, 0], polar[:, 1], polar[:, 2]
    level = r * np.cos(elevation)
    cartesian = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), -r * np.sin(elevation)], axis=-1)
    return np.asarray(cartesian @ R_rn + r_OR_n)


def position_noise(polar: Array, sigma: Array, R_rn: Array) -> Array:
    """Covariance (k, 3, 3) in n of `position`, of polar measurements (k, 3) with standard deviations (k, 3)."""
    r, azimuth, elevation = polar[:, 0], polar[:, 1], polar[:, 2]
    ca, sa, ce, se = np.cos(azimuth), np.sin(azimuth), np.cos(elevation), np.sin(elevation)
    slope = np.stack(
        [
            np.stack([ce * ca, -r * ce * sa, -r * se * ca], axis=-1),
            np.stack([ce * sa, r * ce * ca, -r * se * sa], axis=-1),
            np.stack([-se, np.zeros_like(r), -r * ce], axis=-1),
        ],
        axis=-2,
    )
    turned = (R_rn.T @ slope) * sigma[:, None, :]
    return np.asarray(turned @ np.swapaxes(turned, -1, -2))


@njit(cache=True, error_model="numpy")
def _look(places, angles, count):  # type: ignore[no-untyped-def]
    """Azimuth and elevation, (2 BLOCK,), of `count` places in the radar's frame, x, y and z each by itself."""
    for s in range(count):
        x, y, z = places[s], places[BLOCK + s], places[2 * BLOCK + s]
        angles[s] = arctan2(y, x)
        angles[BLOCK + s] = arctan2(-z, np.sqrt(x * x + y * y))


@njit((ROWS, VECTOR, VECTOR, ROWS), cache=True, error_model="numpy")
def _seen(rows, lag, r_OR_n, R_rn):  # type: ignore[no-untyped-def]
    """In blocks, so that the compiler makes one instruction of several rows' arctangents."""
    polar = np.empty((rows.shape[0], 3))
    places, angles = np.empty(3 * BLOCK), np.empty(2 * BLOCK)
    d, turned = np.empty(3), np.empty(3)
    for first in range(0, rows.shape[0], BLOCK):
        count = min(BLOCK, rows.shape[0] - first)
        for s in range(count):
            row, back = rows[first + s], lag[first + s]
            for i in range(3):
                d[i] = row[i] - back * (row[3 + i] - 0.5 * back * row[6 + i]) - r_OR_n[i]
            turned[0] = d[0] + row[13] * d[2] - row[14] * d[1]
            turned[1] = d[1] + row[14] * d[0] - row[12] * d[2]
            turned[2] = d[2] + row[12] * d[1] - row[13] * d[0]
            for i in range(3):
                places[i * BLOCK + s] = R_rn[i, 0] * turned[0] + R_rn[i, 1] * turned[1] + R_rn[i, 2] * turned[2]
            polar[first + s, 0] = np.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
        _look(places, angles, count)
        for s in range(count):
            polar[first + s, 1], polar[first + s, 2] = angles[s], angles[BLOCK + s]
    return polar


def expected(means: Array, covariances: Array, lag: float, r_OR_n: Array, R_rn: Array) -> tuple[Array, Array]:
    """What a radar should see (k, 3) of beliefs (k, 15) and (k, 15, 15), and the covariance (k, 3, 3) of that
    without the radar's own noise, to first order."""
    outputs: tuple[Array, Array] = _expected(means, covariances, lag, r_OR_n, R_rn)
    return outputs


EXPECTED: Final[Any] = (ROWS, CUBE, types.float64, VECTOR, ROWS)


VECTORS: Final = (array(types.float64, 1, readonly=False),) * 3


@njit(VECTORS, cache=True, error_model="numpy")
def _add_cross(a, b, out):  # type: ignore[no-untyped-def]
    """out += a x b."""
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        out[i] += a[j] * b[k] - a[k] * b[j]


@njit(EXPECTED, cache=True, error_model="numpy")
def _expected(means, covariances, lag, r_OR_n, R_rn):  # type: ignore[no-untyped-def]
    count = means.shape[0]
    polar, spread = np.empty((count, 3)), np.empty((count, 3, 3))
    J = np.zeros((6, 15))  # of the place `lag` before, and of the rotation
    for i in range(3):
        J[i, i], J[i, 3 + i], J[i, 6 + i], J[3 + i, 12 + i] = 1.0, -lag, 0.5 * lag * lag, 1.0
    back = J[:3].copy()
    G, H = np.zeros((3, 3)), np.empty((3, 6))
    for s in range(count):
        mean, P = means[s].copy(), covariances[s].copy()
        rotation = mean[12:]
        d = back @ mean - r_OR_n
        turned = d.copy()
        _add_cross(rotation, d, turned)
        x, y, z = np.sum(R_rn[0] * turned), np.sum(R_rn[1] * turned), np.sum(R_rn[2] * turned)
        level2 = max(x * x + y * y, 1.0)  # straight above, where azimuth means nothing, it is not infinite
        level, r2 = np.sqrt(level2), max(x * x + y * y + z * z, 1.0)
        polar[s, 0] = max(np.sqrt(np.sum(d * d)), 1.0)
        polar[s, 1], polar[s, 2] = np.arctan2(y, x), np.arctan2(-z, level)
        # slopes by the turned place; a rotation w moves that by w x d, and the range not at all
        G[1] = (x * R_rn[1] - y * R_rn[0]) / level2
        G[2] = (z * (x * R_rn[0] + y * R_rn[1]) / level - level * R_rn[2]) / r2
        H[:, :3], H[:, 3:] = G, 0.0
        for m in range(1, 3):
            _add_cross(G[m], rotation, H[m, :3])
            _add_cross(d, G[m], H[m, 3:])
        H[0, :3] = d / polar[s, 0]
        slope = H @ J
        spread[s] = slope @ P @ slope.T.copy()
    return polar, spread


def crossing(d: Array) -> Array:
    """[d x], (3, 3): what makes d x w of w."""
    return np.array([[0.0, -d[2], d[1]], [d[2], 0.0, -d[0]], [-d[1], d[0], 0.0]])


def told_turned(belief: Belief, rotation: Belief) -> Belief:
    """Beliefs (..., 15) of which `turned` has become known to be `rotation`, (3,) and (3, 3), and is counted from
    there on; the other states go along as far as they depend on it."""
    mean, P = belief
    own = P[..., TURNED, TURNED]
    gain = np.swapaxes(np.linalg.solve(own + 1e-16 * np.eye(3), P[..., TURNED, :]), -1, -2)
    gain[..., TURNED, :] = np.eye(3)
    after = mean + np.einsum("...ij,...j->...i", gain, rotation.mean - mean[..., TURNED])
    after[..., TURNED] = 0.0
    covariance = P + gain @ (rotation.covariance - own) @ np.swapaxes(gain, -1, -2)
    return Belief(after, 0.5 * (covariance + np.swapaxes(covariance, -1, -2)))
