"""A track's state, and what it becomes: by our own motion, an image, a report, a range, the wind."""

import math
from typing import Any, NamedTuple

import numpy as np

from onboard.estimators.leader.hypotheses.auxiliary import Auxiliary
from onboard.estimators.leader.hypotheses.belief import BeliefFilter, ImageComparison, Prediction
from onboard.estimators.leader.hypotheses.wind import Wind
from onboard.estimators.leader.image.camera_pose import CameraPoses
from onboard.estimators.leader.image.detector import NoiseScale
from onboard.estimators.leader.image.prepare import Image, measured, newest_pose
from onboard.estimators.leader.tracks.doubts import sight
from onboard.filters.belief import FilterError, Update
from onboard.ownship import Ownship


class TrackState(NamedTuple):
    """The filter's state, what is known of the detector's noise, and its scale as the filter began."""

    leader: Any
    noise: NoiseScale
    supposed: float = 1.0


Predicted = tuple[TrackState, Prediction]  # a track at the time of an image, and its filter's hypotheses


class Candidate(NamedTuple):
    """An image that may be of a track: the track's state before it, and the image beside what the track expects,
    None where it expects nothing; whether it `fits`, so that it passes the gate."""

    image: Image
    state: TrackState | None = None
    compared: ImageComparison | None = None
    fits: bool = False

    @property
    def nis(self) -> float:
        """By what the track expects; 0 where it expects nothing."""
        return 0.0 if self.compared is None else self.compared.nis

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
    pose = newest_pose(image, poses, ownship)
    return filter_.compare(predicted, measured(image, filter_.shape, noise.scale), pose)


def fuse(
    filter_: BeliefFilter,
    poses: CameraPoses,
    state: TrackState,
    taken: Image | Auxiliary | Wind,
    ownship: Ownship,
    compared: ImageComparison | None = None,
) -> tuple[TrackState, Update | bool]:
    """The state after it; and the update by an image, or whether anything else was used. `compared`: the image
    beside what is expected of it, where that is known. Raises FilterError."""
    leader = state.leader
    if isinstance(taken, Wind):
        return state._replace(leader=filter_.in_wind(leader, taken)), True
    if isinstance(taken, Auxiliary):
        after = filter_.assist(leader, taken)
        return state if after is None else state._replace(leader=after), after is not None
    try:
        if compared is None:
            compared = compare(filter_, poses, state.noise, filter_.predict(leader), taken, ownship)
        return _fused(filter_, state, taken, compared)
    except FilterError:
        if taken.has_extent:
            raise
        y = taken.measurement.y  # a direction that the filter cannot use without beginning again with it
        return state, Update(leader, np.zeros(len(y)), np.eye(len(y)), y, math.inf, passes=False)


def passes(outcome: Update | bool) -> bool:
    """Whether what was inserted was an image that passed the gate."""
    return isinstance(outcome, Update) and outcome.passes


def _fused(
    filter_: BeliefFilter, state: TrackState, image: Image, compared: ImageComparison
) -> tuple[TrackState, Update]:
    """The state after an image. It is fused if it passes the gate, and if the leader is then in front of the
    camera that saw it."""
    update, noise = filter_.fuse(compared), state.noise
    if math.isfinite(update.nis):
        noise = noise.after(update.innovation, update.innovation_covariance, compared.measurement.noise)
    if update.passes and not sight(compared.measurement.axes, compared.pose).shows(filter_.place(update.belief)):
        update = update._replace(passes=False)
    if not update.passes:
        return state._replace(noise=noise), update
    leader, supposed = update.belief, state.supposed
    if image.has_extent and noise.is_larger_than(supposed):
        # Begun anew from this image, but for its noses: hypotheses that died of a noise that was supposed too
        # small do not come back by a larger one. By the larger one, the images before surprise the less.
        measurement = measured(image, filter_.shape, noise.scale).with_attitude_noise(compared.pose.noise_c)
        surprise = max(leader.cloud.surprise * (supposed / noise.scale) ** 2, 1.0)
        leader, supposed = filter_.start(measurement, compared.pose, leader, surprise=surprise), noise.scale
    return TrackState(leader, noise, supposed), update
