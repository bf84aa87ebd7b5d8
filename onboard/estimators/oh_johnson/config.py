"""Configuration `[estimator.oh_johnson]`: the keys of its section, with their units."""

from typing import Annotated

import msgspec

from onboard.estimators.kit.life_cycle import check_order
from onboard.messages import NotNegative, Positive, Record


class Config(Record, frozen=True, kw_only=True):
    """Configuration `[estimator.oh_johnson]`. Raises ValueError for timeouts out of order.

    The paper's noise is not configurable; it is in `noise.py`.
    """

    size_prior_m: Positive = 2.0  # the leader's wingspan, b
    size_prior_sigma_m: Positive | None = None  # None: 2 % of the wingspan
    gate_probability: Annotated[float, msgspec.Meta(gt=0, lt=1)] = 0.999  # the paper has no gate
    publish_rate_hz: Annotated[float, msgspec.Meta(ge=10)] = 30.0  # between images
    rewind_horizon_s: NotNegative = 0.5  # images older than this are rejected
    coast_after_s: NotNegative = 0.25  # without an image: coasting
    validity_timeout_s: NotNegative = 2.0  # without an image: lost, not valid
    reset_timeout_s: NotNegative = 10.0  # without an image: forgotten

    def __post_init__(self) -> None:
        check_order(self, "reset_timeout_s")
