"""The families of encounters: how the two aircraft move, and where the leader's nose points."""

from collections.abc import Callable, Mapping
from typing import Final, Literal, NamedTuple

import numpy as np

from simlink.encounters.curves import Motion, blurred, level, moving, travelling, wander, waves
from simlink.sensors.arrays import Array

LeaderClass = Literal["fixed_wing", "multirotor"]
DISTANCE: Final = (18.0, 40.0)  # m, the usual
HEIGHT: Final = 3.0  # m, at most, that the follower is above or below
TURN: Final = 2.0 * np.pi


class Scene(NamedTuple):
    """Both motions, the leader's heading `nose` (N,) in rad, without its wobble, and the wind (3,) in n, m/s."""

    leader: Motion
    nose: Array
    follower: Motion
    wind: Array
    leader_class: LeaderClass = "multirotor"


def _side(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _breeze(rng: np.random.Generator) -> Array:
    return float(rng.uniform(0.0, 4.0)) * level(np.array(rng.uniform(0.0, TURN)))


def _below(rng: np.random.Generator) -> Array:
    return np.array([0.0, 0.0, rng.uniform(-HEIGHT, HEIGHT)])


def _hovering(rng: np.random.Generator, t: Array, place: Array, vigour: float = 1.0) -> Motion:
    return moving(place + vigour * wander(rng, t, (0.3, 0.3, 0.15), (9.0, 5.0)))


def _behind(rng: np.random.Generator, t: Array, leader: Motion, direction: Array) -> Motion:
    """A follower that has the leader in this direction (N,), and wanders in its slot."""
    amplitude = rng.uniform(1.5, 3.5)
    slot = -rng.uniform(*DISTANCE) * level(direction) + _below(rng)
    return moving(leader.r + slot + wander(rng, t, (amplitude, amplitude, 0.3 * amplitude), (11.0, 7.0, 5.0)))


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


def crab(rng: np.random.Generator, t: Array, vigour: float = 1.0) -> Scene:
    """A fixed wing in a crosswind, its nose 10 to 28 degrees off its course; it weaves, and we fly along."""
    ahead = rng.uniform(0.0, TURN)
    course = ahead + vigour * waves(rng, t, np.radians(rng.uniform(2.0, 10.0)), (18.0,))
    airspeed = rng.uniform(13.0, 20.0)  # of small fixed wings
    wind = _side(rng) * airspeed * np.sin(np.radians(rng.uniform(11.0, 26.0))) * level(np.array(ahead + TURN / 4))
    along, across = level(course) @ wind, level(course + TURN / 4) @ wind
    correction = np.arcsin(across / airspeed)
    leader = travelling((along + airspeed * np.cos(correction))[:, None] * level(course))
    follower = _behind(rng, t, leader, course + rng.uniform(-0.5, 0.5))
    return Scene(leader, course - correction, follower, wind, "fixed_wing")


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
    nose = rng.uniform(0.0, TURN) + np.cumsum(blurred(rates, 0.8)) * (t[1] - t[0])
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
}
