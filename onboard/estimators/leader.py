"""The motion of other aircraft relative to us, from three points of each in our camera, flown.

The filter is `_wing_line` by default, or Oh & Johnson's, as printed or with honest noise (`_leader_filters`).
Around it stands what flying needs (`_track`): each image is fused at the time it was taken, however late it comes;
a gate; a life cycle that says when not to believe it. Every target has a track of its own: images say by an id
whose they are, and images without one go to the track they are most like.
"""

import math
from typing import Annotated, Final, Literal

import msgspec
import numpy as np

from onboard.estimators._image import Eye, Image, ready
from onboard.estimators._leader_filters import LeaderFilter, make
from onboard.estimators._track import Times, Track
from onboard.estimators._wing_line_noise import Extras
from onboard.geometry.camera import Camera
from onboard.messages import Estimate, Message, NotNegative, Positive, Record, TargetPoints, Verdict
from onboard.ownship import Ownship

NAME: Final = "leader"
LISTENS: Final = (TargetPoints,)
NO_ID: Final = ""
FARTHER: Final = 3.0  # times as far from the image as the nearest track, ...
BESIDE: Final = 0.04  # rad, and this: what is farther off is not what was seen
SMALLEST_SIGMA: Final = 1e-4  # rad; an axis of our attitude that is surer than this is not worth a state


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


class Estimator:
    """See `onboard.estimators.EstimatorProtocol`. A track for each target, by its id."""

    def __init__(self, config: Config, camera: Camera) -> None:
        if not config.coast_after_s <= config.validity_timeout_s <= config.reset_timeout_s:
            raise ValueError("coast_after_s <= validity_timeout_s <= reset_timeout_s must hold")
        self._config, self._eye = config, Eye(camera)
        self._filter = _filter(config)
        times = {name: getattr(config, name) for name in Times.__struct_fields__}
        self._times = Times(**times)
        self._tracks = {NAME: self._track(NAME)}
        self._numbered = 0

    def observe(self, message: Message, ownship: Ownship) -> list[Estimate]:
        """Fuse one image's points of one target at the time they were taken."""
        if not isinstance(message, TargetPoints):
            return []
        if message.target == NO_ID:
            return [self._nearest(message, ownship).take(message, ownship)]
        return [self._named(message.target, ownship).take(message, ownship)]

    def tick(self, ownship: Ownship) -> list[Estimate]:
        """Predict every target to the newest navigation sample; forget those long gone, but for the first."""
        for target, track in list(self._tracks.items()):
            if target != NAME and track.idle_since(ownship.now_ns):
                del self._tracks[target]
        return [track.tick(ownship) for track in self._tracks.values()]

    def reset(self, reason: str) -> None:
        """Forget all tracks and all times."""
        for track in self._tracks.values():
            track.reset(reason)

    def _track(self, target: str) -> Track:
        return Track(NAME, target, self._filter, self._eye, self._times)

    def _named(self, target: str, ownship: Ownship) -> Track:
        """The track of that id, begun if need be; if there are too many, one not kept, that takes nothing."""
        if target in self._tracks:
            return self._tracks[target]
        followed = len(self._tracks) - self._tracks[NAME].idle_since(ownship.now_ns)
        if followed >= self._config.max_targets:
            return Track(NAME, target, self._filter, self._eye, self._times, full=True)
        self._tracks[target] = self._track(target)
        return self._tracks[target]

    def _nearest(self, message: TargetPoints, ownship: Ownship) -> Track:
        """The track that an image without an id is most like, or a new one."""
        image = ready(message, ownship, self._eye, self._filter, self._times.edge_px)
        if isinstance(image, Verdict):
            return self._tracks[NAME]  # to tell why it is of no use
        unlike = {track.target: track.likeness(image, ownship) for track in self._towards(image)}
        nearest = min(unlike, key=lambda target: unlike[target])
        if unlike[nearest] <= 1.0:
            return self._tracks[nearest]
        if self._tracks[NAME].idle_since(ownship.now_ns):
            return self._tracks[NAME]
        self._numbered += 1
        return self._named(f"unnamed/{self._numbered}", ownship)

    def _towards(self, image: Image) -> list[Track]:
        """The tracks that an image may be of: those not seen lately, which may be anywhere, and of the others
        those that are not much farther from where it looks than the nearest. To ask every one would take the
        square of their number."""
        look = (image.seen.look_c @ image.view.R_cn).tolist()
        away = {t.target: math.dist(t.look, look) for t in self._tracks.values() if t.look is not None}
        limit = FARTHER * min(away.values(), default=0.0) + BESIDE
        return [t for t in self._tracks.values() if away.get(t.target, 0.0) <= limit]


def _filter(config: Config) -> LeaderFilter:
    """The filter that is configured. Raises ValueError for settings that it does not have."""
    tilt, yaw = np.radians([config.own_tilt_sigma_deg, config.own_yaw_sigma_deg])
    sigma = np.array([tilt, tilt, yaw])
    wanted = config.estimate_bias and config.filter == "wing-line" and bool(sigma.max() > 0)
    bias = tuple(np.maximum(sigma, SMALLEST_SIGMA).tolist()) if wanted else (0.0, 0.0, 0.0)
    return make(
        config.filter,
        size=config.size_prior_m,
        size_sigma=config.size_prior_sigma_m or 0.02 * config.size_prior_m,
        leader_class=config.leader_class,
        overrides=config.process_noise,
        attitude_sigma=np.zeros(3) if wanted else sigma,
        extras=Extras(
            config.delay_sigma_s,
            bias,
            config.own_attitude_time_s,
            config.own_velocity_sigma_m_s,
            config.center_on_wing,
        ),
    )
