"""The families of encounters: the motion of both aircraft and the leader's heading."""

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, Final, Literal, NamedTuple

import numpy as np

from simlink.encounters.curves import (
    Motion,
    follow_path,
    heading_vector,
    motion_from_positions,
    motion_from_velocities,
    moving_average,
    wander,
    waves,
)
from simlink.scenarios.camera import Mistaken
from simlink.sensors.arrays import Array
from simlink.world.constants import DT, GRAVITY

LeaderClass = Literal["fixed_wing", "multirotor"]
DISTANCE_RANGE_M: Final = (18.0, 40.0)  # of most families
MAX_HEIGHT_OFFSET: Final = 3.0  # m, of the follower above or below
MIN_DISTANCE: Final = 6.0  # m; a slot that leads nearer in the leader's manoeuvre is drawn again


class Scene(NamedTuple):
    """The motion of both aircraft, the leader's heading and the wind.

    The heading `nose` (N,) is in rad and without its random error; the wind (3,) is in n, m/s.
    """

    leader: Motion
    nose: Array
    follower: Motion
    wind: Array
    leader_class: LeaderClass = "multirotor"
    elevation: float = 0.0  # rad, how far above the horizon our camera is mounted to look
    manoeuvre: float | None = None  # s, when the leader begins the one manoeuvre of this family; None: it has none
    aim: Array | float = 0.0  # (N,) how far we turn the camera past the leader; 1: to the image's edge
    camera: Mapping[str, Any] = MappingProxyType({})  # what this family changes of the camera and its detector
    sail: float = 0.0  # 1/s, the leader's drag along its nose, beyond that from all sides
    other: Motion | None = None  # of another multirotor of the same kind, its nose on its course


