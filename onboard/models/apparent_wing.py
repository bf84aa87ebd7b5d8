"""A leader whose nose may point anywhere, in coordinates in which its image is nearly linear.

The apparent length of a wing gives the range only if the nose is known: a far leader seen from behind looks like a
near one seen along its wing. A Gaussian over Cartesian positions slides along that curve, and becomes sure of a
wrong range. Here the quantities that an image measures are states, and the range follows from them:

    range = size x visible fraction of the wing / apparent length

State rows (N = 19), from the follower F, vectors in n:
- `right`, `down`: the leader's direction, stereographic about the first of `axes` (rad); `log_length`: the natural
  logarithm of the wing's apparent length (rad);
- v_L (3): the leader's own velocity (m/s); `log_size`: of the wing's length (m); a_L (3): acceleration (m/s^2);
- `nose`: rad from north, not wrapped; `bank_error`: rad beyond the bank of a coordinated turn;
- `misalignment` (3): rad, the rotation from our true attitude to the believed one; `own_velocity_error` (3): m/s,
  true minus believed; `nose_rate`: rad/s, beside the turn of the course.
"""

from typing import Final, NamedTuple

import numpy as np
from numba import njit, types

from onboard.arrays import Array
from onboard.filters.compiled import ROWS, VECTOR

G: Final = 9.80665
N: Final = 19
DIRECTION: Final = slice(0, 2)
LOG_LENGTH: Final = 2
V: Final = slice(3, 6)
LOG_SIZE: Final = 6
A: Final = slice(7, 10)
NOSE: Final = 10
BANK_ERROR: Final = 11
MISALIGNMENT: Final = slice(12, 15)
OWN_VELOCITY: Final = slice(15, 18)
NOSE_RATE: Final = 18
LEAST_VISIBLE: Final = 0.05  # of the wing: seen exactly along itself, it still shows a tip
SLOW2: Final = 1.0  # (m/s)^2: in place of 0/0 where a course would be divided by
TURNS2: Final = 4.0  # (m/s)^2: a leader slower than its root does not turn its velocity
FOLLOWS4: Final = 81.0  # (m/s)^4: a leader faster than its fourth root turns its nose with its course

NUMBER: Final = types.float64


class Decay(NamedTuple):
    """What a time step leaves of deviations, as fractions: acceleration, bank, misalignment, own velocity's error;
    and of the nose's rate, for each row (k,)."""

    acceleration: float
    bank: float
    misalignment: float
    own_velocity: float
    nose_rate: Array


def axes_about(direction: Array) -> Array:
    """Unit vectors (3, 3) in n: a direction (3,), and to the right (level) and down of it."""
    level = np.hypot(direction[0], direction[1])
    right = np.array([-direction[1], direction[0], 0.0]) / level if level > 1e-6 else np.array([0.0, 1.0, 0.0])
    return np.array([direction, right, np.cross(direction, right)])


def positions(rows: Array, axes: Array) -> Array:
    """r_FL_n (k, 3) in m of state rows (k, N) about `axes` (3, 3)."""
    found: Array = _positions(rows, axes)
    return found


def visible(rows: Array, axes: Array) -> Array:
    """The fraction (k,) of the wing's length that is seen, of state rows (k, N): 1 across the line of sight."""
    found: Array = _visible_rows(rows, axes)
    return found


def process(rows: Array, dt: float, moved: Array, axes: Array, new_axes: Array, decay: Decay) -> Array:
    """Rows (k, N) about `new_axes` after `dt` seconds in which the follower moves by `moved` (3,) m, in n.

    Acceleration turns the velocity at the rate it implies, and a turn lasts; what is along the track, or vertical,
    decays."""
    after: Array = _process(rows, dt, moved, axes, new_axes, *decay)
    return after


