"""`[estimator.leader]`: the keys of its section, with their units."""

import re
from typing import Annotated, ClassVar

import msgspec

from onboard.estimators.kit.life_cycle import check_order
from onboard.estimators.leader.assumptions import PARTICLES
from onboard.messages import NotNegative, Positive, Record, TargetClass


class BroadcastConfig(Record, frozen=True, kw_only=True):
    """`[estimator.leader.broadcast]`: the position that the leader itself broadcasts.

    It is used with `system` or `icao` alone.

    Raises ValueError for both of them, for other keys without either, and for an `icao` that is none."""

    system: Annotated[int, msgspec.Meta(ge=0, le=255)] = 0  # sends GLOBAL_POSITION_INT, FOLLOW_TARGET; 0: nobody
    icao: str = ""  # the leader's address in ADSB_VEHICLE, six hexadecimal digits
    position_sigma_m: Positive = 2.0  # error on each axis that is new in each report
    bias_m: NotNegative = 2.0  # error of the position on each axis that lasts; of an `icao`'s height 30 m
    latency_s: Annotated[float, msgspec.Meta(ge=0, le=1)] = 0.2  # age of a report when it arrives
    geoid_undulation_m: float = 0.0  # of an `icao`: mean sea level = GNSS height - this
    trusted: bool = False  # nobody else can send in its name (a signed link): it carries beyond validity_timeout_s
    # Withdrawn as keys: radios queue for a tenth of a second; receivers' data sheets give 0.1 to 0.3 m/s, and the
    # errors of the position change with the satellites in view; no aircraft of interest is faster; GNSS is good
    # for ten seconds of a steady flight.
    latency_sigma_s: ClassVar[float] = 0.1  # by which `latency_s` is wrong, for long and anew in each report
    velocity_sigma_m_s: ClassVar[float] = 0.3  # on each axis, new in each report
    bias_time_s: ClassVar[float] = 60.0  # correlation time of `bias_m`
    max_speed_m_s: ClassVar[float] = 350.0  # faster reports are implausible
    timeout_s: ClassVar[float] = 10.0  # without a report: it carries the track no more
    altitude_sigma_m: ClassVar[None] = None  # without effect; older recordings hold it
    altitude_bias_m: ClassVar[None] = None  # likewise

    @property
    def is_used(self) -> bool:
        """Whether the leader broadcasts."""
        return bool(self.system or self.icao)

    def __post_init__(self) -> None:
        if self.system and self.icao:
            raise ValueError("system and icao: one of them is the leader's, not both")
        if self.icao and not re.fullmatch("[0-9a-fA-F]{6}", self.icao):
            raise ValueError(f"icao: must be six hexadecimal digits, not {self.icao!r}")
        is_changed = any(getattr(self, f.name) != f.default for f in msgspec.structs.fields(self))
        if is_changed and not self.is_used:
            raise ValueError("system or icao must say whose broadcasts are the leader's")


class RangeConfig(Record, frozen=True, kw_only=True):
    """`[estimator.leader.range]`: ranges to the leader by a rangefinder or a radio.

    They are used with `sensor` or `detections` alone.

    Raises ValueError for other keys without either."""

    sensor: Annotated[int, msgspec.Meta(ge=-1, le=255)] = -1  # id of the DISTANCE_SENSOR; -1: none
    detections: bool = False  # a detection of the leader brings its range (`range_m`)
    sigma_m: Positive = 0.2  # of ranges that bring no sigma, and of all at least
    latency_s: Annotated[float, msgspec.Meta(ge=0, le=1)] = 0.0  # age of a DISTANCE_SENSOR when it arrives
    # Withdrawn as a key: a beam hits any part of an airframe of a metre.
    bias_m: ClassVar[float] = 0.3  # error that lasts: the sensor's, and what of the leader it hits

    @property
    def is_used(self) -> bool:
        """Whether there are ranges."""
        return self.sensor >= 0 or self.detections

    def __post_init__(self) -> None:
        is_changed = any(getattr(self, f.name) != f.default for f in msgspec.structs.fields(self))
        if is_changed and not self.is_used:
            raise ValueError("sensor or detections must say where the ranges come from")


class Config(TargetClass, frozen=True, kw_only=True):
    """`[estimator.leader]`: the keys of a class, for a leader of no other class, and more.

    The keys carry their units; a `_sigma_` is one standard deviation.

    Raises ValueError for timeouts out of order."""

    size_prior_m: Positive = 2.0  # the leader's wingspan
    target: dict[str, TargetClass] = msgspec.field(default_factory=dict)  # classes: written as [target.CLASS]
    center_on_wing: bool = False  # the center is the wing's middle, to 1 % of the wing: measure the middle too
    particles: Annotated[int, msgspec.Meta(ge=100, le=100_000)] = PARTICLES  # hypotheses at most
    own_tilt_sigma_deg: NotNegative = 0.3  # steady error of our own roll and pitch, mount included
    own_yaw_sigma_deg: NotNegative = 1.0  # the same of our yaw; 0 for both: our attitude is exact
    own_attitude_time_s: Positive = 60.0  # correlation time of these errors
    own_velocity_sigma_m_s: NotNegative = 0.1  # error of our own velocity; a hovering leader seems to drift by it
    own_position_sigma_m: NotNegative = 1.0  # error of our own position: matters with a broadcast only
    broadcast: BroadcastConfig = BroadcastConfig()
    range: RangeConfig = RangeConfig()
    delay_sigma_s: NotNegative = 0.0  # delay of the camera's stamps; 0: they are exact, the delay no state
    publish_rate_hz: Annotated[float, msgspec.Meta(ge=10)] = 30.0  # of each target's estimates, images' included
    validity_timeout_s: NotNegative = 2.0  # without an image: lost, not valid
    max_targets: Annotated[int, msgspec.Meta(ge=1, le=1000)] = 100

    # Withdrawn as keys. Two wrong images agree by chance, three do not. No detector takes 0.5 s for an image.
    # Cameras send at least 10 images a second, so that 0.25 s without one is a gap. After 10 s a leader may be
    # anywhere. A range drifts by a leader's own speed within some seconds without the wing. A camera that hangs
    # is one within a few images. A detector cuts off what is within a pixel of the edge. A marker's side and the
    # focal length are known to a percent.
    initialise_images: ClassVar[int] = 3  # that must agree to start
    rewind_horizon_s: ClassVar[float] = 0.5  # images older than this are rejected
    coast_after_s: ClassVar[float] = 0.25  # without an image: coasting
    reset_timeout_s: ClassVar[float] = 10.0  # without an image: forgotten
    relock_after_s: ClassVar[float] = 1.0  # with only gated images: forgotten, and started again
    direction_timeout_s: ClassVar[float] = 5.0  # with directions alone, without the wing: lost, not valid
    stale_after_s: ClassVar[float] = 0.5  # with points that stay although the camera turned: it hangs
    edge_px: ClassVar[float] = 1.0  # points this near to the image's edge are rejected
    own_position_time_s: ClassVar[float] = 60.0  # without effect; older recordings hold it
    process_noise: ClassVar[dict[str, float]] = {}  # likewise
    filter: ClassVar[str] = "belief"  # likewise
    pose_scale_sigma: ClassVar[float] = 0.02  # bias of the range of poses, as a share of it

    def __post_init__(self) -> None:
        check_order(self, "reset_timeout_s")
        super().__post_init__()

    def of_class(self, name: str) -> "Config":
        """The settings for a class of targets."""
        known = self.target[name]
        return msgspec.structs.replace(self, **{key: getattr(known, key) for key in TargetClass.__struct_fields__})
