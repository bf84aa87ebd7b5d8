"""How a leader flies, in more detail than Oh & Johnson's model: along its track too, with a heading and a bank.

State rows: the nine of `relative_motion` first, [r_FL_n (3), v_FL_n (3), b, a_lat, a_long], then
- `a_along`: acceleration along the track (m/s^2), which the paper leaves out;
- `heading`: of the nose, rad from north, not wrapped; unless the leader is slow, it tends to the course;
- `bank_error`: rad beyond the bank that the acceleration requires, tan(bank) = a_right / (g - a_down). Lift, or
  the rotors' thrust, turns any aircraft, and the wing stands square to it;
then, if they are estimated, `delay`: s by which images are older than their stamps, and `bias_*`: the small
rotation (rad, about the camera's axes) from the camera's assumed attitude to its true one.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numba import njit, types

from onboard.arrays import Array
from onboard.filters.compiled import CUBE, ROWS, VECTOR
from onboard.geometry.arctangent import arctan2
from onboard.models import relative_motion
from onboard.models.relative_motion import A_LAT, A_LONG, SIZE

G: Final = 9.80665
A_ALONG: Final = 9
HEADING: Final = 10
BANK_ERROR: Final = 11
BASE: Final = 12  # number of states without delay and bias
TINY: Final = 1e-12  # m^2/s^2, avoids 0/0
COURSE: Final = 3.0  # times `eps`: above about this speed the nose follows the course
N_DELAY: Final = BASE + 1  # with the delay
N_BIAS: Final = BASE + 3  # with the bias
N_BOTH: Final = BASE + 4
COMPONENTS: Final = (*relative_motion.COMPONENTS, "a_along", "heading", "bank_error")
UNITS: Final = (*relative_motion.UNITS, "m/s^2", "rad", "rad")
DELAY_COMPONENTS: Final = ("delay",)
BIAS_COMPONENTS: Final = ("bias_forward", "bias_right", "bias_down")

BLOCK: Final = 64  # rows computed at a time


class ModeParameters(NamedTuple):
    """How a leader flies in one mode. Times (s) are time constants, with which deviations decay. `eps` (m/s) is
    as in `relative_motion.leader_acceleration`: below this speed a course means little. A hovering leader loses
    its own velocity and accelerations with `hover_time`; its nose turns at `nose_rate` (rad/s)."""

    eps: float
    along_time: float
    heading_time: float
    bank_time: float
    bias_time: float
    hover_time: float = math.inf
    nose_rate: float = 0.0


class ImageGeometry(NamedTuple):
    """From where, and how, B images were taken: the camera's attitude R_cn (B, 3, 3) and place r_FC_n (B, 3) m,
    F's velocity v_F_n (B, 3) m/s, the camera's rates omega_c (B, 3) rad/s, and the axes (B, 3, 3) of the
    measurement, rows in c: the leader's measured direction, then to the right of it and below it."""

    R_cn: Array
    r_FC_n: Array
    v_F_n: Array
    omega_c: Array
    axes: Array


def process(rows: Array, dt: float, v_F_n: Array, a_F_n: Array, parameters: ModeParameters) -> Array:
    """Rows (B k, n) of B filters after `dt` seconds in which their followers, at first at v_F_n (B, 3), accelerate
    by a_F_n (B, 3): eqs 5-10 without noise, by one step of RK4, and the decay of deviations."""
    eps, along, heading, bank, bias, hover, nose_rate = parameters
    decay = np.array([math.exp(-dt / time) for time in (along, heading, bank, bias, hover)])
    after: Array = process_rows(rows, dt, v_F_n, a_F_n, eps, decay, nose_rate)
    return after


PROCESS_SIGNATURE: Final = (ROWS, types.float64, ROWS, ROWS, types.float64, VECTOR, types.float64)


@njit(cache=True, error_model="numpy")
def _acceleration(u, v, w, lat, up, along, c, s, eps):  # type: ignore[no-untyped-def]
    """a_L_n at the velocity (u, v, w), with the nose in the direction (c, s): eq 2, and the acceleration along the
    track. A hovering leader has no track, so eps times the nose's direction is added to the velocity."""
    u, v = u + eps * c, v + eps * s
    level2 = u * u + v * v + TINY
    level = np.sqrt(level2)
    speed = np.sqrt(level2 + w * w)
    pull, turn, climb = along / speed, lat / level, up / (level * speed)
    return pull * u - turn * v + climb * u * w, pull * v + turn * u + climb * v * w, pull * w - climb * level2


