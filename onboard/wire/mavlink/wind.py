"""WIND_COV (PX4) and WIND (ArduPilot) <-> Wind."""

import math
from collections.abc import Callable
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from onboard.messages import Message, Wind

FORM_COV: Final = "<Q8f"  # time; north, east, down, m/s; variability, level and vertical; altitude; accuracies
FORM: Final = "<3f"  # where it comes from, degrees; speed, vertical speed, m/s


def of_covariance(f: tuple[Any, ...], h: dict[str, Any]) -> Message:
    """The wind of a WIND_COV, with the accuracy as sigma.

    PX4 has no accuracy, but states the sum of both axes' variances, (m/s)^2, as the variability.
    """
    north, east, both, accuracy = f[1], f[2], f[4], f[7]
    sigma = accuracy if accuracy > 0 else math.sqrt(0.5 * both) if both > 0 else None
    return Wind(**h, north=north, east=east, sigma=sigma if sigma is None or math.isfinite(sigma) else None)


def of_direction(f: tuple[Any, ...], h: dict[str, Any]) -> Message:
    """WIND: a direction from which it comes."""
    degrees, speed = f[0], f[1]
    if not math.isfinite(degrees):
        return Wind(**h, north=math.nan, east=math.nan, sigma=None)
    angle = math.radians(degrees)
    return Wind(**h, north=-speed * math.cos(angle), east=-speed * math.sin(angle), sigma=None)


def _message(m: Any) -> list[Any]:
    nan = math.nan
    variability = nan if m.sigma is None else 2.0 * m.sigma**2
    return [dialect.MAVLink_wind_cov_message(0, m.north, m.east, nan, variability, nan, nan, 0.0, 0.0)]


ENCODE: Final[dict[type[Message], Callable[[Any], list[Any]]]] = {Wind: _message}
