"""What the leader's filter assumes of noise, and its first belief: the paper's settings, and honest ones."""

from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.filters.belief import Belief
from onboard.filters.unscented_transform import julier_weights, recombine, sigma_points
from onboard.models import camera_angles, relative_motion
from onboard.models.relative_motion import SIZE, R

FT: Final = 0.3048


class Noise(NamedTuple):
    """Standard deviations. Walks are per square root of a second (Q = dt diag(walk^2), eqs 52-53); the size's
    is relative to its prior. `angles_deg` None: the measurement noise follows from the pixels' own."""

    position_walk: float  # m
    velocity_walk: float  # m/s
    size_walk: float  # fraction of the size
    a_lat_walk: float  # m/s^2
    a_long_walk: float  # m/s^2
    initial_position: float | None  # m; None: from the first image, with the range-size correlation kept
    initial_velocity: float  # m/s
    initial_acceleration: float  # m/s^2
    angles_deg: tuple[float, float, float] | None
    gate_probability: float | None
    hover_speed: float  # m/s
    initialise_images: int | None  # None: as configured
    consider_size: bool  # carry the size's uncertainty, but let no image move it


PAPER: Final = Noise(
    position_walk=5 * FT,
    velocity_walk=10 * FT,
    size_walk=0.01,
    a_lat_walk=2 * FT,
    a_long_walk=2 * FT,
    initial_position=1 * FT,
    initial_velocity=1 * FT,
    initial_acceleration=10 * FT,
    angles_deg=(5.0, 4.0, 3.0),
    gate_probability=None,
    hover_speed=0.0,
    initialise_images=1,
    consider_size=False,
)

# A fixed-wing leader, as the paper's: its speed hardly changes but by the two accelerations of the model.
HONEST: Final = Noise(
    position_walk=0.02 * FT,
    velocity_walk=0.1 * FT,
    size_walk=1e-5,
    a_lat_walk=1 * FT,
    a_long_walk=0.3 * FT,
    initial_position=None,
    initial_velocity=12 * FT,
    initial_acceleration=10 * FT,
    angles_deg=None,
    gate_probability=0.999,
    hover_speed=1.0,
    initialise_images=None,
    consider_size=True,
)

# A multirotor speeds up and stops along its track, which the model does not know.
MULTIROTOR_VELOCITY_WALK: Final = 0.3


def noise_for(noise: str, leader_class: str) -> Noise:
    """The settings named "paper" or "honest", for a leader of class "fixed_wing" or "multirotor"."""
    if noise == "paper":
        return PAPER
    if leader_class == "multirotor":
        return HONEST._replace(velocity_walk=MULTIROTOR_VELOCITY_WALK)
    return HONEST


OVERRIDABLE: Final = (
    "position_walk",
    "velocity_walk",
    "size_walk",
    "a_lat_walk",
    "a_long_walk",
    "initial_velocity",
    "initial_acceleration",
    "gate_probability",
    "hover_speed",
)


def overridden(noise: Noise, overrides: dict[str, float]) -> Noise:
    """Noise with single settings replaced.

    Raises ValueError for a name that is none of them, or a value that is not positive.
    """
    for name, value in overrides.items():
        if name not in OVERRIDABLE:
            raise ValueError(f"unknown key process_noise.{name}; known: {', '.join(OVERRIDABLE)}")
        if not value > 0:
            raise ValueError(f"process_noise.{name} must be positive, not {value}")
        if name == "gate_probability" and not value < 1:
            raise ValueError(f"process_noise.{name} must be below 1, not {value}")
        noise = noise._replace(**{name: value})  # type: ignore[arg-type]  # every name above is a float's
    return noise


def process_noise(noise: Noise, size: float) -> Array:
    """Q (9,) per second, the diagonal of eq 53."""
    walks = [noise.position_walk] * 3 + [noise.velocity_walk] * 3
    return np.array([*walks, noise.size_walk * size, noise.a_lat_walk, noise.a_long_walk]) ** 2


def initial_belief(
    noise: Noise,
    angles: Array,
    angle_noise: Array,
    size: float,
    size_sigma: float,
    R_cn: Array,
    r_FC_n: Array,
) -> Belief:
    """The belief after one image: eqs 43-51. With `initial_position` None the position's covariance is carried
    over from the angles and the size instead, which keeps what ties the range to the size."""
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