@njit(cache=True, error_model="numpy")
def _changes(now, change, count, dt, eps, course4, lean):  # type: ignore[no-untyped-def]
    """Changes of `count` leaders over `dt`, by RK4. `now` (9 BLOCK,) holds, each component in a block of its
    own, the velocity, the accelerations to the side, upward and along the track, cosine and sine of the heading,
    and the heading. `change` (7 BLOCK,) receives the sum of RK4's first three accelerations, which moves the
    position, the change of velocity, and the change of heading."""
    h, sixth = 0.5 * dt, dt / 6.0
    for s in range(count):
        U, V, W = now[s], now[BLOCK + s], now[2 * BLOCK + s]
        lat, up, along = now[3 * BLOCK + s], now[4 * BLOCK + s], now[5 * BLOCK + s]
        c, s_, heading = now[6 * BLOCK + s], now[7 * BLOCK + s], now[8 * BLOCK + s]
        x1, y1, z1 = _acceleration(U, V, W, lat, up, along, c, s_, eps)
        x2, y2, z2 = _acceleration(U + h * x1, V + h * y1, W + h * z1, lat, up, along, c, s_, eps)
        x3, y3, z3 = _acceleration(U + h * x2, V + h * y2, W + h * z2, lat, up, along, c, s_, eps)
        x4, y4, z4 = _acceleration(U + dt * x3, V + dt * y3, W + dt * z3, lat, up, along, c, s_, eps)
        dU, dV = sixth * (x1 + 2.0 * x2 + 2.0 * x3 + x4), sixth * (y1 + 2.0 * y2 + 2.0 * y3 + y4)
        change[s], change[BLOCK + s], change[2 * BLOCK + s] = x1 + x2 + x3, y1 + y2 + y3, z1 + z2 + z3
        change[3 * BLOCK + s], change[4 * BLOCK + s] = dU, dV
        change[5 * BLOCK + s] = sixth * (z1 + 2.0 * z2 + 2.0 * z3 + z4)
        # the nose turns with the course and tends to it; a slow leader has little of a course
        speed2 = U * U + V * V
        share = speed2 * speed2 / (speed2 * speed2 + course4)
        turn = arctan2(U * (V + dV) - V * (U + dU), U * (U + dU) + V * (V + dV))
        aside = heading - arctan2(V, U)
        aside -= 2.0 * np.pi * np.rint(aside / (2.0 * np.pi))
        change[6 * BLOCK + s] = share * (turn - lean * aside)


@njit(PROCESS_SIGNATURE, cache=True, error_model="numpy")
def process_rows(rows, dt, v_F, a_F, eps, decay, nose_rate):  # type: ignore[no-untyped-def]
    """`process`, to be called from compiled code: `decay` (5,) are the factors exp(-dt / time), in the order of
    `ModeParameters`. In blocks, so that the compiler makes one instruction of several rows' roots, quotients and
    arctangents."""
    count, n = rows.shape
    hover_decay = decay[4]
    after, now, change = np.empty(rows.shape), np.empty(9 * BLOCK), np.empty(7 * BLOCK)
    each = count // v_F.shape[0]
    sixth, half, course4, lost = dt * dt / 6.0, 0.5 * dt * dt, (COURSE * eps) ** 4, 1.0 - hover_decay
    for first in range(0, count, BLOCK):
        block = min(BLOCK, count - first)
        for s in range(block):
            row, f = rows[first + s], (first + s) // each
            for i in range(3):  # the leader's own velocity; the follower's acceleration enters only at the end
                now[i * BLOCK + s] = row[3 + i] + v_F[f, i]
            now[3 * BLOCK + s], now[4 * BLOCK + s], now[5 * BLOCK + s] = row[A_LAT], row[A_LONG], row[A_ALONG]
            now[6 * BLOCK + s], now[7 * BLOCK + s] = np.cos(row[HEADING]), np.sin(row[HEADING])
            now[8 * BLOCK + s] = row[HEADING]
        _changes(now, change, block, dt, eps, course4, 1.0 - decay[1])
        for s in range(block):
            row, out, f = rows[first + s], after[first + s], (first + s) // each
            for i in range(3):
                out[i] = row[i] + dt * row[3 + i] + sixth * change[i * BLOCK + s] - half * a_F[f, i]
                out[3 + i] = row[3 + i] + change[(3 + i) * BLOCK + s] - dt * a_F[f, i]
            for i in range(SIZE, n):
                out[i] = row[i]
            if hover_decay < 1.0:
                for i in range(3):
                    out[3 + i] -= lost * (out[3 + i] + v_F[f, i] + dt * a_F[f, i])
                out[A_LAT] *= hover_decay
                out[A_LONG] *= hover_decay
            out[A_ALONG] *= decay[0]
            out[HEADING] += change[6 * BLOCK + s] + nose_rate * dt
            out[BANK_ERROR] *= decay[2]
            if n >= N_BIAS:
                for i in range(n - 3, n):
                    out[i] *= decay[3]
    return after


