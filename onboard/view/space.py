"""Drawing of records in the 3-D scene, in NED metres with the follower at the origin."""

import numpy as np

from onboard.arrays import Array
from onboard.geometry.rotations import quaternion_from_matrix
from onboard.messages import Estimate, OwnPose, Truth
from onboard.view import palette, scene
from onboard.view.columns import (
    HIDDEN,
    UNROTATED_WXYZ,
    Columns,
    Transform,
    ellipsoids,
    lines_3d,
    no_tags,
    tags,
    transforms,
)
from onboard.view.memory import DRAW_RATE_HZ, Memory
from onboard.view.motion import (
    LeaderArrays,
    course_quaternion,
    ellipsoid,
    heading_quaternion,
    open_interval,
    own_position,
)

TRAIL_RATE_HZ = 5.0
TAG_OFFSET = 3.0  # m above the leader, so as not to cover it
ORIGIN = (0.0, 0.0, 0.0)
UNIT_SCALE = (1.0, 1.0, 1.0)
MAX_TRUTH_AGE_NS = 500_000_000  # for its attitude to be used
NO_LINE = np.zeros((0, 3))


def hide_everything(columns: Columns, t_ns: int) -> None:
    """Hide entities that have no position before their first record."""
    for entity in scene.MOVING:
        columns.add(transforms, entity, t_ns, HIDDEN)
    for entity in (scene.HEADING, scene.AROUND_LEADER):  # a camera needs a frame of some size
        columns.add(transforms, entity, t_ns, Transform(ORIGIN, UNROTATED_WXYZ, UNIT_SCALE))


def extend_trail(columns: Columns, memory: Memory, name: str, t_ns: int, position: Array) -> None:
    """Extend a trail from its end to `position`, (3,) m from the EKF origin."""
    if not memory.is_due(f"trail {name}", t_ns, TRAIL_RATE_HZ):
        return
    end = memory.trail.get(name)
    memory.trail[name] = tuple(float(x) for x in position)
    if end is not None:
        columns.add(lines_3d, scene.TRAILS[name], t_ns, np.array([end, position], dtype=float))


def arrow(origin: Array, v_n: Array) -> Transform:
    """Return the pose of an arrow of unit length that shows the velocity v_n (3,)."""
    return Transform(origin, course_quaternion(v_n), np.full(3, scene.VELOCITY_SCALE * float(np.linalg.norm(v_n))))


def draw_own(columns: Columns, memory: Memory, pose: OwnPose) -> None:
    """Draw our attitude, our velocity, and the ground that passes below."""
    t_ns, position = pose.t_ns, np.asarray(pose.r_OF_n, dtype=float)
    if not (
        np.all(np.isfinite(position))
        and np.all(np.isfinite(pose.q_nb))
        and np.any(pose.q_nb)
        and np.all(np.isfinite(pose.v_F_n))
    ):
        return
    memory.own = pose
    if not memory.is_due("own", t_ns, DRAW_RATE_HZ):
        return
    columns.add(transforms, scene.FOLLOWER, t_ns, Transform(ORIGIN, pose.q_nb, UNIT_SCALE))
    columns.add(transforms, scene.HEADING, t_ns, Transform(ORIGIN, heading_quaternion(pose.q_nb), UNIT_SCALE))
    columns.add(transforms, scene.OWN_VELOCITY_PATH, t_ns, arrow(np.zeros(3), np.asarray(pose.v_F_n, dtype=float)))
    columns.add(transforms, scene.GROUND, t_ns, Transform(-position, UNROTATED_WXYZ, UNIT_SCALE))
    # the grid is endless, so a whole number of cells may be left out
    shift = -np.mod(position, scene.GRID_SPACING)
    columns.add(
        transforms, scene.GRID_PATH, t_ns, Transform((shift[0], shift[1], 0.0), UNROTATED_WXYZ, UNIT_SCALE)
    )
    extend_trail(columns, memory, "own", t_ns, position)


def draw_truth(columns: Columns, memory: Memory, truth: Truth) -> None:
    """Draw the true leader as an outline over the estimate."""
    r = np.asarray(truth.r_FL_n, dtype=float)
    if not (np.all(np.isfinite(r)) and memory.is_due("truth", truth.t_ns, DRAW_RATE_HZ)):
        return
    columns.add(transforms, scene.LEADER_TRUTH, truth.t_ns, Transform(r, truth.q_nL, np.full(3, truth.size)))
    extend_trail(columns, memory, "truth", truth.t_ns, np.asarray(truth.r_OL_n, dtype=float))


