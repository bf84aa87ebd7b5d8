"""The motion of other aircraft.

A lateral acceleration turns the course; speed and climb are constant, with turbulence in the velocity. Frames are
those of `onboard.geometry`; O is the scenario's origin, T the aircraft.
"""

import math
from collections.abc import Iterator
from typing import Final, NamedTuple

from onboard.geometry.geodesy import rotation_ne
from onboard.messages import Vec3
from simlink.scenarios.traffic import Aircraft
from simlink.world.attitude import add
from simlink.world.constants import STEPS_PER_SECOND
from simlink.world.noise import gauss_markov_vectors, normals

STRIDE_STEPS: Final = 4  # steps of the world per step of the traffic: 50 Hz
STRIDE_TIME_S: Final = STRIDE_STEPS / STEPS_PER_SECOND

Matrix = list[list[float]]


class Motion(NamedTuple):
    """Position r_OT and velocity of an aircraft in n at the origin, m and m/s."""

    r: Vec3
    v: Vec3


def motions(aircraft: Aircraft, seed: int) -> Iterator[Motion]:
    """Yield the aircraft's motion at 50 Hz, without end."""
    draw = normals(seed, f"traffic.{aircraft.name}.start")
    spread = aircraft.start_sigma
    r = add(aircraft.start, (spread * next(draw), spread * next(draw), 0.2 * spread * next(draw)))
    course = math.radians(aircraft.course_deg + aircraft.course_sigma_deg * next(draw))
    turbulence = gauss_markov_vectors(seed, f"traffic.{aircraft.name}", aircraft.turbulence, STRIDE_TIME_S)
    lateral, t = aircraft.a_lat, 0.0
    before: Vec3 | None = None
    while True:
        gx, gy, gz = next(turbulence)
        v = (
            aircraft.speed * math.cos(course) + gx,
            aircraft.speed * math.sin(course) + gy,
            -aircraft.climb + 0.5 * gz,
        )
        if before is not None:
            half = 0.5 * STRIDE_TIME_S
            r = (
                r[0] + half * (v[0] + before[0]),
                r[1] + half * (v[1] + before[1]),
                r[2] + half * (v[2] + before[2]),
            )
        yield Motion(r, v)
        before = v
        phase = 2 * math.pi * t / lateral.period + math.radians(lateral.phase_deg)
        course += STRIDE_TIME_S * (lateral.mean + lateral.amplitude * math.sin(phase)) / aircraft.speed
        t += STRIDE_TIME_S


def level_at(lat_deg: float, lon_deg: float, origin: tuple[float, float, float]) -> Matrix:
    """Return the rotation from NED at the origin to NED at another place.

    Over 10 km the horizon tilts by 1.6 mrad.
    """
    rows = rotation_ne(lat_deg, lon_deg) @ rotation_ne(origin[0], origin[1]).T
    return rows.tolist()  # type: ignore[no-any-return]  # of an array


def rotate(matrix: Matrix, v: Vec3) -> Vec3:
    """Return matrix @ v."""
    x, y, z = (row[0] * v[0] + row[1] * v[1] + row[2] * v[2] for row in matrix)
    return x, y, z
