"""Motion of a leader relative to a follower: Oh & Johnson, section II.A, eqs 1-10.

State rows: [r_FL_n (3), v_FL_n (3), b, a_lat, a_long] in m, m/s, m, m/s^2. `a_lat` > 0 is a right turn, in the
horizontal plane; `a_long` is normal to the velocity in its vertical plane, positive up (not along the track).
"""

from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.compiled import CUBE, FLOAT, MAKING, OUT, ROWS, VECTOR, kernel

STATE_SIZE: Final = 9
POSITION: Final = slice(0, 3)
VELOCITY: Final = slice(3, 6)
SIZE: Final = 6
A_LAT: Final = 7
A_LONG: Final = 8
BLOCK_ROWS: Final = 64  # Rows per block of the compiled loops.
COMPONENTS: Final = ("r_north", "r_east", "r_down", "v_north", "v_east", "v_down", "size", "a_lat", "a_long")
UNITS: Final = ("m", "m", "m", "m/s", "m/s", "m/s", "m", "m/s^2", "m/s^2")
FRAME: Final = "n (local NED), leader relative to follower"


# Given, so that nothing compiles in flight: rows (k, 9), dt, the follower's four vectors (3,), eps.
PROCESS_SIGNATURE: Final = (ROWS, FLOAT, VECTOR, VECTOR, VECTOR, VECTOR, FLOAT, OUT)
ACCELERATION_SIGNATURE: Final = (ROWS, VECTOR, VECTOR, FLOAT)


class FollowerMotion(NamedTuple):
    """The follower's velocity (m/s) and acceleration (m/s^2), (3,) in n, at the start and the end of a step.

    They are linear between.
    """

    v0: Array
    v1: Array
    a0: Array
    a1: Array


@kernel(**MAKING)
def _acceleration(U, V_, W, a_lat, a_long, eps):
    """Return the acceleration at one velocity, as `leader_acceleration`."""
    along2 = U * U + V_ * V_
    horizontal2 = along2 + eps * eps
    horizontal = np.sqrt(horizontal2)
    climb = a_long / (horizontal * np.sqrt(horizontal2 + W * W))
    turn = a_lat / horizontal
    return climb * U * W - turn * V_, climb * V_ * W + turn * U, -climb * along2


def leader_acceleration(v_L: Array, a_lat: Array, a_long: Array, eps: float) -> Array:
    """Return a_L_n (k, 3) of velocity rows (k, 3) and the two accelerations (k,): eq 2.

    `eps` (m/s) regularises the direction of a hovering leader: the horizontal speed in the denominators is
    sqrt(U^2 + V^2 + eps^2). The paper's own form is eps = 0, which is 0/0 when the leader hovers.
    """
    a: Array = _accelerations(v_L, a_lat, a_long, eps)
    return a


@kernel(ACCELERATION_SIGNATURE, **MAKING)
def _accelerations(v_L, a_lat, a_long, eps):
    a = np.empty((v_L.shape[0], 3))
    for s in range(v_L.shape[0]):
        a[s, 0], a[s, 1], a[s, 2] = _acceleration(v_L[s, 0], v_L[s, 1], v_L[s, 2], a_lat[s], a_long[s], eps)
    return a


def process(points: Array, dt: float, follower: FollowerMotion, eps: float) -> Array:
    """Return state rows (k, 9) after `dt` seconds without noise: eqs 5-10.

    One step of RK4, with the follower's velocity and acceleration interpolated over it.
    """
    after = np.empty(points.shape)  # faster than an array from machine code
    _process(points, dt, *follower, eps, after)
    return after


