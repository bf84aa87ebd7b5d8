"""The rangefinder of a scenario: a laser or a radio that measures the range of the leader."""

from typing import Annotated

import msgspec

from onboard.messages import NotNegative, Positive, Record
from simlink.scenarios.profiles import Probability


class Rangefinder(Record, frozen=True, kw_only=True):
    """A sensor that sends DISTANCE_SENSOR with the id `sensor` at `rate` (Hz).

    Its range has a bias, drawn once a run, and white noise (m, 1 sigma). It measures nothing with probability
    `p_miss`, beyond `range_max` (m), and beyond `half_angle_deg` from the camera's axis.
    """

    sensor: Annotated[int, msgspec.Meta(ge=0, le=255)] = 1
    rate: Annotated[float, msgspec.Meta(gt=0, le=200)] = 10.0
    white: NotNegative = 0.1
    bias: NotNegative = 0.2
    p_miss: Probability = 0.1
    range_max: Positive = 60.0
    half_angle_deg: Annotated[float, msgspec.Meta(gt=0, le=180)] = 15.0