@njit(cache=True, error_model="numpy")
def wing_axis(row, u, v, w, eps):  # type: ignore[no-untyped-def]
    """The direction (3) in n from the left wingtip to the right one, of one state row and the leader's own
    velocity (u, v, w). To be called from compiled code."""
    c, s = np.cos(row[HEADING]), np.sin(row[HEADING])
    x, y, z = _acceleration(u, v, w, row[A_LAT], row[A_LONG], row[A_ALONG], c, s, eps)
    bank = np.arctan2(y * c - x * s, G - z) + row[BANK_ERROR]
    level = np.cos(bank)
    return -s * level, c * level, np.sin(bank)


def measure(rows: Array, geometry: ImageGeometry, eps: float, m: int) -> Array:
    """Predicted measurements (B k, m), rad, of state rows (B k, n): see `wing_line`. The wingtips are half the
    size b to both sides of L, square to the thrust and to the nose."""
    predicted: Array = measure_rows(rows, *geometry, eps, m)
    return predicted


@njit(cache=True, error_model="numpy")
def project_about(axes, x, y, z):  # type: ignore[no-untyped-def]
    """Stereographic coordinates (right, down) of the direction of (x, y, z) in c about the first of `axes`."""
    length = np.sqrt(x * x + y * y + z * z)
    ahead = axes[0, 0] * x + axes[0, 1] * y + axes[0, 2] * z
    twice = 2.0 / max(length + ahead, 1e-9 * length)
    return (
        twice * (axes[1, 0] * x + axes[1, 1] * y + axes[1, 2] * z),
        twice * (axes[2, 0] * x + axes[2, 1] * y + axes[2, 2] * z),
    )


@njit((ROWS, CUBE, ROWS, ROWS, ROWS, CUBE, types.float64, types.int64), cache=True, error_model="numpy")
def measure_rows(rows, R_cn, r_FC, v_F, omega_c, axes, eps, m):  # type: ignore[no-untyped-def]
    """`measure`, to be called from compiled code."""
    count, n = rows.shape
    predicted = np.empty((count, m))
    each = count // v_F.shape[0]
    q, d = np.empty(3), np.empty(3)
    for s in range(count):
        f = s // each
        row = rows[s]
        late = row[BASE] if n in (N_DELAY, N_BOTH) else 0.0
        wx, wy, wz = wing_axis(row, row[3] + v_F[f, 0], row[4] + v_F[f, 1], row[5] + v_F[f, 2], eps)
        x = row[0] - late * row[3] - r_FC[f, 0]
        y = row[1] - late * row[4] - r_FC[f, 1]
        z = row[2] - late * row[5] - r_FC[f, 2]
        for i in range(3):
            q[i] = R_cn[f, i, 0] * x + R_cn[f, i, 1] * y + R_cn[f, i, 2] * z
            d[i] = 0.5 * row[SIZE] * (R_cn[f, i, 0] * wx + R_cn[f, i, 1] * wy + R_cn[f, i, 2] * wz)
        # small rotations: to the camera's attitude when the image was taken, and to its true one
        t0, t1, t2 = late * omega_c[f, 0], late * omega_c[f, 1], late * omega_c[f, 2]
        if n >= N_BIAS:
            t0, t1, t2 = t0 - row[n - 3], t1 - row[n - 2], t2 - row[n - 1]
        q0, q1, q2 = q[0] + t1 * q[2] - t2 * q[1], q[1] + t2 * q[0] - t0 * q[2], q[2] + t0 * q[1] - t1 * q[0]
        d0, d1, d2 = d[0] + t1 * d[2] - t2 * d[1], d[1] + t2 * d[0] - t0 * d[2], d[2] + t0 * d[1] - t1 * d[0]
        predicted[s, 0], predicted[s, 1] = project_about(axes[f], q0, q1, q2)
        right = project_about(axes[f], q0 + d0, q1 + d1, q2 + d2)
        left = project_about(axes[f], q0 - d0, q1 - d1, q2 - d2)
        predicted[s, 2], predicted[s, 3] = right[0] - left[0], right[1] - left[1]
        if m > 4:
            predicted[s, 4], predicted[s, 5] = 0.5 * (right[0] + left[0]), 0.5 * (right[1] + left[1])
    return predicted
