"""The families of encounters: how the two aircraft move, and where the leader's nose points."""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, Final, Literal, NamedTuple

import numpy as np

from simlink.encounters.curves import Motion, blurred, following, level, moving, travelling, wander, waves
from simlink.scenarios.camera import Mistaken
from simlink.sensors.arrays import Array
from simlink.world.constants import DT, G

LeaderClass = Literal["fixed_wing", "multirotor"]
DISTANCE: Final = (18.0, 40.0)  # m, the usual
HEIGHT: Final = 3.0  # m, at most, that the follower is above or below
NEAREST: Final = 6.0  # m: a follower that would come nearer in a leader's manoeuvre has another slot
TURN: Final = 2.0 * np.pi


class Scene(NamedTuple):
    """Both motions, the leader's heading `nose` (N,) in rad, without its wobble, and the wind (3,) in n, m/s."""

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


def _side(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _breeze(rng: np.random.Generator) -> Array:
    return float(rng.uniform(0.0, 4.0)) * level(np.array(rng.uniform(0.0, TURN)))


def _below(rng: np.random.Generator) -> Array:
    return np.array([0.0, 0.0, rng.uniform(-HEIGHT, HEIGHT)])


def _hovering(rng: np.random.Generator, t: Array, place: Array, vigour: float = 1.0) -> Motion:
    return moving(place + vigour * wander(rng, t, (0.3, 0.3, 0.15), (9.0, 5.0)))


def _sway(rng: np.random.Generator, t: Array) -> Array:
    """How a follower wanders in its slot (N, 3): by a decimetre, as position control holds a copter in calm air,
    to some metres; all orders of magnitude are as probable."""
    amplitude = 10.0 ** rng.uniform(-1.0, 0.5)
    return wander(rng, t, (amplitude, amplitude, 0.3 * amplitude), (11.0, 7.0, 5.0))


def _behind(
    rng: np.random.Generator, t: Array, leader: Motion, direction: Array, distance: tuple[float, float] = DISTANCE
) -> Motion:
    """A follower that has the leader in this direction (N,), and wanders in its slot."""
    slot = -rng.uniform(*distance) * level(direction) + _below(rng)
    return moving(leader.r + slot + _sway(rng, t))


def _nose(rng: np.random.Generator, course: float) -> float:
    """The heading of a multirotor: on its course in half of the flights, anywhere in the others."""
    return course if rng.uniform() < 0.5 else float(rng.uniform(0.0, TURN))


def _flown(rng: np.random.Generator, t: Array, vigour: float) -> tuple[Array, Array]:
    """Course (N,) and speed (N,) of a leader that flies on; half of them turn steadily."""
    turn = rng.uniform(-0.12, 0.12) if rng.uniform() < 0.5 else 0.0
    course = rng.uniform(0.0, TURN) + vigour * turn * t + vigour * waves(rng, t, 0.05, (18.0,))
    return course, rng.uniform(6.0, 14.0) + vigour * waves(rng, t, rng.uniform(0.0, 1.0), (22.0,))


def behind(rng: np.random.Generator, t: Array, vigour: float = 1.0) -> Scene:
    """The control: the leader's nose is on its course, and we fly behind it."""
    course, speed = _flown(rng, t, vigour)
    leader = travelling(speed[:, None] * level(course))
    return Scene(leader, course, _behind(rng, t, leader, course + rng.uniform(-0.5, 0.5)), _breeze(rng))


def hover(rng: np.random.Generator, t: Array, vigour: float = 1.0) -> Scene:
    """Both hover, the leader's nose anywhere."""
    leader = _hovering(rng, t, np.zeros(3), vigour)
    place = -rng.uniform(*DISTANCE) * level(np.array(rng.uniform(0.0, TURN))) + _below(rng)
    return Scene(leader, np.full_like(t, rng.uniform(0.0, TURN)), _hovering(rng, t, place), _breeze(rng))


def circling(rng: np.random.Generator, t: Array, vigour: float = 1.0) -> Scene:
    """We circle a leader that hovers, its nose anywhere, at 3 to 7 m/s."""
    leader = _hovering(rng, t, np.zeros(3), vigour)
    distance = rng.uniform(*DISTANCE)
    direction = rng.uniform(0.0, TURN) + _side(rng) * rng.uniform(3.0, 7.0) / distance * t
    place = -distance * level(direction) + _below(rng) + wander(rng, t, (1.0, 1.0, 0.5), (9.0, 6.0))
    return Scene(leader, np.full_like(t, rng.uniform(0.0, TURN)), moving(place), _breeze(rng))


def crossing(rng: np.random.Generator, t: Array, vigour: float = 1.0) -> Scene:
    """The leader crosses our line of sight at 45 to 135 degrees, halfway through the flight; we drift."""
    del vigour  # it flies straight
    sight = rng.uniform(0.0, TURN)
    course = sight + _side(rng) * np.radians(rng.uniform(45.0, 135.0))
    since = (t - 0.5 * t[-1])[:, None]
    velocity = rng.uniform(2.0, 5.0) * level(np.array(course))
    leader = moving(rng.uniform(*DISTANCE) * level(np.array(sight)) + since * velocity)
    drift = rng.uniform(0.0, 2.0) * level(np.array(rng.uniform(0.0, TURN)))
    follower = moving(since * drift + _below(rng) + wander(rng, t, (2.0, 2.0, 0.5), (10.0, 7.0)))
    return Scene(leader, np.full_like(t, course), follower, _breeze(rng))


def sideways(rng: np.random.Generator, t: Array, vigour: float = 1.0) -> Scene:
    """The leader flies with its nose 40 to 140 degrees off its course, and we fly along."""
    course, speed = _flown(rng, t, vigour)
    leader = travelling(speed[:, None] * level(course))
    nose = course + _side(rng) * np.radians(rng.uniform(40.0, 140.0))
    return Scene(leader, nose, _behind(rng, t, leader, course + rng.uniform(-0.6, 0.6)), _breeze(rng))


def _fixed_wing(course: Array, airspeed: float, wind: Array) -> tuple[Array, Array]:
    """Speed over ground and heading, of the shape of `course`, of a fixed wing that keeps its course in a wind."""
    along, across = level(course) @ wind, level(course + TURN / 4) @ wind
    correction = np.arcsin(across / airspeed)
    return along + airspeed * np.cos(correction), course - correction


def crab(rng: np.random.Generator, t: Array, vigour: float = 1.0) -> Scene:
    """A fixed wing in a crosswind, its nose 10 to 28 degrees off its course; it weaves, and we fly along."""
    ahead = rng.uniform(0.0, TURN)
    course = ahead + vigour * waves(rng, t, np.radians(rng.uniform(2.0, 10.0)), (18.0,))
    airspeed = rng.uniform(13.0, 20.0)  # of small fixed wings
    wind = _side(rng) * airspeed * np.sin(np.radians(rng.uniform(11.0, 26.0))) * level(np.array(ahead + TURN / 4))
    speed, nose = _fixed_wing(course, airspeed, wind)
    leader = travelling(speed[:, None] * level(course))
    follower = _behind(rng, t, leader, course + rng.uniform(-0.5, 0.5))
    return Scene(leader, nose, follower, wind, "fixed_wing")


def wandering(rng: np.random.Generator, t: Array, vigour: float = 1.0) -> Scene:
    """Both wander at up to 3 m/s; the leader's nose turns at up to 0.2 rad/s half of the time."""

    def path(place: Array, fast: float = 1.0) -> Motion:
        v = wander(rng, t, (1.0, 1.0, 0.2), (25.0, 14.0))
        r = travelling(v * (fast * rng.uniform(1.0, 3.0) / np.linalg.norm(v, axis=1).max())).r
        return moving(place + r - r.mean(axis=0))

    rates, begin, turns = np.zeros_like(t), 0.0, bool(rng.uniform() < 0.5)
    while begin < t[-1]:
        end = begin + rng.uniform(3.0, 8.0)
        rates[(t >= begin) & (t < end)] = _side(rng) * rng.uniform(0.05, 0.2) if turns else 0.0
        begin, turns = end, not turns
    nose = rng.uniform(0.0, TURN) + np.cumsum(blurred(rates, 0.8)) * DT
    place = -rng.uniform(28.0, 45.0) * level(np.array(rng.uniform(0.0, TURN))) + _below(rng)
    return Scene(path(np.zeros(3), vigour), nose, path(place), _breeze(rng))


def head_on(rng: np.random.Generator, t: Array, vigour: float = 1.0) -> Scene:
    """The leader comes from afar at 8 to 14 m/s, passes us by 6 to 12 m, and flies on; we hover."""
    del vigour  # it flies straight
    sight = rng.uniform(0.0, TURN)
    velocity = -rng.uniform(8.0, 14.0) * level(np.array(sight))
    aside = _side(rng) * rng.uniform(6.0, 12.0) * level(np.array(sight + TURN / 4))
    leader = moving(rng.uniform(90.0, 140.0) * level(np.array(sight)) + aside + t[:, None] * velocity)
    follower = moving(_below(rng) + wander(rng, t, (1.0, 1.0, 0.5), (10.0, 7.0)))
    return Scene(leader, np.full_like(t, sight + TURN / 2), follower, _breeze(rng))


def stop_turn_leave(rng: np.random.Generator, t: Array, vigour: float = 1.0) -> Scene:
    """The leader starts, stops, turns its nose by up to 2 rad, and leaves along it; we follow, a second late."""
    first, speed = rng.uniform(0.0, TURN), rng.uniform(4.0, 10.0)
    ramp = 4.0 / vigour  # s
    times = np.cumsum([rng.uniform(2.0, 5.0), ramp, rng.uniform(8.0, 12.0), ramp, rng.uniform(6.0, 9.0), ramp])
    fast = blurred(np.interp(t, times, [0.0, speed, speed, 0.0, 0.0, speed]), 0.6)
    turning = rng.uniform(2.0, 4.0)  # s
    begin = times[3] + 1.0
    nose = blurred(np.interp(t, [begin, begin + turning], [first, first + rng.uniform(-2.0, 2.0)]), 0.6)
    leader = travelling(fast[:, None] * level(nose))
    late = np.stack([blurred(np.interp(t - 1.0, t, x), 1.5) for x in leader.r.T], axis=-1)
    return Scene(leader, nose, _behind(rng, t, leader._replace(r=late), np.full_like(t, first)), _breeze(rng))


def straight_sideways(rng: np.random.Generator, t: Array, vigour: float = 1.0) -> Scene:
    """The leader flies straight at 4 to 10 m/s, its nose 40 to 140 degrees off its course; we fly along, behind it
    in half of the flights and anywhere around it in the others."""
    course = rng.uniform(0.0, TURN)
    straight = t[:, None] * (rng.uniform(4.0, 10.0) * level(np.array(course)))
    leader = moving(straight + vigour * wander(rng, t, (0.3, 0.3, 0.15), (9.0, 5.0)))
    nose = course + _side(rng) * np.radians(rng.uniform(40.0, 140.0))
    direction = course + rng.uniform(-0.6, 0.6) if rng.uniform() < 0.5 else rng.uniform(0.0, TURN)
    follower = _behind(rng, t, leader, np.full_like(t, direction), (15.0, 32.0))
    return Scene(leader, np.full_like(t, nose), follower, _breeze(rng))


def steep(rng: np.random.Generator, t: Array, vigour: float = 1.0) -> Scene:
    """We see the leader 45 to 65 degrees above or below us: it hovers in half of the flights, and flies on in the
    others."""
    elevation = _side(rng) * np.radians(rng.uniform(45.0, 65.0))
    if rng.uniform() < 0.5:
        leader, nose = _hovering(rng, t, np.zeros(3), vigour), np.full_like(t, rng.uniform(0.0, TURN))
    else:
        course, speed = _flown(rng, t, vigour)
        leader = travelling(speed[:, None] * level(course))
        nose = course + _nose(rng, 0.0)
    up = np.array([0.0, 0.0, -np.sin(elevation)])
    away = rng.uniform(*DISTANCE) * (np.cos(elevation) * level(np.array(rng.uniform(0.0, TURN))) + up)
    follower = moving(leader.r - away + 0.5 * _sway(rng, t))
    return Scene(leader, nose, follower, _breeze(rng), elevation=elevation)


def loiter(rng: np.random.Generator, t: Array, vigour: float = 1.0) -> Scene:
    """A fixed wing loiters around us in a circle of 30 to 60 m, which it keeps against the wind; we hover, up to
    10 m off its centre."""
    del vigour  # it keeps its circle
    radius, side, wind = rng.uniform(30.0, 60.0), _side(rng), _breeze(rng)
    airspeed = np.sqrt(G * radius * np.tan(np.radians(rng.uniform(15.0, 30.0))))  # at these banks
    first = rng.uniform(0.0, TURN)
    around = np.full_like(t, first)
    for _ in range(40):  # the speed depends on the place in the circle: iterated until both agree
        speed, nose = _fixed_wing(around + side * TURN / 4, airspeed, wind)
        around = first + side * DT / radius * np.cumsum(speed)
    leader = moving(radius * level(around))
    off = rng.uniform(0.0, 10.0) * level(np.array(rng.uniform(0.0, TURN)))
    follower = moving(off + 3.0 * _below(rng) + _sway(rng, t))
    return Scene(leader, nose, follower, wind, "fixed_wing")


def _changing(
    rng: np.random.Generator, t: Array, nose: float, before: Array, after: Array, vigour: float
) -> Scene:
    """The leader flies at one velocity (3,) in n for 12 to 22 s, changes to another at 1.5 to 4 m/s^2, and keeps
    that. We are anywhere around it, and follow 1 to 3 s late, with limited acceleration."""
    begin, strength = rng.uniform(12.0, 22.0), vigour * rng.uniform(1.5, 4.0)
    share = blurred(np.clip((t - begin) * strength / np.linalg.norm(after - before), 0.0, 1.0), 0.3)
    path = travelling(before + share[:, None] * (after - before)).r
    leader = moving(path + vigour * wander(rng, t, (0.3, 0.3, 0.15), (9.0, 5.0)))
    ours = following(path, rng.uniform(1.0, 3.0), rng.uniform(2.0, 4.0)) + _sway(rng, t)
    while True:
        slot = -rng.uniform(*DISTANCE) * level(np.array(rng.uniform(0.0, TURN))) + _below(rng)
        if np.linalg.norm(leader.r - ours - slot, axis=1).min() > NEAREST:
            break
    return Scene(leader, np.full_like(t, nose), moving(ours + slot), _breeze(rng), manoeuvre=begin)


def leaves_hover(rng: np.random.Generator, t: Array, vigour: float = 1.0) -> Scene:
    """The leader hovers, then leaves at 5 to 12 m/s."""
    course = rng.uniform(0.0, TURN)
    away = rng.uniform(5.0, 12.0) * level(np.array(course))
    return _changing(rng, t, _nose(rng, course), np.zeros(3), away, vigour)


def stops(rng: np.random.Generator, t: Array, vigour: float = 1.0) -> Scene:
    """The leader flies straight at 4 to 10 m/s, then stops and stands."""
    course = rng.uniform(0.0, TURN)
    before = rng.uniform(4.0, 10.0) * level(np.array(course))
    return _changing(rng, t, _nose(rng, course), before, np.zeros(3), vigour)


def reverses(rng: np.random.Generator, t: Array, vigour: float = 1.0) -> Scene:
    """The leader flies straight at 4 to 10 m/s, then flies back at 2 to 8 m/s, its nose as before."""
    course = rng.uniform(0.0, TURN)
    ahead = level(np.array(course))
    return _changing(
        rng, t, _nose(rng, course), rng.uniform(4.0, 10.0) * ahead, -rng.uniform(2.0, 8.0) * ahead, vigour
    )


def climbs(rng: np.random.Generator, t: Array, vigour: float = 1.0) -> Scene:
    """The leader hovers or flies straight at up to 8 m/s, then climbs or descends at 1 to 3 m/s as well."""
    course = rng.uniform(0.0, TURN)
    before = max(0.0, rng.uniform(-8.0, 8.0)) * level(np.array(course))
    climb = np.array([0.0, 0.0, _side(rng) * rng.uniform(1.0, 3.0)])
    return _changing(rng, t, _nose(rng, course), before, before + climb, vigour)


def cut(rng: np.random.Generator, t: Array, vigour: float = 1.0) -> Scene:
    """Both hover, 8 to 16 m apart, and our camera swings past the leader and back: the image's edge cuts its box
    for part of the time, and the cut box ends up to 8 px inside."""
    scene = hover(rng, t, vigour)
    away = scene.follower.r[0] - scene.leader.r[0]
    near = scene.follower.r + (rng.uniform(8.0, 16.0) / np.linalg.norm(away) - 1.0) * away
    swing = rng.uniform(0.95, 1.15) * np.sin(TURN * (t / rng.uniform(12.0, 24.0) + rng.uniform()))
    camera = {"least_inside": rng.uniform(0.3, 0.6), "edge_gap_px": rng.uniform(0.0, 8.0)}
    return scene._replace(follower=moving(near), aim=swing, camera=camera)


def class_flickers(rng: np.random.Generator, t: Array, vigour: float = 1.0) -> Scene:
    """The leader of `behind` or `hover`, which the detector takes for an airplane for up to 3 s at first, in half
    of the flights, and for 0.05 to 0.4 s every some seconds."""
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
    """Both hover, and another multirotor crosses our line of sight to the leader halfway through the flight, by
    less than 1.5 degrees, at 0.65 to 0.8 or 1.25 to 1.55 of its range. The detector gives no ids; the leader comes
    first in each image, and as the other comes from the image's edge, first of all."""
    scene = hover(rng, t, vigour)
    sight = scene.leader.r[len(t) // 2] - scene.follower.r[len(t) // 2]
    share = rng.uniform(0.65, 0.8) if rng.uniform() < 0.5 else rng.uniform(1.25, 1.55)
    across = _side(rng) * level(np.arctan2(sight[1], sight[0]) + np.array(0.25 * TURN))
    above = np.array([0.0, 0.0, np.radians(rng.uniform(-1.5, 1.5)) * share * np.linalg.norm(sight)])
    since = (t - 0.5 * t[-1])[:, None]
    path = scene.follower.r[len(t) // 2] + share * sight + above + rng.uniform(2.0, 4.0) * since * across
    return scene._replace(other=moving(path), camera={"has_ids": False})


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
