"""Messages of our own vehicle as measurements of states of `models.own_motion`."""

import math
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.estimators.own_state.config import Config
from onboard.filters.belief import Rows
from onboard.geometry.geodesy import ned_from_geodetic
from onboard.geometry.rotations import matrix_from_quaternion
from onboard.messages import Attitude, Barometer, GpsFix, Imu, Vec3, Verdict
from onboard.models import own_motion
from onboard.models.quadrotor import POSITION

MAX_DISTANCE_M: Final = 1e6  # From the origin; a more distant fix is not of this flight.
MAX_SPEED_M_S: Final = 300.0
MAX_RATE_RAD_S: Final = 100.0
MAX_ALTITUDE_M: Final = 1e5  # of a fix, and of a barometer
DEFAULT_POSITION_SIGMA_M: Final = (2.0, 3.0)  # horizontal and vertical, if the receiver reports none
MIN_POSITION_SIGMA_M: Final = 0.05
ATTITUDE_SENSOR: Final = "attitude"
BAROMETER: Final = "barometer"
GPS: Final = "gps"
UNUSED_ATTITUDE: Final = np.eye(3)


class Measurement(NamedTuple):
    """A measurement of one sensor.

    Attributes
    ----------
    y
        Measured values (m,). The three angles of an attitude are zero until the reference frame is known (see
        `relative_to`).
    R
        Noise covariance (m, m).
    R_nb
        Attitude, for an attitude measurement.
    """

    sensor: str
    t_ns: int
    t_recv_ns: int
    y: Array
    R: Array
    R_nb: Array = UNUSED_ATTITUDE

    @property
    def part(self) -> slice:
        """The measured part of `own_motion.NAVIGATION`.

        Empty for a barometer, which measures none of them.
        """
        if self.sensor == BAROMETER:
            return slice(0)
        return slice(6, 12) if self.sensor == ATTITUDE_SENSOR else slice(len(self.y))

    @property
    def components(self) -> tuple[str, ...]:
        """Names of the components of y."""
        return own_motion.COMPONENTS[self.part] or ("pressure_altitude",)

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the components of y."""
        return own_motion.UNITS[self.part] or ("m",)


def from_attitude(m: Attitude, sigmas: Array) -> Measurement | Verdict:
    """Return attitude and body rates, or the verdict on unusable ones.

    `sigmas` (6,) are the standard deviations.
    """
    q, omega = np.array(m.q_nb), np.array(m.omega_b)
    if not (np.isfinite(q).all() and np.isfinite(omega).all()):
        return Verdict.NOT_FINITE
    if not 0.5 < float(np.linalg.norm(q)) < 2.0 or np.abs(omega).max() > MAX_RATE_RAD_S:
        return Verdict.DEGENERATE
    y = np.concatenate([np.zeros(3), omega])
    return Measurement(ATTITUDE_SENSOR, m.t_ns, m.t_recv_ns, y, np.diag(sigmas**2), matrix_from_quaternion(q))


def reason_unusable(m: GpsFix) -> str:
    """Return why a fix cannot be used, with the name of a field that is not a finite number."""
    numbers = ("lat_deg", "lon_deg", "alt_msl", "ground_speed", "course_rad", "v_down")
    wrong = [n for n in numbers if not math.isfinite(getattr(m, n) or 0.0)]
    if wrong:
        return f"{' and '.join(wrong)}: not a finite number"
    return f"a place or a velocity that no vehicle has (latitude {m.lat_deg:g}, longitude {m.lon_deg:g})"


def from_fix(m: GpsFix, origin: Vec3, speed_sigmas: Array) -> Measurement | Verdict:
    """Return position and velocity of a fix, or the verdict on an unusable one.

    The position is from O (`origin`: latitude, longitude, altitude). The velocity has as many components as the
    fix; its standard deviations are (3,).
    """
    optional = (m.ground_speed, m.course_rad, m.v_down)
    if not all(x is None or math.isfinite(x) for x in (m.lat_deg, m.lon_deg, m.alt_msl, *optional)):
        return Verdict.NOT_FINITE
    place = ned_from_geodetic((m.lat_deg, m.lon_deg, m.alt_msl), origin)
    velocity: list[float] = []
    if m.ground_speed is not None and m.course_rad is not None:
        velocity = [m.ground_speed * math.cos(m.course_rad), m.ground_speed * math.sin(m.course_rad)]
        velocity += [] if m.v_down is None else [m.v_down]
    y = np.array([*place, *velocity])
    if not np.isfinite(y).all():
        return Verdict.NOT_FINITE
    if np.abs(place).max() > MAX_DISTANCE_M or np.abs(y[3:]).max(initial=0.0) > MAX_SPEED_M_S:
        return Verdict.DEGENERATE
    sigmas = np.array([*_accuracy(m), *speed_sigmas[: len(velocity)]])
    return Measurement(GPS, m.t_ns, m.t_recv_ns, y, np.diag(sigmas**2))


def from_barometer(m: Barometer | Imu, altitude: float, datum: float, config: Config) -> Measurement | Verdict:
    """Return a barometer's altitude above its `datum`, m, or a verdict on an unusable one."""
    if not math.isfinite(altitude):
        return Verdict.NOT_FINITE
    if abs(altitude) > MAX_ALTITUDE_M:
        return Verdict.DEGENERATE
    R = np.array([[config.pressure_sigma_m**2]])
    return Measurement(BAROMETER, m.t_ns, m.t_recv_ns, np.array([altitude - datum]), R)


def relative_to(R_na: Array, measurement: Measurement) -> tuple[Array, tuple[int, ...]]:
    """Return (y, indices of its angles); an attitude's are the ZYX angles of R_ab."""
    if measurement.sensor != ATTITUDE_SENSOR:
        return measurement.y, ()
    y = measurement.y.copy()
    y[:3] = own_motion.angles((R_na.T @ measurement.R_nb)[None])[0]
    return y, (0, 1, 2)


def measurement_model(measurement: Measurement) -> Rows:
    """Return the measurement as a function of rows of states."""
    if measurement.sensor == BAROMETER:
        return lambda rows: rows[:, own_motion.OFFSET :] - rows[:, POSITION[2], None]
    columns = list(own_motion.NAVIGATION[measurement.part])
    return lambda rows: rows[:, columns]


def _accuracy(m: GpsFix) -> Vec3:
    """Return standard deviations of the position, m."""
    horizontal, vertical = (
        given if given is not None and math.isfinite(given) and given > 0 else otherwise
        for given, otherwise in zip((m.h_acc, m.v_acc), DEFAULT_POSITION_SIGMA_M, strict=True)
    )
    horizontal, vertical = max(horizontal, MIN_POSITION_SIGMA_M), max(vertical, MIN_POSITION_SIGMA_M)
    return horizontal, horizontal, vertical
