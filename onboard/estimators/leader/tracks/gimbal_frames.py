"""Whether a gimbal's angles mean what its flags and the configuration say, by how straight the leader flies.

Servo gimbals send angles against the body under flags that say otherwise, and some count an angle the other way.
By wrong angles, the leader swings with our own rotations, or with the gimbal's. Each meaning of the angles gives
the leader's direction in each image, and with its range and our own motion the place where it is. By the right
one, these places change as an aircraft moves: over half a second its velocity stays nearly the same. Where another
meaning than the configured one says so, image after image, the flags are wrong, or the angles are.
"""

import json
from collections import deque
from collections.abc import Mapping
from dataclasses import replace
from typing import Final, Literal, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.estimators.leader import assumptions as given
from onboard.estimators.leader.image.camera_pose import CameraPoses
from onboard.estimators.leader.image.prepare import Image
from onboard.geometry.camera import Axis, Camera
from onboard.messages import MountFrame
from onboard.messages.causes import Cause, Reason
from onboard.ownship import Ownship
from onboard.units import NS_PER_S

WORDS: Final[Mapping[MountFrame, str]] = {
    "body": "our body",
    "earth": "north and the horizon",
    "heading": "our heading and the horizon",
}


class Meaning(NamedTuple):
    """Meaning of a gimbal's angles.

    Against which frame, "" for the one in use; and which angle has the other sign, "" for none beyond those
    configured."""

    frame: MountFrame | Literal[""] = ""
    other_sign: Axis | Literal[""] = ""


MEANINGS: Final = (*(Meaning(frame) for frame in WORDS), Meaning(other_sign="yaw"), Meaning(other_sign="pitch"))


class Sighting(NamedTuple):
    """An image: the leader's direction in n by each meaning (k, 3), and how far we had moved (3,), m."""

    t_ns: int
    directions: Array
    moved: Array


