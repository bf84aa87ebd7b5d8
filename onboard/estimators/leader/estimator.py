"""The motion of other aircraft relative to us, from three points of each in our camera.

Every target has a track of its own (`track`), with a filter (`choice`). An image that carries an id goes to the
track of that id; an image without one goes to the track whose prediction it fits best.
"""

import math
from typing import Final

from onboard.estimators.leader.camera_pose import CameraPoses
from onboard.estimators.leader.choice import make_filter
from onboard.estimators.leader.config import Config
from onboard.estimators.leader.image import Image, prepare
from onboard.estimators.leader.track import Track
from onboard.geometry.camera import Camera
from onboard.messages import Estimate, Message, TargetPoints, Verdict
from onboard.ownship import Ownship

NAME: Final = "leader"
LISTENS: Final = (TargetPoints,)
NO_ID: Final = ""
# An image is compared with the tracks at most this many times as far from it as the nearest one, plus this angle.
FARTHER: Final = 3.0
BESIDE: Final = 0.04  # rad


class Estimator:
    """See `onboard.estimators.EstimatorProtocol`. A track for each target, by its id."""

    def __init__(self, config: Config, camera: Camera) -> None:
        self._config, self._poses = config, CameraPoses(camera)
        self._filter = make_filter(config)
        self._tracks = {NAME: self._track(NAME)}
        self._numbered = 0

    def observe(self, message: Message, ownship: Ownship) -> list[Estimate]:
        """Fuse one image of one target at the time it was taken."""
        if not isinstance(message, TargetPoints):
            return []
        if message.target == NO_ID:
            return [self._nearest(message, ownship).observe(message, ownship)]
        return [self._named(message.target, ownship).observe(message, ownship)]

    def tick(self, ownship: Ownship) -> list[Estimate]:
        """Predict every target to the newest navigation sample. Drop idle tracks, except the first."""
        for target, track in list(self._tracks.items()):
            if target != NAME and track.is_idle(ownship.now_ns):
                del self._tracks[target]
        return [track.tick(ownship) for track in self._tracks.values()]

    def reset(self, reason: str) -> None:
        """Forget all tracks and all times."""
        for track in self._tracks.values():
            track.reset(reason)

    def _track(self, target: str, *, full: bool = False) -> Track:
        return Track(NAME, target, self._filter, self._poses, self._config, full=full)

    def _named(self, target: str, ownship: Ownship) -> Track:
        """The track of that id, a new one if there is none. With too many tracks the new one is not kept, and
        rejects the image."""
        if target in self._tracks:
            return self._tracks[target]
        followed = len(self._tracks) - self._tracks[NAME].is_idle(ownship.now_ns)
        if followed >= self._config.max_targets:
            return self._track(target, full=True)
        self._tracks[target] = self._track(target)
        return self._tracks[target]

    def _nearest(self, message: TargetPoints, ownship: Ownship) -> Track:
        """The track whose prediction an image without an id fits best, or a new one."""
        image = prepare(message, ownship, self._poses, self._filter, self._config.edge_px)
        if isinstance(image, Verdict):
            return self._tracks[NAME]  # which reports the verdict
        distances = {track.target: track.distance(image, ownship) for track in self._candidates(image)}
        nearest = min(distances, key=lambda target: distances[target])
        if distances[nearest] <= 1.0:
            return self._tracks[nearest]
        if self._tracks[NAME].is_idle(ownship.now_ns):
            return self._tracks[NAME]
        self._numbered += 1
        return self._named(f"unnamed/{self._numbered}", ownship)

    def _candidates(self, image: Image) -> list[Track]:
        """The tracks that an image may belong to: all without a recent image, whose target may be anywhere, and
        of the others those hardly farther from the image's direction than the nearest one. With n targets in an
        image, to compare each image with each track would cost n^2 updates."""
        direction = image.direction_n.tolist()
        offsets = {
            t.target: math.dist(t.direction_n, direction)
            for t in self._tracks.values()
            if t.direction_n is not None
        }
        limit = FARTHER * min(offsets.values(), default=0.0) + BESIDE
        return [t for t in self._tracks.values() if offsets.get(t.target, 0.0) <= limit]
