"""Attitudes of both aircraft of an encounter, as Euler angles (N, 3): roll, pitch, yaw (ZYX, rad), not wrapped."""

from typing import Final

import numpy as np

from onboard.messages import Vec3
from simlink.encounters.curves import Motion, blurred, level, waves, wobble
from simlink.scenarios.profiles import GaussMarkov
from simlink.sensors.arrays import Array
from simlink.world.constants import DT, G
from simlink.world.truth import hovering_angles

YAW_GAIN: Final = 3.0  # 1/s
YAW_RATE: Final = 1.5  # rad/s, at most
PITCH_SHARE: Final = 0.5  # of the pitch that a forward acceleration takes; the rest is a slower reaction


def multirotor_attitude(motion: Motion, nose: Array, wind: Array, drag: float, sail: float = 0.0) -> Array:
    """Of a multirotor whose thrust carries its weight, accelerates it, and overcomes drag (1/s times airspeed), of
    which `sail` is along its nose alone."""
    ahead, air = level(nose), motion.v - wind
    felt = motion.a + drag * air + sail * np.sum(ahead * air, axis=1)[:, None] * ahead
    return np.column_stack(hovering_angles((felt[:, 0], felt[:, 1], felt[:, 2]), nose, np))


def fixed_wing_attitude(motion: Motion, nose: Array) -> Array:
    """Of a fixed wing in coordinated flight, level: it banks as it turns."""
    right = np.cos(nose) * motion.a[:, 1] - np.sin(nose) * motion.a[:, 0]
    return np.column_stack([np.arctan2(right, G), np.zeros_like(nose), nose])


def follower_attitude(
    rng: np.random.Generator, seed: int, t: Array, motion: Motion, sight: Array, mount_rpy_deg: Vec3
) -> Array:
    """Of a follower that turns its camera to where it is to look (`sight` (N,), rad, not wrapped), roughly and no
    faster than it can, and leans as it accelerates. Its camera is mounted for the lean of steady flight: it looks
    level there."""
    _, up, aside = np.radians(mount_rpy_deg)
    aim = wobble(seed, "encounters.aim", GaussMarkov(sigma=rng.uniform(1.0, 4.0), time=6.0), len(t), np.pi / 180)
    yaw = slewed(blurred(sight + aim - aside, 0.5))
    a = np.stack([blurred(x, 0.4) for x in motion.a.T], axis=-1)
    ahead = np.cos(yaw) * a[:, 0] + np.sin(yaw) * a[:, 1]
    right = np.cos(yaw) * a[:, 1] - np.sin(yaw) * a[:, 0]
    roll, pitch = np.arctan(right / G), -up - PITCH_SHARE * np.arctan(ahead / G)
    sway = np.radians(rng.uniform(0.4, 1.2))
    return np.column_stack(
        [roll + waves(rng, t, sway, (3.1, 1.7)), pitch + waves(rng, t, sway, (2.7, 1.4)), yaw],
    )


def slewed(sight: Array) -> Array:
    """A yaw (N,) that follows a direction (N,) with limited gain and rate."""
    yaw, at = [], float(sight[0])
    for aim in sight.tolist():
        yaw.append(at)
        at += DT * min(max(YAW_GAIN * (aim - at), -YAW_RATE), YAW_RATE)
    return np.array(yaw)
