"""Ranges of the random parameters of an encounter's aircraft and sensors.

No estimator may be judged at its own settings, so each range lies around the value that the leader estimator
assumes. A comment at each range names the measurement behind it, where there is one.
"""

from typing import Final, Literal, NamedTuple

import numpy as np

from onboard.geometry.lens import Model
from onboard.messages import Vec3
from simlink.scenarios.camera import Camera, Gimbal
from simlink.scenarios.formation import Leader
from simlink.scenarios.profiles import GaussMarkov
from simlink.scenarios.scenario import Scenario
from simlink.scenarios.vehicle import Nav, Rates, Vehicle
from simlink.world.drawn import Range

NOMINAL_SIZE: Final = 2.0  # m
MAX_SIZE_ERROR: Final = (
    0.02  # relative: a manual states a wingspan without the bend and the tips that a detector finds
)

# A multirotor leans against the air: 0.22 / s at 12 m/s and 0.12 / s at 6 m/s, read off the leader's attitude in
# ../shared/data/formation-copter (a lean of 15 degrees at 12 m/s). A heavy lifter with small discs leans a few
# degrees at that speed (0.03 / s), a light frame with large propellers or a payload that hangs some 30 (0.5 / s).
DRAG: Final[Range] = (0.03, 0.5)  # 1/s: deceleration by the air, per m/s of airspeed
# There, its bank is 1.5 degrees (rms) off that of its acceleration; the reference scenario of Oh & Johnson has 2.
BANK_WOBBLE_DEG: Final[Range] = (1.0, 3.0)
BANK_WOBBLE_S: Final[Range] = (0.6, 2.5)
# There, its nose is 3.8 degrees (rms) off its course, manoeuvres included; the reference scenario has 2.
NOSE_WOBBLE_DEG: Final[Range] = (0.5, 2.5)
NOSE_WOBBLE_S: Final[Range] = (2.0, 6.0)

# Detectors place a point to about a pixel; better on sharp tips, worse with motion blur.
IMAGE_NOISE_PX: Final[Range] = (0.6, 1.4)
# Of detectors on small computers, from a large network on a Raspberry Pi to a small one on a GPU.
IMAGE_RATE_HZ: Final[Range] = (4.0, 30.0)
# Beside pinholes (images that are undistorted before), lenses as their calibrations describe them: M12 lenses of
# 60 degrees bend a corner of the image in by up to a tenth; fisheyes of 90 to 120 degrees follow the equidistant
# model to some percent. Focal lengths of an image of 640 x 480 px.
PINHOLE_SHARE: Final = 0.5  # of the cameras
FISHEYE_SHARE: Final = 0.25
LENS_DISTORTION: Final[tuple[Range, Range, Range]] = (
    (-0.30, 0.10),
    (0.0, 0.10),
    (-1e-3, 1e-3),
)  # k1, k2, p1 and p2
FISHEYE_FOCAL_LENGTH_PX: Final[Range] = (300.0, 420.0)
FISHEYE_K1: Final[Range] = (-0.03, 0.03)
LATENCY_S: Final[Range] = (0.020, 0.090)  # from exposure to arrival; 60 ms in ../shared/data
LOSS_PROBABILITY: Final[Range] = (0.005, 0.05)  # per image; the reference scenario of Oh & Johnson has .02
REGAIN_PROBABILITY: Final[Range] = (0.15, 0.6)  # per image; theirs is .38
MIN_SIZE_PX: Final[Range] = (4.0, 7.0)  # smallest wingspan, as seen broadside, that is detected
# A camera sits on an arm or under the belly of a small multirotor. It looks past the propellers to a side, and up
# against the lean of flight: 15 degrees in ../shared/data/formation-copter.
MOUNT_OFFSET: Final[tuple[Range, Range, Range]] = ((-0.10, 0.30), (-0.15, 0.15), (-0.15, 0.15))  # m, body FRD
MOUNT_RPY_DEG: Final[tuple[Range, Range, Range]] = ((-6.0, 6.0), (-5.0, 15.0), (-30.0, 30.0))

# How often attitude and position come. An ArduPilot sends what was asked for only roughly: it holds few distinct
# intervals. Unasked, or where a ground station on the same link asks, they come 4 to 10 times a second (Mission
# Planner and MAVProxy ask for 4, SRx_EXTRA1 and SRx_POSITION of companion set-ups are 10). A PX4 sends its onboard
# set of streams: attitude at 100 Hz and position at 30 Hz, fewer where the link is full.
AUTOPILOTS: Final[tuple[tuple[Literal["ardupilot", "px4"], Range, Range], ...]] = (
    ("ardupilot", (30.0, 60.0), (30.0, 60.0)),
    ("ardupilot", (4.0, 10.0), (4.0, 10.0)),
    ("px4", (60.0, 100.0), (25.0, 30.0)),
)
# LOCAL_POSITION_NED of an ArduPilot is 20 to 25 ms older than its stamp (../shared/data/README.md).
POSITION_LAG_S: Final[Range] = (0.015, 0.030)
# A small gimbal finds the horizon by its accelerometers, as an autopilot does, and its yaw by gyros alone, which
# drift by 10 to 50 degrees an hour; motor encoders and belts leave some tenths of a degree more.
GIMBAL_TILT_ERROR_DEG: Final[Range] = (0.2, 0.8)  # standard deviations
GIMBAL_YAW_ERROR_DEG: Final[Range] = (0.5, 1.6)
SWEEP_AMPLITUDE_DEG: Final[tuple[Range, Range]] = ((4.0, 14.0), (2.0, 6.0))  # in yaw and pitch
SWEEP_PERIOD_S: Final[tuple[Range, Range]] = ((4.0, 9.0), (2.5, 6.0))
GIMBAL_RATE_HZ: Final[Range] = (8.0, 30.0)
GIMBAL_LATENCY_S: Final[Range] = (0.002, 0.03)


