"""What a filter's state becomes by what a track takes: an image, a size, the wind."""

from typing import Any

from onboard.estimators.leader.camera_pose import CameraPoses
from onboard.estimators.leader.filters.filter import LeaderFilter
from onboard.estimators.leader.filters.partial import refused
from onboard.estimators.leader.sight import sight
from onboard.estimators.leader.size import Size
from onboard.estimators.leader.tracks.image import Image, newest_pose
from onboard.estimators.leader.tracks.report import NO_OUTCOME, Outcome
from onboard.estimators.leader.wind import Wind
from onboard.filters.belief import FilterError
from onboard.models.relative_motion import R
from onboard.ownship import Ownship


def fuse(
    filter_: LeaderFilter, poses: CameraPoses, state: Any, taken: Image | Size | Wind, ownship: Ownship
) -> tuple[Any, Any]:
    """The state after it, and its outcome. An image is fused if it passes the gate, and if the leader is then in
    front of the camera that saw it. Raises FilterError."""
    if isinstance(taken, Size):
        return filter_.resized(state, taken), NO_OUTCOME
    if isinstance(taken, Wind):
        return filter_.in_wind(state, taken), NO_OUTCOME
    pose = newest_pose(taken, poses, ownship)
    try:
        update = filter_.fuse(state, taken.measurement.with_attitude_noise(pose.noise_c), pose)
    except FilterError:
        if taken.has_extent:
            raise
        return state, Outcome(False, refused(taken.measurement, state), state, pose)
    fused = filter_.gate is None or update.nis <= filter_.gate
    if fused and not sight(taken.measurement.axes, pose).shows(filter_.belief(update.belief).mean[R]):
        fused = False
    return (update.belief if fused else state), Outcome(fused, update, state, pose)
