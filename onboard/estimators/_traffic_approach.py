"""How near another aircraft comes if neither changes its velocity, when, and how sure that is."""

from typing import NamedTuple

import numpy as np

from onboard.geometry.rotations import Array

SLOWEST = 1e-3  # m/s; two aircraft that move together are as near as they will be


class Approaches(NamedTuple):
    """For each of k tracks: time (s) to the closest approach and its sigma, distance there (m) and its sigma, and
    the vector (k, 3) to the other aircraft there."""

    time: Array
    time_sigma: Array
    distance: Array
    distance_sigma: Array
    miss: Array


def closest(r: Array, v: Array, covariance: Array) -> Approaches:
    """Closest approach of relative positions and velocities (k, 3) with covariance (k, 6, 6).

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
    return Approaches(
        time, np.sqrt(np.maximum(time_variance, 0.0)), distance, np.sqrt(np.maximum(variance, 0.0)), miss
    )