@kernel(**MAKING)
def _changes(now, change, count, dt, v0, v1, a0, a1, eps):
    """Write the changes of relative position and velocity by RK4 over dt into `change` (6 BLOCK_ROWS,).

    `now` (5 BLOCK_ROWS,) holds the relative velocity and two accelerations of `count` rows, each component in a
    block of its own.
    """
    h, sixth = 0.5 * dt, dt / 6.0
    u0, u1, u2 = v0[0], v0[1], v0[2]
    w0, w1, w2 = v1[0], v1[1], v1[2]
    m0, m1, m2 = 0.5 * (u0 + w0), 0.5 * (u1 + w1), 0.5 * (u2 + w2)
    b0, b1, b2 = a0[0], a0[1], a0[2]
    d0, d1, d2 = a1[0], a1[1], a1[2]
    c0, c1, c2 = 0.5 * (b0 + d0), 0.5 * (b1 + d1), 0.5 * (b2 + d2)
    for s in range(count):
        u, v, w = now[s], now[BLOCK_ROWS + s], now[2 * BLOCK_ROWS + s]
        lat, up = now[3 * BLOCK_ROWS + s], now[4 * BLOCK_ROWS + s]
        x1, y1, z1 = _acceleration(u + u0, v + u1, w + u2, lat, up, eps)
        x1, y1, z1 = x1 - b0, y1 - b1, z1 - b2
        x2, y2, z2 = _acceleration(u + h * x1 + m0, v + h * y1 + m1, w + h * z1 + m2, lat, up, eps)
        x2, y2, z2 = x2 - c0, y2 - c1, z2 - c2
        x3, y3, z3 = _acceleration(u + h * x2 + m0, v + h * y2 + m1, w + h * z2 + m2, lat, up, eps)
        x3, y3, z3 = x3 - c0, y3 - c1, z3 - c2
        x4, y4, z4 = _acceleration(u + dt * x3 + w0, v + dt * y3 + w1, w + dt * z3 + w2, lat, up, eps)
        x4, y4, z4 = x4 - d0, y4 - d1, z4 - d2
        # the position's own RK4 stages are v, v + h k1, v + h k2, v + dt k3; written out they collapse to this
        change[s] = dt * (u + sixth * (x1 + x2 + x3))
        change[BLOCK_ROWS + s] = dt * (v + sixth * (y1 + y2 + y3))
        change[2 * BLOCK_ROWS + s] = dt * (w + sixth * (z1 + z2 + z3))
        change[3 * BLOCK_ROWS + s] = sixth * (x1 + 2.0 * x2 + 2.0 * x3 + x4)
        change[4 * BLOCK_ROWS + s] = sixth * (y1 + 2.0 * y2 + 2.0 * y3 + y4)
        change[5 * BLOCK_ROWS + s] = sixth * (z1 + 2.0 * z2 + 2.0 * z3 + z4)


@kernel(PROCESS_SIGNATURE, **MAKING)
def _process(points, dt, v0, v1, a0, a1, eps, after):
    """Process blocks of rows, so that roots and divisions of several rows become one instruction.

    They are most of the work.
    """
    now, change = np.empty(5 * BLOCK_ROWS), np.empty(6 * BLOCK_ROWS)
    for first in range(0, points.shape[0], BLOCK_ROWS):
        count = min(BLOCK_ROWS, points.shape[0] - first)
        for s in range(count):
            row = points[first + s]
            now[s], now[BLOCK_ROWS + s], now[2 * BLOCK_ROWS + s] = row[3], row[4], row[5]
            now[3 * BLOCK_ROWS + s], now[4 * BLOCK_ROWS + s] = row[A_LAT], row[A_LONG]
        _changes(now, change, count, dt, v0, v1, a0, a1, eps)
        for s in range(count):
            row, to = points[first + s], after[first + s]
            for i in range(6):
                to[i] = row[i] + change[i * BLOCK_ROWS + s]
            for i in range(SIZE, STATE_SIZE):
                to[i] = row[i]


def process_batch(points: Array, dt: float, followers: FollowerMotion, eps: float) -> Array:
    """`process` for B filters: points (B, k, 9), and a follower for each, (B, 3)."""
    after: Array = _process_batch(points, dt, *followers, eps)
    return after


@kernel((CUBE, FLOAT, ROWS, ROWS, ROWS, ROWS, FLOAT), **MAKING)
def _process_batch(points, dt, v0, v1, a0, a1, eps):
    after = np.empty(points.shape)
    for b in range(points.shape[0]):
        _process(points[b], dt, v0[b], v1[b], a0[b], a1[b], eps, after[b])
    return after
