"""Our own vehicle in a scenario: its autopilot and the errors of its sensors."""

from typing import Annotated, Literal

import msgspec

from onboard.messages import NotNegative, Record, Vec3
from simlink.scenarios.profiles import GaussMarkov, Interval, Probability, Rate


class Nav(Record, frozen=True, kw_only=True):
    """Errors of the autopilot's own state estimate, per axis, in deg, m/s and m."""

    attitude_deg: GaussMarkov = GaussMarkov(time=10.0)
    yaw_deg: GaussMarkov | None = None  # about b's z axis, if it differs; only on the wire
    velocity: GaussMarkov = GaussMarkov(time=5.0)
    position: GaussMarkov = GaussMarkov(time=10.0)
    acceleration_white: NotNegative = 0.0  # m/s^2, only in the studies' `fly`
    acceleration_bias: NotNegative = 0.0  # m/s^2, drawn once a run, only in the studies' `fly`
    position_delay: NotNegative = 0.0  # s: LOCAL_POSITION_NED is that much older than its stamp
    attitude_white: Vec3 = (0.0, 0.0, 0.0)  # rad, per message and body axis
    rates_white: NotNegative = 0.0  # rad/s, of the body rates in the attitude message


class Outliers(Record, frozen=True, kw_only=True):
    """Single wrong values in attitude, body rates and GPS.

    From `start` (s) on, at each step and with this probability, a channel is wrong by `sigmas` times its white
    noise.
    """

    probability: Probability = 0.0
    sigmas: NotNegative = 20.0
    start: NotNegative = 0.0


class ImuErrors(Record, frozen=True, kw_only=True):
    """White noise per sample and a bias drawn once a run, per axis."""

    accel_white: NotNegative = 0.02  # m/s^2
    gyro_white: NotNegative = 0.002  # rad/s
    accel_bias: NotNegative = 0.0  # m/s^2
    gyro_bias: NotNegative = 0.0  # rad/s


class BarometerErrors(Record, frozen=True, kw_only=True):
    """Errors of the barometer's altitude, which is sampled 50 times a second."""

    white: NotNegative = 0.15  # m
    drift: GaussMarkov = GaussMarkov(sigma=0.5, time=100.0)  # m
    stretch: NotNegative = (
        0.02  # scale error of heights above the origin, as the air is not the standard atmosphere
    )


class Gps(Record, frozen=True, kw_only=True):
    """Errors of the raw GPS fixes, and intervals without a fix."""

    position: GaussMarkov = GaussMarkov(sigma=1.0, time=30.0)  # m, per axis
    position_white: Vec3 = (0.0, 0.0, 0.0)  # m
    velocity_white: NotNegative = 0.1  # m/s
    vertical_velocity_white: NotNegative = 0.3  # m/s, in records only: MAVLink has no vertical velocity
    delay: NotNegative = 0.0  # s, age of the fix at its stamp
    outages: tuple[Interval, ...] = ()


class Rates(Record, frozen=True, kw_only=True):
    """Rates of the autopilot's messages (Hz); 0 means only on request."""

    heartbeat: Rate = 1.0
    system_time: Rate = 2.0
    attitude: Rate = 50.0
    local_position: Rate = 50.0
    global_position: Rate = 10.0
    gps: Rate = 5.0
    imu: Rate = 100.0
    servo: Rate = 10.0
    battery: Rate = 0.0


class Vehicle(Record, frozen=True, kw_only=True):
    """The identity of our vehicle on MAVLink.

    `origin` of the local frame is WGS-84 latitude and longitude (deg) and height (m). An ArduPilot stamps late
    (`Nav.position_delay`, `Gps.delay`), which a daemon may correct.
    """

    type: Literal["fixed_wing", "quadrotor"] = "fixed_wing"
    autopilot: Literal["ardupilot", "px4"] = "px4"
    system: Annotated[int, msgspec.Meta(ge=1, le=255)] = 1
    component: Annotated[int, msgspec.Meta(ge=1, le=255)] = 1
    origin: tuple[float, float, float] = (47.397742, 8.545594, 488.0)
    boot: NotNegative = 40.0  # s on the boot clock when the flight begins
    rates: Rates = Rates()
