"""Process noise and first belief of Oh & Johnson's filter, from its settings."""

import numpy as np

from onboard.arrays import Array
from onboard.estimators.leader.settings import Noise
from onboard.filters.belief import Belief
from onboard.filters.unscented_transform import julier_weights, recombine, sigma_points
from onboard.models import camera_angles, relative_motion
from onboard.models.relative_motion import SIZE, R


def process_noise(noise: Noise, size: float) -> Array:
    """Q (9,) per second, the diagonal of eq 53, with a prior `size` in m."""
    densities = [noise.position_random_walk] * 3 + [noise.velocity_random_walk] * 3
    densities += [noise.size_random_walk * size, noise.a_lat_random_walk, noise.a_long_random_walk]
    return np.array(densities) ** 2


def initial_belief(
    noise: Noise,
    angles: Array,
    angle_noise: Array,
    size: float,
    size_sigma: float,
    R_cn: Array,
    r_FC_n: Array,
) -> Belief:
    """The belief (9,), (9, 9) after one image: eqs 43-51. Angles (3,) rad with noise (3, 3), the prior size and
    its sigma in m, the camera's attitude R_cn (3, 3) and place r_FC_n (3,).

    With `initial_position` None the position's covariance follows from the angles and the size, by an unscented
    transform, which keeps the correlation of range and size.
    """
    sigma = [noise.initial_velocity] * 3 + [size_sigma] + [noise.initial_acceleration] * 2
    P = np.diag(np.array([0.0, 0.0, 0.0, *sigma]) ** 2)
    mean = np.zeros(relative_motion.N)
    mean[SIZE] = size
    if noise.initial_position is not None:
        mean[R] = camera_angles.position_from_angles(angles[None], np.array([size]), R_cn, r_FC_n)[0]
        P[R, R] = np.eye(3) * noise.initial_position**2
        return Belief(mean, P)
    covariance = np.zeros((4, 4))
    covariance[:3, :3], covariance[3, 3] = angle_noise, size_sigma**2
    weights = julier_weights(4)
    rows = sigma_points(Belief(np.append(angles, size), covariance), weights)
    positions = camera_angles.position_from_angles(rows[:, :3], rows[:, 3], R_cn, r_FC_n)
    joint = recombine(np.column_stack([positions, rows[:, 3]]), weights, np.zeros((4, 4)))
    mean[R] = joint.mean[:3]
    P[R, R] = joint.covariance[:3, :3]
    P[R, SIZE] = P[SIZE, R] = joint.covariance[:3, 3]
    return Belief(mean, P)
