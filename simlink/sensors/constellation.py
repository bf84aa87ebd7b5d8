"""The 24 slots of GPS in six orbital planes, and the positions of their satellites in e.

Circular orbits from the nominal constellation of the GPS SPS Performance Standard (2001, table 3-1 and A-2.1.1),
an almanac without eccentricities and clocks. The slow drift of the planes (4e-7 deg/s) is neglected.
"""

from typing import NamedTuple

import numpy as np

from simlink.sensors.arrays import Array

ORBIT_RADIUS = 26559.7e3  # m
INCLINATION_ANGLE_DEG = 55.0
GREENWICH_HOUR_ANGLE_DEG = 15 * (18 + 36 / 60 + 14.4 / 3600)  # at the epoch, 1993-07-01 00:00
EARTH_RATE = 7.2921151467e-5  # rad/s
GRAVITATIONAL_CONSTANT = 3.986005e14  # m^3/s^2, times the Earth's mass
# right ascension of the ascending node of planes A-F, and arguments of latitude of their slots 1-4, at the epoch
NODE_DEG = (272.847, 332.847, 32.847, 92.847, 152.847, 212.847)
ARGUMENT_DEG = (
    (268.126, 161.786, 11.676, 41.806),
    (80.956, 173.336, 309.976, 204.376),
    (111.876, 11.796, 339.666, 241.556),
    (135.226, 265.446, 35.156, 167.356),
    (197.046, 302.596, 66.066, 333.686),
    (238.886, 345.226, 105.206, 135.346),
)
SLOTS = tuple(f"{plane}{slot}" for plane in "ABCDEF" for slot in range(1, 5))


class Satellites(NamedTuple):
    """Positions and velocities (24, 3) in e (m, m/s) of the satellites, in the order of SLOTS."""

    position: Array
    velocity: Array


def satellites(t: float) -> Satellites:
    """All 24 satellites, `t` seconds after the epoch.

    The velocity is relative to the rotating Earth.
    """
    motion = np.sqrt(GRAVITATIONAL_CONSTANT / ORBIT_RADIUS**3)
    u = np.radians(np.ravel(ARGUMENT_DEG)) + motion * t
    node = np.radians(np.repeat(NODE_DEG, 4) - GREENWICH_HOUR_ANGLE_DEG) - EARTH_RATE * t
    cos_i, sin_i = np.cos(np.radians(INCLINATION_ANGLE_DEG)), np.sin(np.radians(INCLINATION_ANGLE_DEG))
    along, up, across = np.cos(u), np.sin(u) * sin_i, np.sin(u) * cos_i
    d_along, d_up, d_across = -np.sin(u), np.cos(u) * sin_i, np.cos(u) * cos_i
    c, s = np.cos(node), np.sin(node)
    position = ORBIT_RADIUS * np.column_stack([along * c - across * s, along * s + across * c, up])
    velocity = (
        ORBIT_RADIUS * motion * np.column_stack([d_along * c - d_across * s, d_along * s + d_across * c, d_up])
    )
    velocity += EARTH_RATE * np.column_stack([position[:, 1], -position[:, 0], np.zeros(len(u))])
    return Satellites(position, velocity)
