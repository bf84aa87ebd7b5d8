"""`[estimator.leader]`: the keys of its section, with their units."""

from typing import Annotated, Literal

import msgspec

from onboard.messages import NotNegative, Positive, Record


class Config(Record, frozen=True, kw_only=True):
    """`[estimator.leader]`. The keys carry their units."""

    filter: Literal["wing-line", "subtended", "paper"] = "wing-line"  # the last two: Oh & Johnson's, see README
    size_prior_m: Positive = 2.0  # the leader's wingspan, as far as it is known
    size_prior_sigma_m: Positive | None = None  # None: 2 % of it
    leader_class: Literal["fixed_wing", "multirotor"] = "multirotor"  # which changes its speed how freely
    center_on_wing: bool = False  # the center seen is the wing's middle, to 1 % of the wing: then it tells more
    process_noise: dict[str, float] = msgspec.field(
        default_factory=dict
    )  # overrides single settings of the chosen filter, by name
    initialise_images: Annotated[int, msgspec.Meta(ge=1, le=100)] = (
        3  # that must agree before a track starts (with the paper's filter: 1)
    )
    own_tilt_sigma_deg: NotNegative = 0.3  # how far our own roll and pitch may be steadily off, mount included
    own_yaw_sigma_deg: NotNegative = 1.0  # the same of our yaw; 0 for both: our attitude is exact
    own_attitude_time_s: Positive = 60.0  # in which these errors change
    own_velocity_sigma_m_s: NotNegative = 0.1  # how far our own velocity may be off
    estimate_bias: bool = True  # estimate these errors (else: only add them to what is reported)
    delay_sigma_s: NotNegative = 0.0  # how far the camera's stamps may be late; 0: they are exact, not estimated
    rewind_horizon_s: NotNegative = 0.5  # images older than this are rejected
    coast_after_s: NotNegative = 0.25  # without an image: coasting
    validity_timeout_s: NotNegative = 2.0  # without an image: lost, not valid
    reset_timeout_s: NotNegative = 10.0  # without an image: forgotten
    relock_after_s: NotNegative = 1.0  # with nothing but gated images: forgotten, and begun anew
    stale_after_s: Positive = 0.5  # with exactly the same points: the camera hangs
    edge_px: NotNegative = 1.0  # points this near to the image's edge are not believed
    max_targets: Annotated[int, msgspec.Meta(ge=1, le=1000)] = 100
