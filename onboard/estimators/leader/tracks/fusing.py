"""A track's state, and its updates by own motion, an image, a report or a range."""

import math
from typing import Any, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.estimators.kit.history import History
from onboard.estimators.leader import assumptions as given
from onboard.estimators.leader.hypotheses.auxiliary import Auxiliary
from onboard.estimators.leader.hypotheses.belief import BeliefFilter, ImageComparison, Prediction
from onboard.estimators.leader.image.camera_pose import CameraPose, CameraPoses
from onboard.estimators.leader.image.detector import NoiseScale, Shown
from onboard.estimators.leader.image.measurement import Measurement
from onboard.estimators.leader.image.prepare import Image, measure, newest_pose
from onboard.filters.belief import FilterError, Update
from onboard.messages import TargetImage, Verdict
from onboard.messages.causes import Reason
from onboard.models.relative_motion import POSITION
from onboard.ownship import Ownship


class TrackState(NamedTuple):
    """The filter's state, what is known of the detector's noise, and its scale as the filter began."""

    leader: Any
    noise: NoiseScale
    supposed: float = 1.0


TrackHistory = History[TrackState, Ownship]
Predicted = tuple[TrackState, Prediction]  # a track at the time of an image, and its filter's hypotheses


class ImageRecord(NamedTuple):
    """Record of one image in a track.

    From its prediction to the verdict; life cycle, checks and report read it.

    Without a `verdict` it is an association hypothesis: the track's `state` before the image, and the image beside
    what the track expects (`compared`), None where it expects nothing."""

    message: TargetImage
    verdict: Verdict | None = None
    image: Image | None = None  # None: it cannot be used
    state: TrackState | None = None
    compared: ImageComparison | None = None
    fits: bool = False  # it passes the gate of what the track expects
    update: Update | None = None
    why: Reason | None = None  # the track ends
    before: TrackHistory | None = None  # of one that begins: what was believed before

    @property
    def nis(self) -> float:
        """Return the NIS of the image; 0 where the track expects nothing."""
        return 0.0 if self.compared is None else self.compared.expected.nis

    @property
    def cost(self) -> float:
        """See `ImageComparison.cost`; infinite where the track expects nothing."""
        return math.inf if self.compared is None else self.compared.cost


def advance(filter_: BeliefFilter, state: TrackState, t0_ns: int, t1_ns: int, ownship: Ownship) -> TrackState:
    """The state predicted from one time to another. Raises FilterError."""
    leader = state.leader
    for step in ownship.steps(t0_ns, t1_ns):
        leader = filter_.advance(leader, step)
    return TrackState(leader, state.noise, state.supposed)  # `_replace` takes thrice as long


def compare(
    filter_: BeliefFilter,
    poses: CameraPoses,
    noise: NoiseScale,
    predicted: Prediction,
    image: Image,
    ownship: Ownship,
) -> ImageComparison:
    """An image beside what is expected of it, by all that is known now of its detector and our own attitude.
    Raises FilterError."""
    pose = image.pose if image.view.is_final else newest_pose(image, poses, ownship)
    measured = image.measurement
    if noise.scale != image.noise_scale:
        measured = measure(filter_.shape, image.points.noisier(noise.scale))
    return filter_.compare(predicted, measured, pose)


def fuse(
    filter_: BeliefFilter,
    poses: CameraPoses,
    state: TrackState,
    taken: Image | Auxiliary,
    ownship: Ownship,
    compared: ImageComparison | None = None,
) -> tuple[TrackState, Update | bool]:
    """The state after it; and the update by an image, or whether anything else was used.

    `compared`: the image beside what is expected of it, where that is known. An image is fused if it passes the
    gate, and if the leader is then in front of the camera that saw it. Raises FilterError."""
    leader, noise, supposed = state
    if isinstance(taken, Auxiliary):
        after = filter_.assist(leader, taken)
        return state if after is None else state._replace(leader=after), after is not None
    try:
        if compared is None:
            compared = compare(filter_, poses, noise, filter_.predict(leader), taken, ownship)
        update = filter_.fuse(compared)
    except FilterError:
        if taken.has_extent:
            raise
        y = taken.measurement.rows.y  # a direction that the filter cannot use without beginning again with it
        return state, Update(leader, np.zeros(len(y)), np.eye(len(y)), y, math.inf, passes=False)
    measurement, pose = compared.measurement, compared.pose
    if math.isfinite(update.nis):
        variance, message = float(measurement.rows.R[0, 0]), taken.message
        shown = Shown(message.t_ns, message.camera, variance) if taken.points.offset == 0.0 else None
        noise = noise.after(update.innovation, update.innovation_covariance, shown)
    if update.passes and not is_in_sight(update.belief.summary.mean[POSITION], measurement, pose):
        update = update._replace(passes=False)
    if not update.passes:
        return state._replace(noise=noise), update
    leader = update.belief
    if taken.has_extent and noise.scale > math.sqrt(given.NOISE_RATIO_LIMIT) * supposed:
        # Begun anew from this image, but for its headings: hypotheses that died of a noise that was supposed too
        # small do not come back by a larger one. By the larger one, the NIS of the images before are less.
        again = measure(filter_.shape, taken.points.noisier(noise.scale)).with_attitude_noise(pose.noise_c)
        mean_nis = max(leader.particles.mean_nis * (supposed / noise.scale) ** 2, 1.0)
        leader, supposed = filter_.start(again, pose, leader, mean_nis=mean_nis), noise.scale
    return TrackState(leader, noise, supposed), update


def is_in_sight(r_FL_n: Array, measurement: Measurement, pose: CameraPose) -> bool:
    """Whether a place (3,) m is near the line of sight of an image, and not mirrored through us."""
    r = r_FL_n - pose.r_FC_n
    line = measurement.axes[0] @ pose.R_cn
    return bool(line @ r > math.cos(given.MAX_SIGHT_ANGLE) * math.sqrt(r @ r))


def passes(outcome: Update | bool) -> bool:
    """Whether what was inserted was an image that passed the gate."""
    return isinstance(outcome, Update) and outcome.passes
