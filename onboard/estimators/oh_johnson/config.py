"""Configuration `[estimator.oh_johnson]`: the keys of its section, with their units."""

from typing import Annotated, ClassVar

import msgspec

from onboard.messages import Positive, Record


class Config(Record, frozen=True, kw_only=True):
    """Configuration `[estimator.oh_johnson]`.

    The paper's noise is not configurable; it is in `noise.py`.
    """

    size_prior_m: Positive = 2.0  # the leader's wingspan, b
    size_prior_sigma_m: Positive | None = None  # None: 2 % of the wingspan
    publish_rate_hz: Annotated[float, msgspec.Meta(ge=10)] = 30.0  # between images

    # Withdrawn as keys. The paper has no gate; the times are those of [estimator.leader], for comparison.
    gate_probability: ClassVar[float] = 0.999
    rewind_horizon_s: ClassVar[float] = 0.5  # images older than this are rejected
    coast_after_s: ClassVar[float] = 0.25  # without an image: coasting
    validity_timeout_s: ClassVar[float] = 2.0  # without an image: lost, not valid
    reset_timeout_s: ClassVar[float] = 10.0  # without an image: forgotten
