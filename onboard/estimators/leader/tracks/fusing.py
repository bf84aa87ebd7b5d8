"""A track's state, and what it becomes: by our own motion, an image, a report, a range, the wind."""

import math
from typing import Any, Final, NamedTuple

import numpy as np

from onboard.estimators.leader.hypotheses.auxiliary import Auxiliary
from onboard.estimators.leader.hypotheses.belief import BeliefFilter
from onboard.estimators.leader.hypotheses.wind import Wind
from onboard.estimators.leader.image.camera_pose import CameraPose, CameraPoses
from onboard.estimators.leader.image.detector import NoiseScale
from onboard.estimators.leader.image.measurement import Measurement
from onboard.estimators.leader.image.prepare import Image, measured, newest_pose
from onboard.estimators.leader.tracks.doubts import sight
from onboard.filters.belief import FilterError, Update
from onboard.ownship import Ownship


class TrackState(NamedTuple):
    """The filter's state, what is known of the detector's noise, and its scale as the filter began."""

    leader: Any
    noise: NoiseScale
    supposed: float = 1.0


class Distance(NamedTuple):
    """How far an image is from a prediction, in order: whether it is beyond the gate, and then the NIS, or else
    NIS and spread together: of two predictions that an image fits, the sharper one is nearer."""

    beyond: bool
    misfit: float


FAR: Final = Distance(True, math.inf)


class Outcome(NamedTuple):
    """The filter's update by an image, and whether the gate let it pass."""

    fused: bool
    update: Update


class AuxiliaryOutcome(NamedTuple):
    """What was inserted was no image: whether it was used."""

    used: bool
    fused: bool = False


def advance(filter_: BeliefFilter, state: TrackState, t0_ns: int, t1_ns: int, ownship: Ownship) -> TrackState:
    """The state predicted from one time to another. Raises FilterError."""
    leader = state.leader
    for step in ownship.steps(t0_ns, t1_ns):
        leader = filter_.advance(leader, step)
    return TrackState(leader, state.noise, state.supposed)  # `_replace` takes thrice as long


def seen(
    filter_: BeliefFilter, poses: CameraPoses, state: TrackState, image: Image, ownship: Ownship
) -> tuple[Measurement, CameraPose]:
    """What an image measures, by all that is known now of its detector and our own attitude; its camera's pose."""
    pose = newest_pose(image, poses, ownship)
    return filter_.seen(measured(image, filter_.shape, state.noise.scale), pose), pose


def fuse(
    filter_: BeliefFilter, poses: CameraPoses, state: TrackState, taken: Image | Auxiliary | Wind, ownship: Ownship
) -> tuple[TrackState, Any]:
    """The state after it, and its outcome. An image is fused if it passes the gate, and if the leader is then in
    front of the camera that saw it. Raises FilterError."""
    leader = state.leader
    if isinstance(taken, Wind):
        return state._replace(leader=filter_.in_wind(leader, taken)), AuxiliaryOutcome(True)
    if isinstance(taken, Auxiliary):
        after = filter_.assist(leader, taken)
        return state if after is None else state._replace(leader=after), AuxiliaryOutcome(after is not None)
    measurement, pose = seen(filter_, poses, state, taken, ownship)
    try:
        update = filter_.fuse(leader, measurement, pose)
    except FilterError:
        if taken.has_extent:
            raise
        return state, Outcome(False, _refused(measurement, leader))
    noise = state.noise
    if math.isfinite(update.nis):
        noise = noise.after(update.innovation, update.innovation_covariance, measurement.noise)
    fused = update.passes
    if fused and not sight(measurement.axes, pose).shows(filter_.place(update.belief)):
        fused = False
    next_ = state._replace(leader=update.belief if fused else leader, noise=noise)
    if fused and taken.has_extent and noise.is_larger_than(state.supposed):
        next_ = _begun_anew(filter_, next_, measured(taken, filter_.shape, noise.scale), pose)
    return next_, Outcome(fused, update)


def _begun_anew(
    filter_: BeliefFilter, state: TrackState, measurement: Measurement, pose: CameraPose
) -> TrackState:
    """The state from one image alone, but for its noses: hypotheses that died of a noise that was supposed too
    small do not come back by a larger one. By the larger one, the images before surprise the less."""
    surprise = state.leader.cloud.surprise * (state.supposed / state.noise.scale) ** 2
    leader = filter_.start(
        measurement.with_attitude_noise(pose.noise_c), pose, state.leader, surprise=max(surprise, 1.0)
    )
    return state._replace(leader=leader, supposed=state.noise.scale)


def _refused(measurement: Measurement, state: Any) -> Update:
    """The update by a direction that the filter could not use, because it would have had to start again with
    it."""
    m = len(measurement.y)
    return Update(state, np.zeros(m), np.eye(m), measurement.y, math.inf)
