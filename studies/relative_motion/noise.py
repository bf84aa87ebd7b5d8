"""Noise settings of the study's nine-state filters: the paper's as printed, and honest ones."""

from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.estimators.oh_johnson import noise as printed
from onboard.estimators.oh_johnson.noise import FOOT_M, RandomWalks, first_belief
from onboard.filters.belief import Belief
from onboard.filters.unscented_transform import julier_weights, recombine, sigma_points
from onboard.models import camera_angles, relative_motion
from onboard.models.relative_motion import POSITION, SIZE


class Noise(NamedTuple):
    """The noise settings of Oh & Johnson's filter: process noise, and standard deviations."""

    walks: RandomWalks  # eqs 52-53
    ties_size_to_range: bool  # in the first belief, which follows from the first image's noise; else the paper's
    initial_velocity: float  # m/s
    initial_acceleration: float  # m/s^2
    angles_deg: tuple[float, float, float] | None  # of the measurement; None: from the pixels' own
    gate_probability: float | None  # None: no gate
    hover_speed: float  # m/s, `eps` of `relative_motion.leader_acceleration`
    consider_size: bool  # carry the size's uncertainty, but let no image correct it


PAPER: Final = Noise(
    walks=printed.PRINTED,
    ties_size_to_range=False,
    initial_velocity=printed.VELOCITY_SIGMA_M_S,
    initial_acceleration=printed.ACCELERATION_SIGMA_M_S2,
    angles_deg=printed.ANGLES_DEG,
    gate_probability=None,
    hover_speed=0.0,
    consider_size=False,
)

# A fixed-wing leader, as the paper's: only the model's two accelerations change its velocity much.
HONEST: Final = Noise(
    walks=RandomWalks(
        position=0.02 * FOOT_M, velocity=0.1 * FOOT_M, size=1e-5, a_lat=1 * FOOT_M, a_long=0.3 * FOOT_M
    ),
    ties_size_to_range=True,
    initial_velocity=12 * FOOT_M,
    initial_acceleration=10 * FOOT_M,
    angles_deg=None,
    gate_probability=0.999,
    hover_speed=1.0,
    consider_size=True,
)

MULTIROTOR_VELOCITY: Final = 0.3  # m/s / sqrt(s): it accelerates and stops along its track, unknown to the model


def honest_noise(leader_class: str) -> Noise:
    """The honest settings for a leader of class "fixed_wing" or "multirotor"."""
    if leader_class == "multirotor":
        return HONEST._replace(walks=HONEST.walks._replace(velocity=MULTIROTOR_VELOCITY))
    return HONEST


def initial_belief(
    noise: Noise,
    angles: Array,
    angle_noise: Array,
    size: float,
    size_sigma: float,
    R_cn: Array,
    r_FC_n: Array,
) -> Belief:
    """The belief (9,), (9, 9) after one image: eqs 43-51.

    Angles (3,) rad with noise (3, 3), the prior size and its sigma in m, the camera's attitude R_cn (3, 3) and
    place r_FC_n (3,).

    The paper's, or, with `ties_size_to_range`, one whose position's covariance follows from the angles and the
    size by an unscented transform, which keeps the correlation of range and size.
    """
    if not noise.ties_size_to_range:
        return first_belief(angles, size, size_sigma, R_cn, r_FC_n)
    sigma = [noise.initial_velocity] * 3 + [size_sigma] + [noise.initial_acceleration] * 2
    P = np.diag(np.array([0.0, 0.0, 0.0, *sigma]) ** 2)
    mean = np.zeros(relative_motion.STATE_SIZE)
    mean[SIZE] = size
    covariance = np.zeros((4, 4))
    covariance[:3, :3], covariance[3, 3] = angle_noise, size_sigma**2
    weights = julier_weights(4)
    rows = sigma_points(Belief(np.append(angles, size), covariance), weights)
    positions = camera_angles.position_from_angles(rows[:, :3], rows[:, 3], R_cn, r_FC_n)
    joint = recombine(np.column_stack([positions, rows[:, 3]]), weights, np.zeros((4, 4)))
    mean[POSITION] = joint.mean[:3]
    P[POSITION, POSITION] = joint.covariance[:3, :3]
    P[POSITION, SIZE] = P[SIZE, POSITION] = joint.covariance[:3, 3]
    return Belief(mean, P)
