"""Motion of a leader relative to a follower: Oh & Johnson, section II.A, eqs 1-10.

State rows: [r_FL_n (3), v_FL_n (3), b, a_lat, a_long] in m, m/s, m, m/s^2. `a_lat` > 0 is a right turn, in the
horizontal plane; `a_long` is normal to the velocity in its vertical plane, positive up (not along the track).
"""

from typing import Final, NamedTuple

import numpy as np

from onboard.geometry.rotations import Array

N: Final = 9
R: Final = slice(0, 3)
V: Final = slice(3, 6)
SIZE: Final = 6
A_LAT: Final = 7
A_LONG: Final = 8
COMPONENTS: Final = ("r_north", "r_east", "r_down", "v_north", "v_east", "v_down", "size", "a_lat", "a_long")
UNITS: Final = ("m", "m", "m", "m/s", "m/s", "m/s", "m", "m/s^2", "m/s^2")
FRAME: Final = "n (local NED), leader relative to follower"


class FollowerMotion(NamedTuple):
    """The follower's velocity and acceleration (3,) in n at the start and the end of a step; linear between."""

    v0: Array
    v1: Array
    a0: Array
    a1: Array


def leader_acceleration(v_L: Array, a_lat: Array, a_long: Array, eps: float) -> Array:
    """a_L_n (k, 3) of velocity rows (k, 3) and the two accelerations (k,): eq 2.

    `eps` (m/s) regularises the direction of a hovering leader: the horizontal speed in the denominators is
    sqrt(U^2 + V^2 + eps^2). The paper's own form is eps = 0, which is 0/0 when the leader hovers.
    """
    U, V_, W = v_L[:, 0], v_L[:, 1], v_L[:, 2]
    horizontal2 = U * U + V_ * V_ + eps * eps
    horizontal = np.sqrt(horizontal2)
    climb = a_long / (horizontal * np.sqrt(horizontal2 + W * W))
    turn = a_lat / horizontal
    a = np.empty_like(v_L)
    a[:, 0] = climb * U * W - turn * V_
    a[:, 1] = climb * V_ * W + turn * U
    a[:, 2] = -climb * (U * U + V_ * V_)
    return a


def rotation_covariance(mean: Array, sigma_n: Array) -> Array:
    """Covariance (9, 9) of a relative motion (9,) seen from an attitude that is off by a constant small rotation
    with standard deviations `sigma_n` (3,) rad about north, east and down: both vectors turn with it."""
    turned = np.zeros((N, 3))
    for at in (R, V):
        x, y, z = mean[at]
        turned[at] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]  # d(rotation x vector) / d rotation
    scaled = turned * sigma_n
    return np.asarray(scaled @ scaled.T)


def process(points: Array, dt: float, follower: FollowerMotion, eps: float) -> Array:
    """State rows (k, 9) after `dt` seconds: eqs 5-10 without noise, one step of RK4 with the follower's
    velocity and acceleration interpolated over it."""
    r, v = points[:, R], points[:, V]
    a_lat, a_long = points[:, A_LAT], points[:, A_LONG]
    v_mid = 0.5 * (follower.v0 + follower.v1)
    a_mid = 0.5 * (follower.a0 + follower.a1)
    h = 0.5 * dt
    k1 = leader_acceleration(v + follower.v0, a_lat, a_long, eps) - follower.a0
    k2 = leader_acceleration(v + h * k1 + v_mid, a_lat, a_long, eps) - a_mid
    k3 = leader_acceleration(v + h * k2 + v_mid, a_lat, a_long, eps) - a_mid
    k4 = leader_acceleration(v + dt * k3 + follower.v1, a_lat, a_long, eps) - follower.a1
    after = points.copy()
    # the position's own RK4 stages are v, v + h k1, v + h k2, v + dt k3; written out they collapse to this
    after[:, R] = r + dt * v + dt * dt / 6.0 * (k1 + k2 + k3)
    after[:, V] = v + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return after
