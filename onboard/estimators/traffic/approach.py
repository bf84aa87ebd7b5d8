"""How near another aircraft comes, when, and how sure that is: if neither changes its velocity, or if it goes on
with the turn it is in and we fly straight on."""

from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.filters.belief import Belief, FilterError
from onboard.filters.cubature import weights
from onboard.filters.unscented import sigma_points
from onboard.models import arc, intruder

SLOWEST: Final = 1e-3  # m/s; two aircraft that move together are as near as they will be
TURNS: Final = 3.0  # sigmas of its turn rate: less, and it may as well fly straight
HORIZON: Final = 60.0  # s; nobody keeps a turn for longer


class Approaches(NamedTuple):
    """For each of k tracks: time (s) to the closest approach and its sigma, distance there (m) and its sigma, the
    vector (k, 3) to the other aircraft there, and the turn rate (rad/s, to the right) it is foretold with."""

    time: Array
    time_sigma: Array
    distance: Array
    distance_sigma: Array
    miss: Array
    turn_rate: Array


def closest(r: Array, v: Array, covariance: Array) -> Approaches:
    """Closest approach of relative positions and velocities (k, 3) with covariance (k, 6, 6), on straight lines.

    t = -r.v / v.v, at least 0, and the miss vector m = r + v t; their covariances to first order. The distance is
    |m|; its sigma is that along m, and where m is shorter than its own uncertainty, so that it has no direction to
    speak of, that of the whole vector.
    """
    speed2 = np.maximum(np.einsum("ki,ki->k", v, v), SLOWEST**2)
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
    """`closest`, of relative positions and velocities and of the others' accelerations (k, 3) with covariance
    (k, 9, 9), but of those that turn, beyond doubt, along their turns; v_F (3,) is our own velocity.

    There the sigmas are those of sigma points in position, velocity and turn rate: each has a closest approach of
    its own, the first within a minute.
    """
    straight = closest(r, v, covariance[:, :6, :6])
    rate = intruder.turn_rate(v + v_F, a)
    slope = _slopes(v + v_F, a, rate)
    both = np.concatenate([np.broadcast_to(np.eye(6, 9), (len(r), 6, 9)), slope[:, None, :]], axis=1)
    spread = both @ covariance @ np.swapaxes(both, 1, 2)
    turns = np.flatnonzero(np.abs(rate) > TURNS * np.sqrt(spread[:, 6, 6]))
    if not len(turns):
        return straight
    center = np.concatenate([r, v, rate[:, None]], axis=1)[turns]
    try:
        points = sigma_points(Belief(center, spread[turns]), weights(7))
    except FilterError:  # a covariance that has been lost; its track is about to be
        return straight
    found = arc.first_approach(points.reshape(-1, 7), v_F, HORIZON).reshape(len(turns), -1, 5)
    off = found[:, 1:, :2] - found[:, :1, :2]
    sigma = np.sqrt(np.mean(off**2, axis=1))
    values = (found[:, 0, 0], sigma[:, 0], found[:, 0, 1], sigma[:, 1], found[:, 0, 2:], rate[turns])
    for whole, part in zip(straight, values, strict=True):
        whole[turns] = part
    return straight


def _slopes(v: Array, a: Array, rate: Array) -> Array:
    """Gradient (k, 9) of `intruder.turn_rate` with respect to position, velocity and acceleration."""
    speed2 = np.maximum(v[:, 0] ** 2 + v[:, 1] ** 2, intruder.SLOWEST**2)
    nothing = np.zeros(len(v))
    by_v = (a[:, 1] - 2.0 * rate * v[:, 0], -a[:, 0] - 2.0 * rate * v[:, 1], nothing)
    by_a = (-v[:, 1], v[:, 0], nothing)
    return np.stack([nothing, nothing, nothing, *by_v, *by_a], axis=1) / speed2[:, None]