class Conditions(NamedTuple):
    """The leader's drag (1/s), and the scenario of one encounter."""

    drag: float
    scenario: Scenario


def draw_conditions(rng: np.random.Generator) -> Conditions:
    """Draw the conditions of one encounter, without the errors of our own state.

    Each run draws those itself (`simlink.world.drawn`).
    """

    def process(sigma: Range, time: Range) -> GaussMarkov:
        return GaussMarkov(sigma=_one(rng, sigma), time=_one(rng, time))

    lens = _lens(rng)
    camera = Camera(
        f_px=lens.f_px,
        distortion_model=lens.model,
        distortion=lens.distortion,
        rate=_one(rng, IMAGE_RATE_HZ),
        sigma_px=_one(rng, IMAGE_NOISE_PX),
        states_sigma=False,
        p_lose=_one(rng, LOSS_PROBABILITY),
        p_regain=_one(rng, REGAIN_PROBABILITY),
        latency=_one(rng, LATENCY_S),
        smallest_px=_one(rng, MIN_SIZE_PX),
        mount_offset=_three(rng, MOUNT_OFFSET),
        mount_rpy_deg=_three(rng, MOUNT_RPY_DEG),
    )
    leader = Leader(
        size=NOMINAL_SIZE * (1.0 + _one(rng, (-MAX_SIZE_ERROR, MAX_SIZE_ERROR))),
        size_sigma_percent=0.0,
        bank_wobble_deg=process(BANK_WOBBLE_DEG, BANK_WOBBLE_S),
        heading_wobble_deg=process(NOSE_WOBBLE_DEG, NOSE_WOBBLE_S),
    )
    # what else an autopilot sends the leader's estimator does not read
    autopilot, attitude_hz, position_hz = AUTOPILOTS[int(rng.integers(len(AUTOPILOTS)))]
    rates = Rates(
        attitude=_one(rng, attitude_hz),
        local_position=_one(rng, position_hz),
        global_position=0.0,
        gps=0.0,
        imu=0.0,
        servo=0.0,
    )
    scenario = Scenario(
        own_errors=True,
        leader=leader,
        camera=camera,
        nav=Nav(position_delay=_one(rng, POSITION_LAG_S) if autopilot == "ardupilot" else 0.0),
        vehicle=Vehicle(type="quadrotor", autopilot=autopilot, rates=rates),
    )
    return Conditions(_one(rng, DRAG), scenario)


class _Lens(NamedTuple):
    f_px: float
    model: Model
    distortion: tuple[float, ...]


def _lens(rng: np.random.Generator) -> _Lens:
    kind, f_px = rng.uniform(), Camera().f_px
    if kind < PINHOLE_SHARE:
        return _Lens(f_px, "radial-tangential", ())
    if kind < PINHOLE_SHARE + FISHEYE_SHARE:
        return _Lens(_one(rng, FISHEYE_FOCAL_LENGTH_PX), "fisheye", (_one(rng, FISHEYE_K1), 0.0, 0.0, 0.0))
    k1, k2, p1, p2 = (_one(rng, LENS_DISTORTION[i]) for i in (0, 1, 2, 2))
    return _Lens(f_px, "radial-tangential", (k1, k2, p1, p2))


def draw_gimbal(rng: np.random.Generator) -> Gimbal:
    """Draw the gimbal of one encounter."""
    yaw, pitch = (_one(rng, among) for among in SWEEP_AMPLITUDE_DEG)
    slow, fast = (_one(rng, among) for among in SWEEP_PERIOD_S)
    return Gimbal(
        sweep_deg=(yaw, pitch),
        period=(slow, fast),
        phase_deg=(_one(rng, (0.0, 360.0)), _one(rng, (0.0, 360.0))),
        rate=_one(rng, GIMBAL_RATE_HZ),
        latency=_one(rng, GIMBAL_LATENCY_S),
        error_deg=_one(rng, GIMBAL_TILT_ERROR_DEG),
        yaw_error_deg=_one(rng, GIMBAL_YAW_ERROR_DEG),
    )


def _one(rng: np.random.Generator, among: Range) -> float:
    return float(rng.uniform(*among))


def _three(rng: np.random.Generator, among: tuple[Range, Range, Range]) -> Vec3:
    x, y, z = (_one(rng, one) for one in among)
    return x, y, z