def measure(rows: Array, axes: Array, R_cn: Array, r_FC_n: Array, seen: Array, m: int) -> Array:
    """The measurement (k, m) of `models.wing_line`, rad, that state rows (k, N) predict: for a camera at r_FC_n
    (3,) with attitude R_cn (3, 3), about the measured axes `seen` (3, 3) in c."""
    found: Array = _measure(rows, axes, R_cn, r_FC_n, seen, m)
    return found


@njit(cache=True, error_model="numpy")
def _wing(row):  # type: ignore[no-untyped-def]
    """The direction in n from the left wingtip to the right one."""
    c, s = np.cos(row[NOSE]), np.sin(row[NOSE])
    bank = np.arctan2(row[8] * c - row[7] * s, G - row[9]) + row[BANK_ERROR]
    level = np.cos(bank)
    return -s * level, c * level, np.sin(bank)


@njit(cache=True, error_model="numpy")
def _fraction(wing, x, y, z):  # type: ignore[no-untyped-def]
    """The visible fraction of a wing from the direction (x, y, z)."""
    along = wing[0] * x + wing[1] * y + wing[2] * z
    return np.sqrt(max(1.0 - along * along, 0.0) + LEAST_VISIBLE * LEAST_VISIBLE)


@njit(cache=True, error_model="numpy")
def _direction(row, axes):  # type: ignore[no-untyped-def]
    right, down = row[0], row[1]
    quarter = 0.25 * (right * right + down * down)
    k, ahead = 1.0 / (1.0 + quarter), 1.0 - quarter
    return (
        k * (ahead * axes[0, 0] + right * axes[1, 0] + down * axes[2, 0]),
        k * (ahead * axes[0, 1] + right * axes[1, 1] + down * axes[2, 1]),
        k * (ahead * axes[0, 2] + right * axes[1, 2] + down * axes[2, 2]),
    )


@njit(cache=True, error_model="numpy")
def _position(row, axes):  # type: ignore[no-untyped-def]
    x, y, z = _direction(row, axes)
    r = np.exp(row[LOG_SIZE] - row[LOG_LENGTH]) * _fraction(_wing(row), x, y, z)
    return r * x, r * y, r * z


@njit((ROWS, ROWS), cache=True, error_model="numpy")
def _positions(rows, axes):  # type: ignore[no-untyped-def]
    out = np.empty((rows.shape[0], 3))
    for s in range(rows.shape[0]):
        out[s, 0], out[s, 1], out[s, 2] = _position(rows[s], axes)
    return out


@njit((ROWS, ROWS), cache=True, error_model="numpy")
def _visible_rows(rows, axes):  # type: ignore[no-untyped-def]
    out = np.empty(rows.shape[0])
    for s in range(rows.shape[0]):
        x, y, z = _direction(rows[s], axes)
        out[s] = _fraction(_wing(rows[s]), x, y, z)
    return out


@njit(cache=True, error_model="numpy")
def _fly(row, new, dt, kept):  # type: ignore[no-untyped-def]
    """The leader's velocity, acceleration and course after `dt`, into `new`; its displacement less that of its
    velocity at first."""
    u, v, w = row[3], row[4], row[5]
    a, b, d = row[7], row[8], row[9]
    speed2 = u * u + v * v
    rate = (u * b - v * a) / (speed2 + SLOW2)
    turn = rate * dt * speed2 / (speed2 + TURNS2)
    c, s = np.cos(turn), np.sin(turn)
    a2, b2 = c * a - s * b, s * a + c * b
    new[3], new[4], new[5] = u + 0.5 * dt * (a + a2), v + 0.5 * dt * (b + b2), w + dt * d
    along = (a2 * new[3] + b2 * new[4]) / (speed2 + SLOW2)
    slow = 1.0 - (1.0 - kept) * TURNS2 / (speed2 + TURNS2)
    new[7] = (a2 - (1.0 - kept) * along * new[3]) * slow
    new[8] = (b2 - (1.0 - kept) * along * new[4]) * slow
    new[9] = d * kept * slow
    speed4 = speed2 * speed2
    new[NOSE] = row[NOSE] + speed4 / (speed4 + FOLLOWS4) * rate * dt + dt * row[NOSE_RATE]
    sixth = dt * dt / 6.0
    return sixth * (2.0 * a + a2), sixth * (2.0 * b + b2), 0.5 * dt * dt * d


