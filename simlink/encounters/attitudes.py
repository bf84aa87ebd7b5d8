"""Attitudes of both aircraft of an encounter.

Euler angles are (N, 3) arrays of roll, pitch and yaw (ZYX, rad), not wrapped.
"""

from typing import Final

import numpy as np

from onboard.messages import Vec3
from simlink.encounters.curves import Motion, heading_vector, moving_average, waves, wobble
from simlink.scenarios.profiles import GaussMarkov
from simlink.sensors.arrays import Array
from simlink.world.constants import DT, GRAVITY
from simlink.world.truth import hovering_angles

YAW_GAIN: Final = 3.0  # 1/s
MAX_YAW_RATE: Final = 1.5  # rad/s
PITCH_SHARE: Final = 0.5  # of the pitch for a forward acceleration; a slower reaction gives the rest


def multirotor_attitude(motion: Motion, nose: Array, wind: Array, drag: float, sail: float = 0.0) -> Array:
    """Return a multirotor's Euler angles, by the balance of thrust and other forces.

    `drag` (1/s) acts against the airspeed in all directions, `sail` (1/s) along the nose only.
    """
    ahead, air = heading_vector(nose), motion.v - wind
    felt = motion.a + drag * air + sail * np.sum(ahead * air, axis=1)[:, None] * ahead
    return np.column_stack(hovering_angles((felt[:, 0], felt[:, 1], felt[:, 2]), nose, np))


def fixed_wing_attitude(motion: Motion, nose: Array) -> Array:
    """Return the Euler angles of a fixed wing in level, coordinated flight."""
    right = np.cos(nose) * motion.a[:, 1] - np.sin(nose) * motion.a[:, 0]
    return np.column_stack([np.arctan2(right, GRAVITY), np.zeros_like(nose), nose])


def follower_attitude(
    rng: np.random.Generator, seed: int, t: Array, motion: Motion, sight: Array, mount_rpy_deg: Vec3
) -> Array:
    """Return the Euler angles of a follower that keeps its camera pointed at the leader.

    It turns towards `sight` (N,), the azimuth of the leader (rad, not wrapped), with an aiming error and limited
    rate, and tilts as it accelerates. The camera mount compensates the tilt of steady flight.
    """
    _, up, aside = np.radians(mount_rpy_deg)
    aim = wobble(seed, "encounters.aim", GaussMarkov(sigma=rng.uniform(1.0, 4.0), time=6.0), len(t), np.pi / 180)
    yaw = limit_slew(moving_average(sight + aim - aside, 0.5))
    a = np.stack([moving_average(x, 0.4) for x in motion.a.T], axis=-1)
    ahead = np.cos(yaw) * a[:, 0] + np.sin(yaw) * a[:, 1]
    right = np.cos(yaw) * a[:, 1] - np.sin(yaw) * a[:, 0]
    roll, pitch = np.arctan(right / GRAVITY), -up - PITCH_SHARE * np.arctan(ahead / GRAVITY)
    sway = np.radians(rng.uniform(0.4, 1.2))
    return np.column_stack(
        [roll + waves(rng, t, sway, (3.1, 1.7)), pitch + waves(rng, t, sway, (2.7, 1.4)), yaw],
    )


def limit_slew(sight: Array) -> Array:
    """Return a yaw (N,) that follows a direction (N,) with limited gain and rate."""
    yaw, at = [], float(sight[0])
    for aim in sight.tolist():
        yaw.append(at)
        at += DT * min(max(YAW_GAIN * (aim - at), -MAX_YAW_RATE), MAX_YAW_RATE)
    return np.array(yaw)
