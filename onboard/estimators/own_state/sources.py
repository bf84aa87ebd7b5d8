"""Conversion of message streams to measurements, with the memory that each stream needs."""

import math
from collections import deque
from collections.abc import Sequence
from typing import Final

from onboard.estimators.kit.frame import NO_POSITION, on_earth
from onboard.estimators.own_state.config import Config
from onboard.estimators.own_state.measurements import (
    MAX_ALTITUDE_M,
    Measurement,
    from_attitude,
    from_barometer,
    from_fix,
)
from onboard.estimators.own_state.noise import SensorNoise
from onboard.geometry.geodesy import geodetic_from_ned, ned_from_geodetic
from onboard.messages import Attitude, Barometer, GlobalOrigin, GlobalPosition, GpsFix, Imu, Vec3, Verdict
from onboard.ownship import Ownship
from onboard.units import NS_PER_S

ATTITUDE_HISTORY_LENGTH: Final = 200  # for the start of a track
MAX_ATTITUDE_OFFSET_NS: Final = NS_PER_S // 2  # from the fix at which a track starts
ORIGIN_TIMEOUT_NS: Final = 2 * NS_PER_S  # A GLOBAL_POSITION_INT shows the autopilot's origin.
MIN_FIX_TYPE: Final = 3  # GPS_FIX_TYPE_3D_FIX
NO_ORIGIN: Final = (0.0, 0.0, 0.0)  # for a fix that is refused anyway
MIN_ORIGIN_STEP_M: Final = 1.0  # Less is rounding.


class Sources:
    """Measurements of attitude, GPS and barometer.

    A message gives a measurement, or the verdict on an unusable one, or None if it is not needed.
    """

    def __init__(self, config: Config, noise: SensorNoise) -> None:
        self.attitudes: deque[Measurement] = deque(maxlen=ATTITUDE_HISTORY_LENGTH)
        self.origin: Vec3 | None = None  # of n: latitude and longitude (deg), altitude (m)
        self.first_fix_ns: int | None = None
        self._stated_origin: Vec3 | None = None
        self._config, self._noise = config, noise
        self._last_fix_ns: int | None = None
        self._datum: float | None = None  # the barometer's first altitude, m
        self._next_pressure_ns = 0

    @property
    def newest_ns(self) -> int:
        """Time of the newest attitude, 0 before the first."""
        return self.attitudes[-1].t_ns if self.attitudes else 0

    def attitude_near(self, t_ns: int) -> Measurement | None:
        """Return the attitude nearest to a time; None if none is near enough."""
        near = min(self.attitudes, key=lambda a: abs(a.t_ns - t_ns), default=None)
        return None if near is None or abs(near.t_ns - t_ns) > MAX_ATTITUDE_OFFSET_NS else near

    def attitude(self, message: Attitude, white: Sequence[float] | None) -> Measurement | Verdict | None:
        """Return an attitude newer than the last.

        ATTITUDE and ATTITUDE_QUATERNION of one instant are the same. `white`: standard deviations of their noise,
        rad, as measured.
        """
        measurement = from_attitude(message, self._noise.attitude(white))
        if isinstance(measurement, Verdict):
            return measurement
        if self.attitudes and message.t_ns <= self.newest_ns:
            return None
        self.attitudes.append(measurement)
        return measurement

    def pressure(self, message: Imu | Barometer, altitude: float) -> Measurement | Verdict | None:
        """Return a barometer's altitude (m), at the configured rate."""
        rate = self._config.pressure_rate_hz
        if rate == 0.0 or message.t_ns < self._next_pressure_ns:
            return None
        self._next_pressure_ns = next_due_ns(message.t_ns, rate)
        if self._datum is None and math.isfinite(altitude):
            self._datum = altitude
        return from_barometer(message, altitude, self._datum or 0.0, self._config)

    def fix(self, message: GpsFix, ownship: Ownship) -> Measurement | Verdict | None:
        """Return a new 3D fix, once the origin is known."""
        if message.fix_type < MIN_FIX_TYPE or message.t_ns == self._last_fix_ns:
            return None
        self._last_fix_ns = message.t_ns
        if self.first_fix_ns is None:
            self.first_fix_ns = message.t_ns
        if self.origin is None and is_place(_place(message)):
            if message.t_ns - self.first_fix_ns < ORIGIN_TIMEOUT_NS:
                return None
            self.origin = _origin(message, ownship) or _place(message)
        return from_fix(message, self.origin or NO_ORIGIN, self._noise.speed)

    def move_origin(self, message: GlobalOrigin) -> bool:
        """Set the origin that the autopilot reports.

        Returns True if it has moved since its last report: positions from it then have another meaning.
        """
        before, now = self._stated_origin, _place(message)
        if not is_place(now):
            return False
        if before is not None and distance(now, before) <= MIN_ORIGIN_STEP_M:
            return False
        self._stated_origin = now
        if before is None:
            return False
        self.origin = now
        return True

    def learn_origin(self, message: GlobalPosition, ownship: Ownship) -> None:
        """Find the autopilot's own origin, so that positions can be compared with its own."""
        if self.origin is None and is_place(_place(message)):
            self.origin = _origin(message, ownship)


def distance(a: Vec3, b: Vec3) -> float:
    """Return the distance between two places (degrees, degrees, metres), m."""
    return math.hypot(*ned_from_geodetic(a, b).tolist())


def next_due_ns(t_ns: int, rate_hz: float) -> int:
    """Return the earliest time of the next message to use.

    It is a millisecond early for rounded stamps.
    """
    return t_ns + round(NS_PER_S / rate_hz) - NS_PER_S // 1000


def _origin(message: GlobalPosition | GpsFix, ownship: Ownship) -> Vec3 | None:
    """Return the origin of the autopilot's positions.

    None if its position is unknown at the message's time.
    """
    pose = ownship.pose_at(message.t_ns)
    if pose is None or not math.isfinite(pose.r_OF_n.sum()):
        return None
    return geodetic_from_ned(-pose.r_OF_n, _place(message))


def _place(message: GlobalOrigin | GlobalPosition | GpsFix) -> Vec3:
    return message.lat_deg, message.lon_deg, message.alt_msl


def is_place(where: Vec3) -> bool:
    """Return whether a place (degrees, degrees, metres) is on or above the Earth.

    All later positions are relative to the first. A sender without a position reports latitude and longitude 0.
    """
    lat, lon, alt = where
    return (lat, lon) != NO_POSITION and on_earth(lat, lon) and abs(alt) < MAX_ALTITUDE_M
