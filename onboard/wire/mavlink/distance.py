"""DISTANCE_SENSOR <-> DistanceReading."""

import math
from collections.abc import Callable
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from onboard.messages import DistanceReading, Message

FORM: Final = "<I3H4B2f4fB"  # time; least, largest, current, cm; type, id, orientation, variance; angles; quality
UNKNOWN_VARIANCE: Final = (0, 255)  # cm^2
MAX_RANGE_CM: Final = 65535  # the largest number of the field


def reading(f: tuple[Any, ...], h: dict[str, Any]) -> Message:
    """The record of a payload; a distance outside the sensor's own limits is unknown."""
    least, largest, current, _, sensor, _, variance = f[1:8]
    is_measured = current > 0 and least <= current <= largest and f[-1] != 1  # signal_quality: none
    sigma = None if variance in UNKNOWN_VARIANCE else 0.01 * math.sqrt(variance)
    return DistanceReading(**h, sensor=sensor, distance=0.01 * current if is_measured else None, sigma=sigma)


def _message(m: Any) -> list[Any]:
    current = 0 if m.distance is None else round(100.0 * m.distance)
    variance = UNKNOWN_VARIANCE[0] if m.sigma is None else min(round((100.0 * m.sigma) ** 2), 254)
    return [dialect.MAVLink_distance_sensor_message(0, 1, MAX_RANGE_CM, current, 0, m.sensor, 0, variance)]


ENCODE: Final[dict[type[Message], Callable[[Any], list[Any]]]] = {DistanceReading: _message}
