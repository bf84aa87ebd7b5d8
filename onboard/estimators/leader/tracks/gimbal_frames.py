"""Whether a gimbal's angles are against the frame that its flags name, by how well the images of the leader fit.

Servo gimbals send angles against the body under flags that say otherwise. With angles against a wrong frame, the
leader swings with our own rotations, and its wing banks without a turn. One plain filter for each frame follows
the leader; where the images are likelier by another frame than by the flagged one, image after image, the flags
are wrong, or the angles are.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Final, NamedTuple, get_args

from onboard.estimators.leader.config import Config
from onboard.estimators.leader.hypotheses.belief import BeliefFilter
from onboard.estimators.leader.image.camera_pose import CameraPoses
from onboard.estimators.leader.image.detector import NoiseScale
from onboard.estimators.leader.tracks.track import Track
from onboard.geometry.camera import Camera
from onboard.messages import MeasurementReport, MountFrame, TargetImage
from onboard.messages.causes import Cause, Reason
from onboard.ownship import Ownship

WORDS: Final[Mapping[MountFrame, str]] = {
    "body": "our body",
    "earth": "north and the horizon",
    "heading": "our heading and the horizon",
}
MARGIN: Final = 0.5  # of log-likelihood an image: frames that fit about equally well decide nothing
MOST: Final = 4.0  # of log-likelihood that one image may add
ENOUGH: Final = 150.0  # of log-likelihood: two seconds of images at least


class FrameFit(NamedTuple):
    """How badly an image fits its prediction: the two parts of its negative log-likelihood, half the NIS and the
    logarithm of the innovation's spread."""

    misfit: float
    spread: float

    def gain_over(self, flagged: "FrameFit") -> float:
        """The evidence for this frame: log-likelihood, and no more than the NIS shows. A frame through which no
        noise of our own attitude passes has the smaller spread, and is no righter for that."""
        misfit = flagged.misfit - self.misfit
        return min(misfit, misfit + flagged.spread - self.spread)


class GimbalFrames:
    """A track of the leader for each frame, by `filter_`, and the evidence against the flagged frame, of the
    `cameras` of which that `may_be_contradicted`."""

    def __init__(self, name: str, filter_: BeliefFilter, config: Config, cameras: Camera) -> None:
        self._cameras, self._gains = cameras, dict.fromkeys(WORDS, 0.0)
        self._flagged: MountFrame = "heading"
        self._found: MountFrame | None = None
        self._tracks: dict[MountFrame, Track] = {}
        for frame in get_args(MountFrame):
            poses = CameraPoses(_against(cameras, frame))
            self._tracks[frame] = Track(name, name, filter_, poses, config, noise=NoiseScale(is_fixed=True))

    def observe(self, message: TargetImage, ownship: Ownship) -> None:
        """An image of the leader."""
        camera = self._cameras.named(message.camera)
        if message.mount is not None or camera.gimbal is None or not _is_flagged(camera):
            return
        reports = {frame: track.observe(message, ownship).measurement for frame, track in self._tracks.items()}
        fits = {frame: _fit(report) for frame, report in reports.items()}
        mount = ownship.gimbals.at(camera.gimbal, message.t_ns)
        if mount is None or not all(math.isfinite(fit.misfit) for fit in fits.values()):
            return
        self._flagged = mount.frame
        for frame, fit in fits.items():
            gain = min(max(fit.gain_over(fits[mount.frame]), -MOST), MOST) - MARGIN
            self._gains[frame] = min(max(self._gains[frame] + gain, 0.0), 2.0 * ENOUGH)
        best = max(self._gains, key=self._gains.__getitem__)
        if self._gains[best] >= ENOUGH:
            self._found = best
        elif self._gains[best] == 0.0:
            self._found = None

    def clear(self, why: Reason) -> None:
        """Forget all tracks, times and evidence."""
        for track in self._tracks.values():
            track.reset(why)
        self._gains, self._found = dict.fromkeys(WORDS, 0.0), None

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


def may_be_contradicted(cameras: Camera) -> bool:
    """Whether one of the cameras is on a gimbal whose `gimbal_frame` is not configured: its flags say it."""
    return any(_is_flagged(camera) for camera in (cameras, *cameras.others))


def _is_flagged(camera: Camera) -> bool:
    return camera.gimbal is not None and not camera.gimbal_frame


def _against(camera: Camera, frame: MountFrame) -> Camera:
    """The camera, and those beside it, with the angles of their gimbals against a frame."""
    others = tuple(_against(other, frame) for other in camera.others)
    return replace(camera, gimbal_frame=frame if _is_flagged(camera) else camera.gimbal_frame, others=others)


def _fit(report: MeasurementReport | None) -> FrameFit:
    """Of an image that was compared with its prediction; infinite for another."""
    if report is None or report.nis is None or report.innovation_sigma is None:
        return FrameFit(math.inf, 0.0)
    return FrameFit(0.5 * report.nis, sum(map(math.log, report.innovation_sigma)))