def _draw_side(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _draw_breeze(rng: np.random.Generator) -> Array:
    return float(rng.uniform(0.0, 4.0)) * heading_vector(np.array(rng.uniform(0.0, math.tau)))


def _height_offset(rng: np.random.Generator) -> Array:
    return np.array([0.0, 0.0, rng.uniform(-MAX_HEIGHT_OFFSET, MAX_HEIGHT_OFFSET)])


def _hover_motion(rng: np.random.Generator, t: Array, place: Array, vigour: float = 1.0) -> Motion:
    return motion_from_positions(place + vigour * wander(rng, t, (0.3, 0.3, 0.15), (9.0, 5.0)))


def _slot_sway(rng: np.random.Generator, t: Array) -> Array:
    """Return a follower's random offset from its slot (N, 3), with an amplitude of 0.1 to 3 m.

    The logarithm of the amplitude is uniform: 0.1 m is position control in calm air.
    """
    amplitude = 10.0 ** rng.uniform(-1.0, 0.5)
    return wander(rng, t, (amplitude, amplitude, 0.3 * amplitude), (11.0, 7.0, 5.0))


def _follower_behind(
    rng: np.random.Generator,
    t: Array,
    leader: Motion,
    direction: Array,
    distance: tuple[float, float] = DISTANCE_RANGE_M,
) -> Motion:
    """Return a follower that sees the leader in this direction (N,) and wanders in its slot."""
    slot = -rng.uniform(*distance) * heading_vector(direction) + _height_offset(rng)
    return motion_from_positions(leader.r + slot + _slot_sway(rng, t))


def _draw_heading(rng: np.random.Generator, course: float) -> float:
    """Return a multirotor's heading: its course in half of the flights, else any."""
    return course if rng.uniform() < 0.5 else float(rng.uniform(0.0, math.tau))


def _course_and_speed(rng: np.random.Generator, t: Array, vigour: float) -> tuple[Array, Array]:
    """Return course (N,) and speed (N,) in forward flight; half of the leaders turn."""
    turn = rng.uniform(-0.12, 0.12) if rng.uniform() < 0.5 else 0.0
    course = rng.uniform(0.0, math.tau) + vigour * turn * t + vigour * waves(rng, t, 0.05, (18.0,))
    return course, rng.uniform(6.0, 14.0) + vigour * waves(rng, t, rng.uniform(0.0, 1.0), (22.0,))


def behind(rng: np.random.Generator, t: Array, vigour: float = 1.0) -> Scene:
    """The control: the leader's nose is on its course, and we fly behind it."""
    course, speed = _course_and_speed(rng, t, vigour)
    leader = motion_from_velocities(speed[:, None] * heading_vector(course))
    return Scene(
        leader, course, _follower_behind(rng, t, leader, course + rng.uniform(-0.5, 0.5)), _draw_breeze(rng)
    )


def hover(rng: np.random.Generator, t: Array, vigour: float = 1.0) -> Scene:
    """Both hover, the leader's nose anywhere."""
    leader = _hover_motion(rng, t, np.zeros(3), vigour)
    place = -rng.uniform(*DISTANCE_RANGE_M) * heading_vector(
        np.array(rng.uniform(0.0, math.tau))
    ) + _height_offset(rng)
    return Scene(
        leader, np.full_like(t, rng.uniform(0.0, math.tau)), _hover_motion(rng, t, place), _draw_breeze(rng)
    )


def circling(rng: np.random.Generator, t: Array, vigour: float = 1.0) -> Scene:
    """We circle a leader that hovers, its nose anywhere, at 3 to 7 m/s."""
    leader = _hover_motion(rng, t, np.zeros(3), vigour)
    distance = rng.uniform(*DISTANCE_RANGE_M)
    direction = rng.uniform(0.0, math.tau) + _draw_side(rng) * rng.uniform(3.0, 7.0) / distance * t
    place = (
        -distance * heading_vector(direction) + _height_offset(rng) + wander(rng, t, (1.0, 1.0, 0.5), (9.0, 6.0))
    )
    return Scene(
        leader, np.full_like(t, rng.uniform(0.0, math.tau)), motion_from_positions(place), _draw_breeze(rng)
    )


def crossing(rng: np.random.Generator, t: Array, vigour: float = 1.0) -> Scene:
    """The leader crosses our line of sight halfway through the flight.

    It crosses at 45 to 135 degrees while we drift.
    """
    del vigour  # it flies straight
    sight = rng.uniform(0.0, math.tau)
    course = sight + _draw_side(rng) * np.radians(rng.uniform(45.0, 135.0))
    since = (t - 0.5 * t[-1])[:, None]
    velocity = rng.uniform(2.0, 5.0) * heading_vector(np.array(course))
    leader = motion_from_positions(
        rng.uniform(*DISTANCE_RANGE_M) * heading_vector(np.array(sight)) + since * velocity
    )
    drift = rng.uniform(0.0, 2.0) * heading_vector(np.array(rng.uniform(0.0, math.tau)))
    follower = motion_from_positions(
        since * drift + _height_offset(rng) + wander(rng, t, (2.0, 2.0, 0.5), (10.0, 7.0))
    )
    return Scene(leader, np.full_like(t, course), follower, _draw_breeze(rng))


def sideways(rng: np.random.Generator, t: Array, vigour: float = 1.0) -> Scene:
    """The leader flies with its nose 40 to 140 degrees off its course, and we fly along."""
    course, speed = _course_and_speed(rng, t, vigour)
    leader = motion_from_velocities(speed[:, None] * heading_vector(course))
    nose = course + _draw_side(rng) * np.radians(rng.uniform(40.0, 140.0))
    return Scene(
        leader, nose, _follower_behind(rng, t, leader, course + rng.uniform(-0.6, 0.6)), _draw_breeze(rng)
    )


def _fixed_wing(course: Array, airspeed: float, wind: Array) -> tuple[Array, Array]:
    """Return ground speed and heading of a fixed wing that keeps its course in a wind.

    Both have the shape of `course`.
    """
    along, across = heading_vector(course) @ wind, heading_vector(course + math.tau / 4) @ wind
    correction = np.arcsin(across / airspeed)
    return along + airspeed * np.cos(correction), course - correction


def crab(rng: np.random.Generator, t: Array, vigour: float = 1.0) -> Scene:
    """A fixed wing weaves in a crosswind, and we fly along.

    Its nose points 10 to 28 degrees off its course.
    """
    ahead = rng.uniform(0.0, math.tau)
    course = ahead + vigour * waves(rng, t, np.radians(rng.uniform(2.0, 10.0)), (18.0,))
    airspeed = rng.uniform(13.0, 20.0)  # of small fixed wings
    wind = (
        _draw_side(rng)
        * airspeed
        * np.sin(np.radians(rng.uniform(11.0, 26.0)))
        * heading_vector(np.array(ahead + math.tau / 4))
    )
    speed, nose = _fixed_wing(course, airspeed, wind)
    leader = motion_from_velocities(speed[:, None] * heading_vector(course))
    follower = _follower_behind(rng, t, leader, course + rng.uniform(-0.5, 0.5))
    return Scene(leader, nose, follower, wind, "fixed_wing")


def wandering(rng: np.random.Generator, t: Array, vigour: float = 1.0) -> Scene:
    """Both wander at up to 3 m/s; the leader's nose turns at up to 0.2 rad/s half of the time."""

    def path(place: Array, fast: float = 1.0) -> Motion:
        v = wander(rng, t, (1.0, 1.0, 0.2), (25.0, 14.0))
        r = motion_from_velocities(v * (fast * rng.uniform(1.0, 3.0) / np.linalg.norm(v, axis=1).max())).r
        return motion_from_positions(place + r - r.mean(axis=0))

    rates, begin, turns = np.zeros_like(t), 0.0, bool(rng.uniform() < 0.5)
    while begin < t[-1]:
        end = begin + rng.uniform(3.0, 8.0)
        rates[(t >= begin) & (t < end)] = _draw_side(rng) * rng.uniform(0.05, 0.2) if turns else 0.0
        begin, turns = end, not turns
    nose = rng.uniform(0.0, math.tau) + np.cumsum(moving_average(rates, 0.8)) * DT
    place = -rng.uniform(28.0, 45.0) * heading_vector(np.array(rng.uniform(0.0, math.tau))) + _height_offset(rng)
    return Scene(path(np.zeros(3), vigour), nose, path(place), _draw_breeze(rng))


def head_on(rng: np.random.Generator, t: Array, vigour: float = 1.0) -> Scene:
    """The leader passes us at a distance of 6 to 12 m while we hover.

    It comes from 90 to 140 m away at 8 to 14 m/s.
    """
    del vigour  # it flies straight
    sight = rng.uniform(0.0, math.tau)
    velocity = -rng.uniform(8.0, 14.0) * heading_vector(np.array(sight))
    aside = _draw_side(rng) * rng.uniform(6.0, 12.0) * heading_vector(np.array(sight + math.tau / 4))
    leader = motion_from_positions(
        rng.uniform(90.0, 140.0) * heading_vector(np.array(sight)) + aside + t[:, None] * velocity
    )
    follower = motion_from_positions(_height_offset(rng) + wander(rng, t, (1.0, 1.0, 0.5), (10.0, 7.0)))
    return Scene(leader, np.full_like(t, sight + math.tau / 2), follower, _draw_breeze(rng))


def stop_turn_leave(rng: np.random.Generator, t: Array, vigour: float = 1.0) -> Scene:
    """The leader starts, stops, turns and leaves; we follow a second late.

    It turns by up to 2 rad and leaves along its new heading.
    """
    first, speed = rng.uniform(0.0, math.tau), rng.uniform(4.0, 10.0)
    ramp = 4.0 / vigour  # s
    times = np.cumsum([rng.uniform(2.0, 5.0), ramp, rng.uniform(8.0, 12.0), ramp, rng.uniform(6.0, 9.0), ramp])
    fast = moving_average(np.interp(t, times, [0.0, speed, speed, 0.0, 0.0, speed]), 0.6)
    turning = rng.uniform(2.0, 4.0)  # s
    begin = times[3] + 1.0
    nose = moving_average(np.interp(t, [begin, begin + turning], [first, first + rng.uniform(-2.0, 2.0)]), 0.6)
    leader = motion_from_velocities(fast[:, None] * heading_vector(nose))
    late = np.stack([moving_average(np.interp(t - 1.0, t, x), 1.5) for x in leader.r.T], axis=-1)
    return Scene(
        leader, nose, _follower_behind(rng, t, leader._replace(r=late), np.full_like(t, first)), _draw_breeze(rng)
    )


def straight_sideways(rng: np.random.Generator, t: Array, vigour: float = 1.0) -> Scene:
    """The leader flies straight with its nose off its course, and we fly along.

    It flies at 4 to 10 m/s with its nose 40 to 140 degrees off. We are behind it in half of the flights, else
    anywhere around it.
    """
    course = rng.uniform(0.0, math.tau)
    straight = t[:, None] * (rng.uniform(4.0, 10.0) * heading_vector(np.array(course)))
    leader = motion_from_positions(straight + vigour * wander(rng, t, (0.3, 0.3, 0.15), (9.0, 5.0)))
    nose = course + _draw_side(rng) * np.radians(rng.uniform(40.0, 140.0))
    direction = course + rng.uniform(-0.6, 0.6) if rng.uniform() < 0.5 else rng.uniform(0.0, math.tau)
    follower = _follower_behind(rng, t, leader, np.full_like(t, direction), (15.0, 32.0))
    return Scene(leader, np.full_like(t, nose), follower, _draw_breeze(rng))


def steep(rng: np.random.Generator, t: Array, vigour: float = 1.0) -> Scene:
    """We see the leader 45 to 65 degrees above or below us.

    It hovers in half of the flights and flies forward in the others.
    """
    elevation = _draw_side(rng) * np.radians(rng.uniform(45.0, 65.0))
    if rng.uniform() < 0.5:
        leader, nose = _hover_motion(rng, t, np.zeros(3), vigour), np.full_like(t, rng.uniform(0.0, math.tau))
    else:
        course, speed = _course_and_speed(rng, t, vigour)
        leader = motion_from_velocities(speed[:, None] * heading_vector(course))
        nose = course + _draw_heading(rng, 0.0)
    up = np.array([0.0, 0.0, -np.sin(elevation)])
    away = rng.uniform(*DISTANCE_RANGE_M) * (
        np.cos(elevation) * heading_vector(np.array(rng.uniform(0.0, math.tau))) + up
    )
    follower = motion_from_positions(leader.r - away + 0.5 * _slot_sway(rng, t))
    return Scene(leader, nose, follower, _draw_breeze(rng), elevation=elevation)


def loiter(rng: np.random.Generator, t: Array, vigour: float = 1.0) -> Scene:
    """A fixed wing circles around us while we hover.

    Its circle of 30 to 60 m is fixed to the ground, and we are up to 10 m off the centre.
    """
    del vigour  # it keeps its circle
    radius, side, wind = rng.uniform(30.0, 60.0), _draw_side(rng), _draw_breeze(rng)
    airspeed = np.sqrt(GRAVITY * radius * np.tan(np.radians(rng.uniform(15.0, 30.0))))  # at these banks
    first = rng.uniform(0.0, math.tau)
    around = np.full_like(t, first)
    for _ in range(40):  # the speed depends on the place in the circle: iterated until both agree
        speed, nose = _fixed_wing(around + side * math.tau / 4, airspeed, wind)
        around = first + side * DT / radius * np.cumsum(speed)
    leader = motion_from_positions(radius * heading_vector(around))
    off = rng.uniform(0.0, 10.0) * heading_vector(np.array(rng.uniform(0.0, math.tau)))
    follower = motion_from_positions(off + 3.0 * _height_offset(rng) + _slot_sway(rng, t))
    return Scene(leader, nose, follower, wind, "fixed_wing")


def _change_velocity(
    rng: np.random.Generator, t: Array, nose: float, before: Array, after: Array, vigour: float
) -> Scene:
    """Return a scene in which the leader changes its velocity once.

    It flies at `before` (3,) for 12 to 22 s and changes to `after` (3,), both in n, at 1.5 to 4 m/s^2. We are
    anywhere around it and follow 1 to 3 s late with limited acceleration.
    """
    begin, strength = rng.uniform(12.0, 22.0), vigour * rng.uniform(1.5, 4.0)
    share = moving_average(np.clip((t - begin) * strength / np.linalg.norm(after - before), 0.0, 1.0), 0.3)
    path = motion_from_velocities(before + share[:, None] * (after - before)).r
    leader = motion_from_positions(path + vigour * wander(rng, t, (0.3, 0.3, 0.15), (9.0, 5.0)))
    ours = follow_path(path, rng.uniform(1.0, 3.0), rng.uniform(2.0, 4.0)) + _slot_sway(rng, t)
    while True:
        slot = -rng.uniform(*DISTANCE_RANGE_M) * heading_vector(
            np.array(rng.uniform(0.0, math.tau))
        ) + _height_offset(rng)
        if np.linalg.norm(leader.r - ours - slot, axis=1).min() > MIN_DISTANCE:
            break
    return Scene(
        leader, np.full_like(t, nose), motion_from_positions(ours + slot), _draw_breeze(rng), manoeuvre=begin
    )


def leaves_hover(rng: np.random.Generator, t: Array, vigour: float = 1.0) -> Scene:
    """The leader hovers, then leaves at 5 to 12 m/s."""
    course = rng.uniform(0.0, math.tau)
    away = rng.uniform(5.0, 12.0) * heading_vector(np.array(course))
    return _change_velocity(rng, t, _draw_heading(rng, course), np.zeros(3), away, vigour)


def stops(rng: np.random.Generator, t: Array, vigour: float = 1.0) -> Scene:
    """The leader flies straight at 4 to 10 m/s, then stops and stands."""
    course = rng.uniform(0.0, math.tau)
    before = rng.uniform(4.0, 10.0) * heading_vector(np.array(course))
    return _change_velocity(rng, t, _draw_heading(rng, course), before, np.zeros(3), vigour)


def reverses(rng: np.random.Generator, t: Array, vigour: float = 1.0) -> Scene:
    """The leader flies straight at 4 to 10 m/s, then backwards at 2 to 8 m/s."""
    course = rng.uniform(0.0, math.tau)
    ahead = heading_vector(np.array(course))
    return _change_velocity(
        rng, t, _draw_heading(rng, course), rng.uniform(4.0, 10.0) * ahead, -rng.uniform(2.0, 8.0) * ahead, vigour
    )


def climbs(rng: np.random.Generator, t: Array, vigour: float = 1.0) -> Scene:
    """The leader hovers or flies straight, then climbs or descends as well.

    It flies at up to 8 m/s and climbs or descends at 1 to 3 m/s.
    """
    course = rng.uniform(0.0, math.tau)
    before = max(0.0, rng.uniform(-8.0, 8.0)) * heading_vector(np.array(course))
    climb = np.array([0.0, 0.0, _draw_side(rng) * rng.uniform(1.0, 3.0)])
    return _change_velocity(rng, t, _draw_heading(rng, course), before, before + climb, vigour)


def cut(rng: np.random.Generator, t: Array, vigour: float = 1.0) -> Scene:
    """The image's edge cuts the leader's box for part of the time.

    Both hover, 8 to 16 m apart, while our camera swings past the leader and back. A cut box ends up to 8 px inside
    the edge.
    """
    scene = hover(rng, t, vigour)
    away = scene.follower.r[0] - scene.leader.r[0]
    near = scene.follower.r + (rng.uniform(8.0, 16.0) / np.linalg.norm(away) - 1.0) * away
    swing = rng.uniform(0.95, 1.15) * np.sin(math.tau * (t / rng.uniform(12.0, 24.0) + rng.uniform()))
    camera = {"least_inside": rng.uniform(0.3, 0.6), "edge_gap_px": rng.uniform(0.0, 8.0)}
    return scene._replace(follower=motion_from_positions(near), aim=swing, camera=camera)


def class_flickers(rng: np.random.Generator, t: Array, vigour: float = 1.0) -> Scene:
    """The detector takes the leader of `behind` or `hover` for an airplane for short times.

    It does so for 0.05 to 0.4 s every few seconds and, in half of the flights, for up to 3 s at the start.
    """
    scene = (behind if rng.uniform() < 0.5 else hover)(rng, t, vigour)
    ends = [0.0, max(0.0, float(rng.uniform(-3.0, 3.0)))]
    while ends[-1] < t[-1]:
        begin = ends[-1] + 0.1 + rng.exponential(6.0)
        ends += [begin, begin + rng.uniform(0.05, 0.4)]
    wrong = [
        Mistaken(start=a, end=b, class_name="airplane") for a, b in zip(ends[::2], ends[1::2], strict=True) if b
    ]
    return scene._replace(camera={"class_name": "drone", "mistaken": tuple(wrong)})


def two_cross(rng: np.random.Generator, t: Array, vigour: float = 1.0) -> Scene:
    """Another multirotor crosses our line of sight to the leader halfway through the flight.

    Both of us hover. It passes within 1.5 degrees of the leader at 0.65 to 0.8 or 1.25 to 1.55 times its range.
    The detector gives no ids and lists the leader first.
    """
    scene = hover(rng, t, vigour)
    sight = scene.leader.r[len(t) // 2] - scene.follower.r[len(t) // 2]
    share = rng.uniform(0.65, 0.8) if rng.uniform() < 0.5 else rng.uniform(1.25, 1.55)
    across = _draw_side(rng) * heading_vector(np.arctan2(sight[1], sight[0]) + np.array(0.25 * math.tau))
    above = np.array([0.0, 0.0, np.radians(rng.uniform(-1.5, 1.5)) * share * np.linalg.norm(sight)])
    since = (t - 0.5 * t[-1])[:, None]
    path = scene.follower.r[len(t) // 2] + share * sight + above + rng.uniform(2.0, 4.0) * since * across
    return scene._replace(other=motion_from_positions(path), camera={"has_ids": False})


# Each draws a scene at the times t (N,) s; its leader manoeuvres `vigour` times as hard as drawn.
FAMILIES: Final[Mapping[str, Callable[[np.random.Generator, Array, float], Scene]]] = {
    "behind": behind,
    "hover": hover,
    "circling": circling,
    "crossing": crossing,
    "sideways": sideways,
    "crab": crab,
    "wander": wandering,
    "head_on": head_on,
    "stop_turn_leave": stop_turn_leave,
    "straight_sideways": straight_sideways,
    "steep": steep,
    "loiter": loiter,
    "leaves_hover": leaves_hover,
    "stops": stops,
    "reverses": reverses,
    "climbs": climbs,
    "cut": cut,
    "class_flickers": class_flickers,
    "two_cross": two_cross,
}