def leader_attitude(memory: Memory, t_ns: int, v_L_n: Array) -> Array:
    """Return the attitude (4,) of the true leader, else wings level along its course."""
    if memory.truths and abs(t_ns - memory.truths[-1].t_ns) < MAX_TRUTH_AGE_NS:
        return np.asarray(memory.truths[-1].q_nL, dtype=float)
    return course_quaternion(v_L_n if np.all(np.isfinite(v_L_n)) else np.array([1.0, 0.0, 0.0]))


def hide_leader(columns: Columns, t_ns: int) -> None:
    """Remove all entities of a track."""
    for entity in (scene.LEADER_PATH, scene.UNCERTAINTY, scene.LEADER_VELOCITY, *scene.OPEN_ENDS):
        columns.add(transforms, entity, t_ns, HIDDEN)
    for entity in (scene.SIGHT_LINE, scene.DROP_LINE, scene.OPEN_RANGE):
        columns.add(lines_3d, entity, t_ns, NO_LINE)
    columns.add(no_tags, scene.TAG, t_ns, None)


def draw_leader(columns: Columns, memory: Memory, estimate: Estimate, leader: LeaderArrays | None) -> None:
    """Draw the estimated leader, its uncertainty and velocity, and lines to us and to the grid."""
    t_ns = estimate.t_ns
    if not memory.is_due("leader", t_ns, DRAW_RATE_HZ):
        return
    if leader is None:
        hide_leader(columns, t_ns)
        return
    v_F_n = np.zeros(3) if memory.own is None else np.asarray(memory.own.v_F_n, dtype=float)
    v_L_n, r = v_F_n + leader.mean[3:6], leader.r
    span = leader.mean[6] if np.isfinite(leader.mean[6]) else 1.0
    body = Transform(r, leader_attitude(memory, t_ns, v_L_n), np.full(3, span))
    ends = open_interval(leader)
    # an aircraft drawn at the mean would look like one that is known to be there
    columns.add(transforms, scene.LEADER_PATH, t_ns, HIDDEN if ends else body)
    draw_open_range(columns, t_ns, body, ends)
    if ends:
        columns.add(transforms, scene.LEADER_VELOCITY, t_ns, HIDDEN)
    elif np.all(np.isfinite(v_L_n)):
        columns.add(transforms, scene.LEADER_VELOCITY, t_ns, arrow(r, v_L_n))
    half_axes, axes = ellipsoid(leader.covariance[:3, :3], scene.DRAWN_SIGMAS)
    columns.add(transforms, scene.UNCERTAINTY, t_ns, Transform(r, quaternion_from_matrix(axes), UNIT_SCALE))
    columns.add(ellipsoids, f"{scene.UNCERTAINTY}/ellipsoid", t_ns, half_axes)
    q_heading = UNROTATED_WXYZ if memory.own is None else heading_quaternion(memory.own.q_nb)
    columns.add(transforms, scene.AROUND_LEADER, t_ns, Transform(r, q_heading, UNIT_SCALE))
    columns.add(lines_3d, scene.SIGHT_LINE, t_ns, np.array([np.zeros(3), r]))
    columns.add(lines_3d, scene.DROP_LINE, t_ns, np.array([r, [r[0], r[1], 0.0]]))
    if memory.own is not None and not ends:
        extend_trail(columns, memory, "estimate", t_ns, own_position(memory.own, t_ns) + r)


def draw_open_range(columns: Columns, t_ns: int, body: Transform, ends: tuple[float, float] | None) -> None:
    """Draw an uncertain range as a line between `ends`, m, with outlines at both."""
    if ends is None:
        for entity in scene.OPEN_ENDS:
            columns.add(transforms, entity, t_ns, HIDDEN)
        columns.add(lines_3d, scene.OPEN_RANGE, t_ns, NO_LINE)
        return
    r = np.asarray(body.translation, dtype=float)
    places = [r * (end / max(float(np.linalg.norm(r)), 1e-6)) for end in ends]
    for entity, place in zip(scene.OPEN_ENDS, places, strict=True):
        columns.add(transforms, entity, t_ns, body._replace(translation=place))
    columns.add(lines_3d, scene.OPEN_RANGE, t_ns, np.array(places))


def draw_tag(columns: Columns, t_ns: int, leader: LeaderArrays, colour: palette.Colour, text: str) -> None:
    """Draw a label above the leader, or above its nearest position if the range is uncertain."""
    ends = open_interval(leader)
    place = leader.r if ends is None else leader.r * ends[0] / max(float(np.linalg.norm(leader.r)), 1e-6)
    columns.add(tags, scene.TAG, t_ns, (place - np.array([0.0, 0.0, TAG_OFFSET]), colour, text))
