"""Closest approach of another aircraft: time and distance with their uncertainties.

Neither aircraft changes its velocity, or the other one keeps its turn and we fly straight on.
"""

from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.filters.belief import Belief, FilterError
from onboard.filters.cubature import weights
from onboard.filters.unscented import sigma_points
from onboard.models import arc
from onboard.models.intruder import motion

MIN_CLOSING_SPEED_M_S: Final = 1e-3  # Slower relative motion brings the aircraft no closer.
MIN_TURN_RATE_SIGMAS: Final = 3.0  # With fewer, the aircraft may fly straight.
MAX_TURN_TIME_S: Final = 60.0  # No turn is kept for longer.


class Approaches(NamedTuple):
    """Closest approaches of k tracks.

    Attributes
    ----------
    time, time_sigma
        Time to the closest approach, s, and its sigma (k,).
    distance, distance_sigma
        Distance there, m, and its sigma (k,).
    miss
        Vector (k, 3) to the other aircraft there.
    turn_rate
        Turn rate of the prediction, rad/s, positive right (k,).
    """

    time: Array
    time_sigma: Array
    distance: Array
    distance_sigma: Array
    miss: Array
    turn_rate: Array


def closest(r: Array, v: Array, covariance: Array) -> Approaches:
    """Return the closest approach on straight lines.

    Positions and velocities are relative (k, 3), with covariance (k, 6, 6). t = -r.v / v.v, at least 0, and the
    miss vector is m = r + v t; their covariances are to first order. The distance is |m|, and its sigma is that
    along m. If m is shorter than its own uncertainty, its direction is ill-defined, and the sigma is that of the
    whole vector.
    """
    speed2 = np.maximum(np.einsum("ki,ki->k", v, v), MIN_CLOSING_SPEED_M_S**2)
    closing = np.einsum("ki,ki->k", r, v)
    ahead = closing < 0
    time = np.where(ahead, -closing / speed2, 0.0)
    miss = r + time[:, None] * v
    # dt/dr = -v / v.v, dt/dv = -(r + 2 t v) / v.v; both 0 once past
    slope_r = np.where(ahead[:, None], -v / speed2[:, None], 0.0)
    slope_v = np.where(ahead[:, None], -(r + 2.0 * time[:, None] * v) / speed2[:, None], 0.0)
    slope = np.concatenate([slope_r, slope_v], axis=1)
    time_variance = np.einsum("ki,kij,kj->k", slope, covariance, slope)
    # dm = dr + t dv + v dt
    each = np.broadcast_to(np.eye(3), (len(r), 3, 3))
    J = np.concatenate([each, time[:, None, None] * each], axis=2) + v[:, :, None] * slope[:, None, :]
    C = np.einsum("kai,kij,kbj->kab", J, covariance, J)
    distance = np.linalg.norm(miss, axis=1)
    trace = np.einsum("kii->k", C)
    unit = miss / np.maximum(distance, 1e-9)[:, None]
    along = np.einsum("ki,kij,kj->k", unit, C, unit)
    variance = np.where(distance**2 > trace, along, trace)
    time_sigma, distance_sigma = np.sqrt(np.maximum(time_variance, 0.0)), np.sqrt(np.maximum(variance, 0.0))
    return Approaches(time, time_sigma, distance, distance_sigma, miss, np.zeros(len(r)))


def closest_in_turns(r: Array, v: Array, a: Array, covariance: Array, v_F: Array) -> Approaches:
    """Return the closest approach along the turns of certainly turning aircraft.

    For others it is that of `closest`. Positions, velocities and the others' accelerations (k, 3) have covariance
    (k, 9, 9), and the first two are relative; v_F (3,) is our own velocity. The sigmas in turns are of sigma
    points in position, velocity and turn rate: each point has a closest approach of its own, the first within
    `MAX_TURN_TIME_S`.
    """
    straight = closest(r, v, covariance[:, :6, :6])
    rate = motion.turn_rate(v + v_F, a)
    slope = _turn_rate_gradient(v + v_F, a, rate)
    both = np.concatenate([np.broadcast_to(np.eye(6, 9), (len(r), 6, 9)), slope[:, None, :]], axis=1)
    spread = both @ covariance @ np.swapaxes(both, 1, 2)
    turns = np.flatnonzero(np.abs(rate) > MIN_TURN_RATE_SIGMAS * np.sqrt(spread[:, 6, 6]))
    if not len(turns):
        return straight
    center = np.concatenate([r, v, rate[:, None]], axis=1)[turns]
    try:
        points = sigma_points(Belief(center, spread[turns]), weights(7))
    except FilterError:  # a covariance has been lost; the tracker will remove its track
        return straight
    found = arc.first_approach(points.reshape(-1, 7), v_F, MAX_TURN_TIME_S).reshape(len(turns), -1, 5)
    off = found[:, 1:, :2] - found[:, :1, :2]
    sigma = np.sqrt(np.mean(off**2, axis=1))
    values = (found[:, 0, 0], sigma[:, 0], found[:, 0, 1], sigma[:, 1], found[:, 0, 2:], rate[turns])
    for whole, part in zip(straight, values, strict=True):
        whole[turns] = part
    return straight


def _turn_rate_gradient(v: Array, a: Array, rate: Array) -> Array:
    """Return the gradient (k, 9) of `motion.turn_rate` by position, velocity and acceleration."""
    speed2 = np.maximum(v[:, 0] ** 2 + v[:, 1] ** 2, motion.TURN_RATE_MIN_SPEED_M_S**2)
    zero = np.zeros(len(v))
    by_v = (a[:, 1] - 2.0 * rate * v[:, 0], -a[:, 0] - 2.0 * rate * v[:, 1], zero)
    by_a = (-v[:, 1], v[:, 0], zero)
    return np.stack([zero, zero, zero, *by_v, *by_a], axis=1) / speed2[:, None]
