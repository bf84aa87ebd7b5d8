"""The paper's noise and first belief, eqs 43-54, in SI units. The paper prints feet.

The settings are about fifty times too large for a camera with an error of a pixel: the NEES of nine states is then
0.2, not 9. They are flown as printed.
"""

from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.filters.belief import Belief
from onboard.models import camera_angles, relative_motion
from onboard.models.relative_motion import POSITION, SIZE

FOOT_M: Final = 0.3048
POSITION_SIGMA_M: Final = 1 * FOOT_M  # of the first belief, as the next two: eq 51
VELOCITY_SIGMA_M_S: Final = 1 * FOOT_M
ACCELERATION_SIGMA_M_S2: Final = 10 * FOOT_M
ANGLES_DEG: Final = 5.0, 4.0, 3.0  # azimuth, elevation, subtended; eq 54
ANGLES: Final = np.diag(np.radians(ANGLES_DEG) ** 2)  # rad^2
HOVER_SPEED: Final = 1.0  # m/s, eps of eq 2: as printed, it is 0/0 when the leader hovers


class RandomWalks(NamedTuple):
    """Process noise densities: standard deviations that grow with the square root of the time in s."""

    position: float  # m
    velocity: float  # m/s
    size: float  # share of the size
    a_lat: float  # m/s^2
    a_long: float  # m/s^2


PRINTED: Final = RandomWalks(
    position=5 * FOOT_M, velocity=10 * FOOT_M, size=0.01, a_lat=2 * FOOT_M, a_long=2 * FOOT_M
)  # eqs 52-53


def process_noise(size: float, walks: RandomWalks = PRINTED) -> Array:
    """Return Q (9, 9) per second for a leader of wingspan `size` in m: eqs 52-53."""
    densities = [walks.position] * 3 + [walks.velocity] * 3 + [walks.size * size, walks.a_lat, walks.a_long]
    return np.diag(np.square(densities))


def first_belief(angles: Array, size: float, size_sigma: float, R_cn: Array, r_FC_n: Array) -> Belief:
    """Return mean (9,) and covariance (9, 9) after the first image: eqs 43-51.

    `angles` (3,) are in rad, `size` and its sigma in m; R_cn (3, 3) and r_FC_n (3,), m, are the camera's attitude
    and place. The leader is assumed to fly as we do.
    """
    mean = np.zeros(relative_motion.STATE_SIZE)
    mean[POSITION] = camera_angles.position_from_angles(angles[None], np.array([size]), R_cn, r_FC_n)[0]
    mean[SIZE] = size
    sigma = [POSITION_SIGMA_M] * 3 + [VELOCITY_SIGMA_M_S] * 3 + [size_sigma] + [ACCELERATION_SIGMA_M_S2] * 2
    return Belief(mean, np.diag(np.square(sigma)))
