"""What is drawn of the aircraft and the sensors of an encounter, and the ranges it is drawn from.

No estimator is to be judged at its own settings, so each range lies around what the leader estimator supposes, and
has its reason from a measurement where there is one.
"""

from typing import Final, NamedTuple

import msgspec
import numpy as np

from simlink.scenarios.camera import Camera
from simlink.scenarios.profiles import GaussMarkov
from simlink.world.drawn import (
    ATTITUDE_ERROR_S,
    TILT_ERROR_DEG,
    VELOCITY_ERROR,
    VELOCITY_ERROR_S,
    YAW_ERROR_DEG,
    Range,
)

NOMINAL_SIZE: Final = 2.0  # m
SIZE_WITHIN: Final = 0.02  # of it: a manual states a wingspan without the bend and the tip that a detector finds

# A multirotor leans against the air: 0.22 / s at 12 m/s and 0.12 / s at 6 m/s, read off the leader's attitude in
# ../shared/data/formation-copter (a lean of 15 degrees at 12 m/s).
DRAG: Final[Range] = (0.08, 0.28)  # 1/s: deceleration by the air, per m/s of airspeed
# There, its bank is 1.5 degrees (rms) off that of its acceleration; the reference scenario of Oh & Johnson has 2.
BANK_WOBBLE_DEG: Final[Range] = (1.0, 3.0)
BANK_WOBBLE_S: Final[Range] = (0.6, 2.5)
# There, its nose is 3.8 degrees (rms) off its course, manoeuvres included; the reference scenario has 2.
NOSE_WOBBLE_DEG: Final[Range] = (0.5, 2.5)
NOSE_WOBBLE_S: Final[Range] = (2.0, 6.0)

# Detectors place a point to about a pixel; better on sharp tips, worse with motion blur.
IMAGE_NOISE_PX: Final[Range] = (0.6, 1.4)
IMAGE_HZ: Final[Range] = (12.0, 30.0)  # of detectors on small computers
LATENCY_S: Final[Range] = (0.020, 0.090)  # from exposure to arrival; 60 ms in ../shared/data
JITTER_S: Final = 0.005  # at most, on top of the latency
LOSE: Final[Range] = (0.005, 0.05)  # per image; the reference scenario of Oh & Johnson has .02
REGAIN: Final[Range] = (0.15, 0.6)  # per image; it has .38
SMALLEST_PX: Final[Range] = (4.0, 7.0)  # of the wingspan as seen broadside: what is smaller is not detected
# A camera sits on an arm or under the belly of a small multirotor. It looks past the propellers to a side, and up
# against the lean of flight: 15 degrees in ../shared/data/formation-copter.
MOUNT_OFFSET: Final[tuple[Range, Range, Range]] = ((-0.10, 0.30), (-0.15, 0.15), (-0.15, 0.15))  # m, body FRD
MOUNT_RPY_DEG: Final[tuple[Range, Range, Range]] = ((-6.0, 6.0), (-5.0, 15.0), (-30.0, 30.0))

# ArduPilot sends what was asked for only roughly: it holds few distinct intervals.
NAVIGATION_HZ: Final[Range] = (30.0, 60.0)
# LOCAL_POSITION_NED of an ArduPilot is 20 to 25 ms older than its stamp (../shared/data/README.md).
POSITION_LAG_S: Final[Range] = (0.015, 0.030)
TRANSPORT_S: Final[Range] = (0.001, 0.004)
# Filters of autopilots know the wind after a turn to half a metre a second, before it to two.
WIND_ERROR: Final[Range] = (0.5, 2.0)  # m/s, standard deviation on each axis
# The standard deviation that they state, over its own.
WIND_STATED: Final[Range] = (0.6, 1.5)


class Conditions(NamedTuple):
    """Of one encounter. Angles of wobbles and attitude errors are in degrees, all else is SI; `smallest_px` is in
    pixels."""

    size: float  # the leader's wingspan
    drag: float
    bank_wobble_deg: GaussMarkov
    nose_wobble_deg: GaussMarkov
    camera: Camera
    smallest_px: float
    attitude_hz: float
    position_hz: float
    position_lag: float
    transport: float
    tilt_error_deg: GaussMarkov
    yaw_error_deg: GaussMarkov
    velocity_error: GaussMarkov


def draw_conditions(rng: np.random.Generator) -> Conditions:
    """The conditions of one encounter."""

    def one(among: Range) -> float:
        return float(rng.uniform(*among))

    def process(sigma: Range, time: Range) -> GaussMarkov:
        return GaussMarkov(sigma=one(sigma), time=one(time))

    camera = Camera(
        rate=one(IMAGE_HZ),
        sigma_px=one(IMAGE_NOISE_PX),
        p_lose=one(LOSE),
        p_regain=one(REGAIN),
        latency=one(LATENCY_S),
    )
    drawn = Conditions(
        size=NOMINAL_SIZE * float(1.0 + rng.uniform(-SIZE_WITHIN, SIZE_WITHIN)),
        drag=one(DRAG),
        bank_wobble_deg=process(BANK_WOBBLE_DEG, BANK_WOBBLE_S),
        nose_wobble_deg=process(NOSE_WOBBLE_DEG, NOSE_WOBBLE_S),
        camera=camera,
        smallest_px=one(SMALLEST_PX),
        attitude_hz=one(NAVIGATION_HZ),
        position_hz=one(NAVIGATION_HZ),
        position_lag=one(POSITION_LAG_S),
        transport=one(TRANSPORT_S),
        tilt_error_deg=process(TILT_ERROR_DEG, ATTITUDE_ERROR_S),
        yaw_error_deg=process(YAW_ERROR_DEG, ATTITUDE_ERROR_S),
        velocity_error=process(VELOCITY_ERROR, VELOCITY_ERROR_S),
    )
    return drawn._replace(camera=mounted(camera, rng))


def mounted(camera: Camera, rng: np.random.Generator) -> Camera:
    """The camera at a place and an angle of its own."""
    x, y, z = (float(rng.uniform(*among)) for among in MOUNT_OFFSET)
    roll, pitch, yaw = (float(rng.uniform(*among)) for among in MOUNT_RPY_DEG)
    return msgspec.structs.replace(camera, mount_offset=(x, y, z), mount_rpy_deg=(roll, pitch, yaw))