@njit((ROWS, NUMBER, VECTOR, ROWS, ROWS, *[NUMBER] * 4, VECTOR), cache=True, error_model="numpy")
def _process(rows, dt, moved, axes, new_axes, a_kept, bank_kept, misalignment_kept, own_kept, rate_kept):  # type: ignore[no-untyped-def]
    count = rows.shape[0]
    out = np.empty(rows.shape)
    for s in range(count):
        row, new = rows[s], out[s]
        x, y, z = _position(row, axes)
        for i in range(N):
            new[i] = row[i]
        e, f, g = _fly(row, new, dt, a_kept)
        new[BANK_ERROR] = row[BANK_ERROR] * bank_kept
        for i in range(12, 15):
            new[i] = row[i] * misalignment_kept
        for i in range(15, 18):
            new[i] = row[i] * own_kept
        new[NOSE_RATE] = row[NOSE_RATE] * rate_kept[s]
        x += dt * (row[3] - row[15]) + e - moved[0]
        y += dt * (row[4] - row[16]) + f - moved[1]
        z += dt * (row[5] - row[17]) + g - moved[2]
        r = np.sqrt(x * x + y * y + z * z)
        x, y, z = x / r, y / r, z / r
        new[LOG_LENGTH] = new[LOG_SIZE] + np.log(_fraction(_wing(new), x, y, z) / r)
        twice = 2.0 / (1.0 + x * new_axes[0, 0] + y * new_axes[0, 1] + z * new_axes[0, 2])
        new[0] = twice * (x * new_axes[1, 0] + y * new_axes[1, 1] + z * new_axes[1, 2])
        new[1] = twice * (x * new_axes[2, 0] + y * new_axes[2, 1] + z * new_axes[2, 2])
    return out


@njit((ROWS, ROWS, ROWS, VECTOR, ROWS, types.int64), cache=True, error_model="numpy")
def _measure(rows, axes, R_cn, r_FC, seen, m):  # type: ignore[no-untyped-def]
    out, p, ends = np.empty((rows.shape[0], m)), np.empty(3), np.empty((3, 2))
    for s in range(rows.shape[0]):
        row = rows[s]
        x, y, z = _position(row, axes)
        wing, half = _wing(row), 0.5 * np.exp(row[LOG_SIZE])
        for k in range(3):
            sign = (0.0, -half, half)[k]
            a = x - r_FC[0] + sign * wing[0]
            b = y - r_FC[1] + sign * wing[1]
            c = z - r_FC[2] + sign * wing[2]
            # R_cn is believed: what the true camera sees is rotated by the misalignment
            e, f, g = row[12], row[13], row[14]
            a, b, c = a + f * c - g * b, b + g * a - e * c, c + e * b - f * a
            for i in range(3):
                p[i] = R_cn[i, 0] * a + R_cn[i, 1] * b + R_cn[i, 2] * c
            length = np.sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2])
            ahead = seen[0, 0] * p[0] + seen[0, 1] * p[1] + seen[0, 2] * p[2]
            twice = 2.0 / max(length + ahead, 1e-9 * length)
            for i in range(2):
                ends[k, i] = twice * (seen[1 + i, 0] * p[0] + seen[1 + i, 1] * p[1] + seen[1 + i, 2] * p[2])
        for i in range(2):
            out[s, i] = ends[0, i]
            out[s, 2 + i] = ends[2, i] - ends[1, i]
            if m > 4:
                out[s, 4 + i] = 0.5 * (ends[1, i] + ends[2, i])
    return out
