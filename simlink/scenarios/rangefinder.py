"""A rangefinder of a scenario: a laser or a radio that measures how far the leader is."""

from typing import Annotated

import msgspec

from onboard.messages import NotNegative, Positive, Record
from simlink.scenarios.profiles import Probability


class Rangefinder(Record, frozen=True, kw_only=True):
    """It sends a DISTANCE_SENSOR of the id `sensor` at `rate` (Hz). The range is off by a bias that is drawn
    once a run, and by what is new in each (m, 1 sigma); it measures nothing with probability `p_miss`, beyond
    `range_max`, and beyond `half_angle_deg` from the camera's axis."""

    sensor: Annotated[int, msgspec.Meta(ge=0, le=255)] = 1
    rate: Annotated[float, msgspec.Meta(gt=0, le=200)] = 10.0
    white: NotNegative = 0.1
    bias: NotNegative = 0.2
    p_miss: Probability = 0.1
    range_max: Positive = 60.0
    half_angle_deg: Annotated[float, msgspec.Meta(gt=0, le=180)] = 15.0
