"""Whether a gimbal's angles are against the frame that its flags name, by how straight the leader flies by each.

Servo gimbals send angles against the body under flags that say otherwise. With angles against a wrong frame, the
leader swings with our own rotations. Each frame gives the leader's direction in each image, and with its range and
our own motion the place where it is. By the right frame, these places change as an aircraft moves: over half a
second its velocity stays nearly the same. Where another frame than the flagged one says so, image after image, the
flags are wrong, or the angles are.
"""

from collections import deque
from collections.abc import Mapping
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.estimators.leader.image.camera_pose import CameraPoses
from onboard.estimators.leader.image.prepare import Image
from onboard.geometry.camera import Camera
from onboard.messages import MountFrame
from onboard.messages.causes import Cause, Reason
from onboard.ownship import Ownship
from onboard.units import NS_PER_S

WORDS: Final[Mapping[MountFrame, str]] = {
    "body": "our body",
    "earth": "north and the horizon",
    "heading": "our heading and the horizon",
}
APART_S: Final = 0.5  # between the images whose directions are compared
LONGEST_S: Final = 0.3  # between two images in a row
ACCELERATION: Final = 1.0  # m/s^2, one standard deviation, of a leader that is not known to accelerate
NOISE: Final = 0.005  # rad, of the change of a direction rate over `APART_S`, by the images and the gimbal
MARGIN: Final = 0.5  # of log-likelihood an image: frames that fit about equally well decide nothing
MOST: Final = 4.0  # of log-likelihood that one image may add
ENOUGH: Final = 150.0  # of log-likelihood: two seconds of images at least


class FrameDirections(NamedTuple):
    """An image: the leader's direction in n by each frame (frames, 3), and how far we had moved (3,), m."""

    t_ns: int
    directions: Array
    moved: Array


class GimbalFrames:
    """The evidence against the flagged frame, of the `cameras` of which that `may_be_contradicted`."""

    def __init__(self, cameras: Camera) -> None:
        self._cameras = cameras
        self._poses = [CameraPoses(_against(cameras, frame)) for frame in WORDS]
        self._flagged: MountFrame = "heading"
        self._sights: deque[FrameDirections] = deque()
        self.clear()

    def clear(self) -> None:
        """Forget all images, and the evidence."""
        self._sights.clear()
        self._gains: dict[MountFrame, float] = dict.fromkeys(WORDS, 0.0)
        self._found: MountFrame | None = None

    def observe(self, image: Image, range_: float, ownship: Ownship) -> None:
        """An image of the leader, about so far away, m."""
        message = image.message
        camera = self._cameras.named(message.camera)
        if message.mount is not None or camera.gimbal is None or not _is_flagged(camera):
            return
        mount, now = ownship.gimbals.at(camera.gimbal, message.t_ns), self._sight(image, ownship)
        if mount is None or now is None:
            return
        self._flagged = mount.frame
        before = [s for s in self._sights if now.t_ns - s.t_ns >= APART_S * NS_PER_S]
        self._sights.append(now)
        if len(before) < 2 or now.t_ns - before[0].t_ns < 1.8 * APART_S * NS_PER_S:
            return
        while now.t_ns - self._sights[0].t_ns > 2.0 * APART_S * NS_PER_S:
            self._sights.popleft()
        misfits = dict(zip(WORDS, misfit(before[0], before[-1], now, range_).tolist(), strict=True))
        for frame in WORDS:
            gain = min(max(misfits[mount.frame] - misfits[frame], -MOST), MOST) - MARGIN
            self._gains[frame] = min(max(self._gains[frame] + gain, 0.0), 2.0 * ENOUGH)
        best = max(self._gains, key=self._gains.__getitem__)
        if self._gains[best] >= ENOUGH:
            self._found = best
        elif self._gains[best] == 0.0:
            self._found = None

    def _sight(self, image: Image, ownship: Ownship) -> FrameDirections | None:
        """The directions of an image; None where it is late, or a pose is not known."""
        t_ns, message = image.message.t_ns, image.message
        moved = np.zeros(3)
        if self._sights:
            last = self._sights[-1]
            if t_ns <= last.t_ns:
                return None
            steps = ownship.steps(last.t_ns, t_ns)
            if not steps or t_ns - last.t_ns > LONGEST_S * NS_PER_S:
                self._sights.clear()
            else:
                moved = last.moved + sum(s.dt * s.v0 + 0.5 * s.dt**2 * s.a for s in steps)
        poses = [p.at(t_ns, ownship, p.camera.named(message.camera), message.mount) for p in self._poses]
        known = [pose.R_cn for pose in poses if pose is not None]
        if len(known) < len(poses):
            return None
        return FrameDirections(t_ns, image.measurement.axes[0] @ np.array(known), moved)

    @property
    def contradiction(self) -> Reason | None:
        """What contradicts the flags, None if nothing."""
        if self._found is None or self._found == self._flagged:
            return None
        return Reason(
            Cause.GIMBAL_FRAME,
            f"the gimbal's angles are flagged as against {WORDS[self._flagged]}, but the images fit angles "
            f'against {WORDS[self._found]}: set `gimbal_frame = "{self._found}"`, if they are',
        )


def misfit(first: FrameDirections, middle: FrameDirections, last: FrameDirections, range_: float) -> Array:
    """Negative log-likelihoods (frames,), but for a constant, that a leader so far away, m, which keeps its
    velocity, is seen in these three directions."""
    a, b = ((later.t_ns - earlier.t_ns) / NS_PER_S for earlier, later in ((first, middle), (middle, last)))
    places = [sight.moved + range_ * sight.directions for sight in (first, middle, last)]
    bend = 0.5 * (a + b) * ((places[2] - places[1]) / b - (places[1] - places[0]) / a)  # acceleration times dt^2
    across = bend - np.sum(bend * middle.directions, axis=1, keepdims=True) * middle.directions
    variance = (0.25 * ACCELERATION * (a + b) ** 2) ** 2 + (NOISE * range_) ** 2
    return np.asarray(0.5 * np.sum(across**2, axis=1) / variance)


def may_be_contradicted(cameras: Camera) -> bool:
    """Whether one of the cameras is on a gimbal whose `gimbal_frame` is not configured: its flags say it."""
    return any(_is_flagged(camera) for camera in (cameras, *cameras.others))


def _is_flagged(camera: Camera) -> bool:
    return camera.gimbal is not None and not camera.gimbal_frame


def _against(camera: Camera, frame: MountFrame) -> Camera:
    """The camera, and those beside it, with the angles of their gimbals against a frame."""
    others = tuple(_against(other, frame) for other in camera.others)
    return replace(camera, gimbal_frame=frame if _is_flagged(camera) else camera.gimbal_frame, others=others)
