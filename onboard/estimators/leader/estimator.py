"""The motion of other aircraft relative to us, from three points of each in our camera, flown.

The filter is `_wing_line` by default, or Oh & Johnson's, as printed or with honest noise (`_leader_filters`).
Around it stands what flying needs (`_track`): each image is fused at the time it was taken, however late it comes;
a gate; a life cycle that says when not to believe it. Every target has a track of its own: images say by an id
whose they are, and images without one go to the track they are most like.
"""

import math
from typing import Final

import numpy as np

from onboard.estimators.leader.choice import make
from onboard.estimators.leader.config import Config
from onboard.estimators.leader.filter import LeaderFilter
from onboard.estimators.leader.image import Eye, Image, ready
from onboard.estimators.leader.track import Times, Track
from onboard.estimators.leader.wing_line_noise import Extras
from onboard.geometry.camera import Camera
from onboard.messages import Estimate, Message, TargetPoints, Verdict
from onboard.ownship import Ownship

NAME: Final = "leader"
LISTENS: Final = (TargetPoints,)
NO_ID: Final = ""
FARTHER: Final = 3.0  # times as far from the image as the nearest track, ...
BESIDE: Final = 0.04  # rad, and this: what is farther off is not what was seen
SMALLEST_SIGMA: Final = 1e-4  # rad; an axis of our attitude that is surer than this is not worth a state


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