class GimbalFrames:
    """The evidence against what the angles of the gimbals of the `cameras` are taken for."""

    def __init__(self, cameras: Camera) -> None:
        self._cameras = cameras
        self._poses = [CameraPoses(_with(cameras, meaning)) for meaning in MEANINGS]
        self._used: MountFrame = "heading"
        self._signs = set[str]()
        self._sights: deque[Sighting] = deque()
        self.clear()

    def clear(self) -> None:
        """Forget all images, and the evidence."""
        self._sights.clear()
        self._gains = np.zeros(len(MEANINGS))
        self._lately = np.zeros(len(MEANINGS))  # misfits of the last seconds: several may gain
        self._found: Meaning | None = None

    def observe(self, image: Image, range_: float, ownship: Ownship) -> None:
        """An image of the leader, about so far away, m."""
        message = image.message
        camera = self._cameras.named(message.camera)
        if message.mount is not None or camera.gimbal is None:
            return
        mount, now = ownship.gimbals.of(camera, message.t_ns), self._sight(image, ownship)
        if mount is None or now is None:
            return
        self._used, self._signs = mount.frame, set[str](camera.gimbal_reversed)
        before = [s for s in self._sights if now.t_ns - s.t_ns >= given.GIMBAL_INTERVAL_S * NS_PER_S]
        self._sights.append(now)
        if len(before) < 2 or now.t_ns - before[0].t_ns < 1.8 * given.GIMBAL_INTERVAL_S * NS_PER_S:
            return
        while now.t_ns - self._sights[0].t_ns > 2.0 * given.GIMBAL_INTERVAL_S * NS_PER_S:
            self._sights.popleft()
        misfits = misfit(before[0], before[-1], now, range_)
        better = misfits[MEANINGS.index(Meaning(self._used))] - misfits
        gains = np.clip(better, -given.MAX_GIMBAL_GAIN, given.MAX_GIMBAL_GAIN) - given.GIMBAL_MARGIN
        self._gains = np.clip(self._gains + gains, 0.0, 2.0 * given.GIMBAL_LOG_LIKELIHOOD)
        limit = given.GIMBAL_LOG_LIKELIHOOD
        self._lately += given.MAX_GIMBAL_GAIN / limit * (np.minimum(misfits, limit) - self._lately)
        enough = self._gains >= limit
        if enough.any():
            self._found = MEANINGS[int(np.argmin(np.where(enough, self._lately, np.inf)))]
        elif not self._gains.any():
            self._found = None

    def _sight(self, image: Image, ownship: Ownship) -> Sighting | None:
        """The directions of an image; None where it is late, or a pose is not known."""
        t_ns, message = image.message.t_ns, image.message
        moved = np.zeros(3)
        if self._sights:
            last = self._sights[-1]
            if t_ns <= last.t_ns:
                return None
            steps = ownship.steps(last.t_ns, t_ns)
            if not steps or t_ns - last.t_ns > given.MAX_IMAGE_INTERVAL_S * NS_PER_S:
                self._sights.clear()
            else:
                moved = last.moved + sum(s.dt * s.v0 + 0.5 * s.dt**2 * s.a for s in steps)
        poses = [p.at(t_ns, ownship, p.camera.named(message.camera), message.mount) for p in self._poses]
        known = [pose.R_cn for pose in poses if pose is not None]
        if len(known) < len(poses):
            return None
        return Sighting(t_ns, image.measurement.axes[0] @ np.array(known), moved)

    @property
    def contradiction(self) -> Reason | None:
        """Return what contradicts the angles' meaning, None if nothing."""
        found = self._found
        if found is None or found.frame == self._used:
            return None
        if found.frame:
            words = (
                f"the gimbal's angles are flagged as against {WORDS[self._used]}, but the images fit angles "
                f'against {WORDS[found.frame]}: set `gimbal_frame = "{found.frame}"`, if they are'
            )
        else:
            signs = json.dumps(sorted(self._signs ^ {found.other_sign}))
            words = (
                f"the images fit a gimbal whose {found.other_sign} has the other sign: set "
                f"`gimbal_reversed = {signs}`, if it has"
            )
        return Reason(Cause.GIMBAL_FRAME, words)


def misfit(first: Sighting, middle: Sighting, last: Sighting, range_: float) -> Array:
    """Negative log-likelihoods (k,), but for a constant, that a leader so far away, m, which keeps its velocity,
    is seen in these three directions."""
    a, b = ((later.t_ns - earlier.t_ns) / NS_PER_S for earlier, later in ((first, middle), (middle, last)))
    places = [sight.moved + range_ * sight.directions for sight in (first, middle, last)]
    bend = 0.5 * (a + b) * ((places[2] - places[1]) / b - (places[1] - places[0]) / a)  # acceleration times dt^2
    across = bend - np.sum(bend * middle.directions, axis=1, keepdims=True) * middle.directions
    variance = (0.25 * given.STEADY_ACCELERATION * (a + b) ** 2) ** 2 + (given.GIMBAL_RATE_NOISE * range_) ** 2
    return np.asarray(0.5 * np.sum(across**2, axis=1) / variance)


def may_be_contradicted(cameras: Camera) -> bool:
    """Whether one of the cameras is on a gimbal."""
    return any(camera.gimbal is not None for camera in (cameras, *cameras.others))


def _with(camera: Camera, meaning: Meaning) -> Camera:
    """The camera, and those beside it, with another meaning of the angles of their gimbals.

    A configured frame stays."""
    others = tuple(_with(other, meaning) for other in camera.others)
    # an angle that is configured to have the other sign has its own again
    signs: set[Axis] = set(camera.gimbal_reversed) ^ ({meaning.other_sign} if meaning.other_sign else set())
    frame = camera.gimbal_frame or meaning.frame
    return replace(camera, gimbal_frame=frame, gimbal_reversed=tuple(sorted(signs)), others=others)
