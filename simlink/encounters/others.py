"""Encounters with leaders that others flew: the leader is a recorded flight, and what follows it is drawn, or is
another recorded flight, which sways and leans as it was recorded.

A recorded follower is moved to where the geometry wants it, and its attitude is turned about its own thrust axis
until its camera looks at the leader, as a multirotor may.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np
from msgspec.structs import replace

from onboard.geometry.rotations import matrix_from_quaternion
from simlink.encounters.attitudes import follower_attitude, slewed
from simlink.encounters.curves import Motion, following, level, moving, wander, wobble
from simlink.encounters.encounter import Encounter
from simlink.encounters.families import TURN
from simlink.encounters.recording import LogError
from simlink.encounters.trajectory import Trajectory, blurred, times
from simlink.encounters.truth import EncounterTruth
from simlink.scenarios.camera import Camera
from simlink.scenarios.profiles import GaussMarkov
from simlink.scenarios.scenario import Scenario
from simlink.sensors.arrays import Array
from simlink.world.constants import DT, steps_of
from simlink.world.noise import stream

DISTANCE: Final = (6.0, 35.0)  # m, all orders of magnitude as probable
NEAREST: Final = 3.5  # m: nearer, the follower has another slot
FARTHEST: Final = 60.0  # m: a leader of half a metre is then 5 px wide
IN_VIEW: Final = 0.6  # of the time, at least
ATTEMPTS: Final = 60
SWAY_S: Final = 8.0  # what is slower in a recorded follower's motion is where it flew, and not how
MEAN_SPEED: Final = 0.7  # m/s: a leader that on average is slower has no course
LATE_S: Final = (1.0, 12.0)  # by which a leader's own flight follows it
BESIDE: Final[Array] = np.array([4.0, 4.0, 2.0])  # m, at most, from where it flew
AIM: Final = GaussMarkov(sigma=2.0, time=6.0)  # degrees, of the camera off the leader


class Slot(NamedTuple):
    """Where a follower flies (N, 3), m in n, about which it may sway, with its attitude as Euler angles (N, 3) if
    it is a flight as recorded."""

    place: Array
    q_nb: Array | None = None


def _course(rng: np.random.Generator, leader: Trajectory) -> float:
    """The leader's course on average, rad; anywhere for one that has none."""
    v = leader.motion.v.mean(axis=0)
    return float(np.arctan2(v[1], v[0])) if np.hypot(v[0], v[1]) > MEAN_SPEED else float(rng.uniform(0.0, TURN))


def _side(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _away(rng: np.random.Generator, distance: float, direction: float, elevation: float = 0.0) -> Array:
    """From the leader to a follower that has it in this direction and elevation, rad."""
    raised = elevation + rng.uniform(-0.12, 0.12)
    away: Array = -distance * (np.cos(raised) * level(np.array(direction)) + np.array([0.0, 0.0, -np.sin(raised)]))
    return away


def _along(rng: np.random.Generator, leader: Trajectory) -> Array:
    """The path of one that flies as the leader does, some seconds late and with limited acceleration."""
    most = max(5.0, 1.5 * float(np.sqrt(np.mean(np.sum(leader.motion.a**2, axis=1)))))
    return following(leader.motion.r, rng.uniform(0.5, 2.0), rng.uniform(2.0, most))


def behind(rng: np.random.Generator, leader: Trajectory, distance: float) -> Slot:
    """From behind its mean course."""
    return Slot(_along(rng, leader) + _away(rng, distance, _course(rng, leader) + rng.uniform(-0.4, 0.4)))


def abreast(rng: np.random.Generator, leader: Trajectory, distance: float) -> Slot:
    """Beside its mean course."""
    direction = _course(rng, leader) + _side(rng) * TURN / 4 + rng.uniform(-0.3, 0.3)
    return Slot(_along(rng, leader) + _away(rng, distance, direction))


def sideways(rng: np.random.Generator, leader: Trajectory, distance: float) -> Slot:
    """From the side of its nose, wherever it flies."""
    ahead = matrix_from_quaternion(leader.q_nb)[:, :, 0].mean(axis=0)
    nose = float(np.arctan2(ahead[1], ahead[0]))
    return Slot(_along(rng, leader) + _away(rng, distance, nose + _side(rng) * rng.uniform(0.7, 2.4)))


def orbit(rng: np.random.Generator, leader: Trajectory, distance: float) -> Slot:
    """We circle it at 2 to 5 m/s while it flies."""
    t = times(len(leader.q_nb))
    direction = rng.uniform(0.0, TURN) + _side(rng) * rng.uniform(2.0, 5.0) / distance * t
    return Slot(_along(rng, leader) - distance * level(direction) + np.array([0.0, 0.0, rng.uniform(-2.0, 2.0)]))


def steep(rng: np.random.Generator, leader: Trajectory, distance: float) -> Slot:
    """From 45 to 65 degrees above or below."""
    elevation = _side(rng) * np.radians(rng.uniform(45.0, 65.0))
    return Slot(_along(rng, leader) + _away(rng, distance, rng.uniform(0.0, TURN), elevation))


def hover(rng: np.random.Generator, leader: Trajectory, distance: float) -> Slot:
    """We hover, as far from where it is on average."""
    middle = leader.motion.r.mean(axis=0)
    return Slot(np.broadcast_to(middle + _away(rng, distance, rng.uniform(0.0, TURN)), leader.motion.r.shape))


def tour(rng: np.random.Generator, leader: Trajectory, distance: float) -> Slot:
    """We hover outside of where it flies, and turn after it."""
    middle = leader.motion.r.mean(axis=0)
    reach = float(np.linalg.norm((leader.motion.r - middle)[:, :2], axis=1).max())
    away = _away(rng, reach + 0.5 * distance, rng.uniform(0.0, TURN))
    return Slot(np.broadcast_to(middle + away, leader.motion.r.shape))


def survey(rng: np.random.Generator, leader: Trajectory, distance: float) -> Slot:
    """We fly straight with its mean velocity."""
    t = times(len(leader.q_nb))
    v = leader.motion.v.mean(axis=0)
    middle = (leader.motion.r - t[:, None] * v).mean(axis=0)
    return Slot(middle + t[:, None] * v + _away(rng, distance, rng.uniform(0.0, TURN)))


GEOMETRIES: Final[Mapping[str, Callable[[np.random.Generator, Trajectory, float], Slot]]] = {
    "behind": behind,
    "abreast": abreast,
    "sideways": sideways,
    "orbit": orbit,
    "steep": steep,
    "hover": hover,
    "tour": tour,
    "survey": survey,
}
TRAIL: Final = "trail"  # the leader's own flight, some seconds earlier, follows it
KNOWN: Final = (*GEOMETRIES, TRAIL)


def flown_by_others(
    scenario: Scenario,
    seed: int,
    leader: Trajectory,
    geometry: str,
    seconds: float,
    *,
    follower: Trajectory | None = None,
    distance: tuple[float, float] = DISTANCE,
) -> Encounter:
    """An encounter with a part of a recorded flight, which `seed` draws with all else. Camera, autopilot and
    errors are the scenario's; the camera's mount looks up or down as the geometry and the follower's lean need.

    Raises ValueError for a geometry that is none of KNOWN, and LogError where the flight is too short, or none of
    the slots that were drawn keeps its distance and has the leader in view.
    """
    if geometry not in KNOWN:
        raise ValueError(f"geometry: no {geometry!r}; known: {', '.join(KNOWN)}")
    rng, count = stream(seed, f"encounters.others.{geometry}"), steps_of(seconds) + 1
    before = steps_of(LATE_S[1]) if geometry == TRAIL else 0
    for _ in range(ATTEMPTS):
        long = _part(rng, leader, count + before)
        far = float(np.exp(rng.uniform(*np.log(distance))))
        late = _lateness(rng, long, far, before, count) if geometry == TRAIL else 0
        flown = long.part(before, count)
        if geometry == TRAIL:
            earlier = long.part(before - late, count)
            apart = long.motion.r[before - late] - long.motion.r[before]
            slot = Slot(earlier.motion.r + apart + BESIDE * rng.uniform(-1.0, 1.0, 3), earlier.q_nb)
        else:
            slot = GEOMETRIES[geometry](rng, flown, far)
        if follower is not None and slot.q_nb is None:
            other = _part(rng, follower, count)
            sway = other.motion.r - blurred(other.motion.r, SWAY_S)
            slot = Slot(slot.place + sway, other.q_nb)
        elif slot.q_nb is None:
            t = times(count)
            amplitude = 10.0 ** rng.uniform(-1.0, 0.0)
            slot = Slot(slot.place + wander(rng, t, (amplitude, amplitude, 0.3 * amplitude), (11.0, 7.0, 5.0)))
        found = _encounter(rng, scenario, seed, flown, geometry, slot)
        if found is not None:
            return found
    raise LogError(f"{leader.name}: no place was found from which a camera sees it in the geometry {geometry!r}")


def longest_of(geometry: str, flights: Sequence[Trajectory]) -> float:
    """How long an encounter of these flights may last, s: leader, and follower if it is recorded."""
    return min(flights[0].seconds - (LATE_S[1] if geometry == TRAIL else 0.0), *(f.seconds for f in flights))


def _part(rng: np.random.Generator, flight: Trajectory, count: int) -> Trajectory:
    """So many steps of a flight from anywhere. Raises LogError."""
    spare = len(flight.q_nb) - count
    if spare < 0:
        raise LogError(f"{flight.name}: {flight.seconds:.0f} s of flight, and {DT * (count - 1):.0f} s are wanted")
    return flight.part(int(rng.integers(spare + 1)), count)


def _lateness(rng: np.random.Generator, long: Trajectory, far: float, before: int, count: int) -> int:
    """By how many steps the flight itself follows at about this distance."""
    r = long.motion.r
    choices = range(steps_of(LATE_S[0]), before + 1, steps_of(0.25))
    now = r[before : before + count]
    apart = [np.median(np.linalg.norm(now - r[before - n :][:count], axis=1)) for n in choices]
    near = np.abs(np.array(apart) - far)
    return choices[int(rng.choice(np.argsort(near)[:3]))]


def _encounter(
    rng: np.random.Generator, scenario: Scenario, seed: int, leader: Trajectory, geometry: str, slot: Slot
) -> Encounter | None:
    """The encounter with the follower in its slot; None where it comes too near or loses sight."""
    ours = moving(slot.place) if slot.q_nb is None else _smooth(slot.place)
    r_FL_n = leader.motion.r - ours.r
    apart = np.linalg.norm(r_FL_n, axis=1)
    if apart.min() < NEAREST or apart.max() > FARTHEST:
        return None
    camera = replace(scenario.camera, mount_rpy_deg=(0.0, 0.0, 0.0))
    sight = np.unwrap(np.arctan2(r_FL_n[:, 1], r_FL_n[:, 0]))
    t = times(len(sight))
    if slot.q_nb is None:
        euler = follower_attitude(rng, seed, t, ours, sight, camera.mount_rpy_deg)
        R_nb = matrix_from_quaternion(quaternions(euler))
    else:
        aim = wobble(seed, "encounters.aim", AIM, len(t), np.pi / 180)
        R_nb = _turned(matrix_from_quaternion(slot.q_nb), slewed(sight + aim))
        euler = euler_angles(R_nb)
    r_b = np.einsum("nij,ni->nj", R_nb, r_FL_n)
    up = np.degrees(np.arctan2(-r_b[:, 2], r_b[:, 0]))
    camera = replace(camera, mount_rpy_deg=(0.0, float(round(np.median(up))), 0.0))
    if _share_in_view(camera, r_b) < IN_VIEW:
        return None
    truth = EncounterTruth(
        t=t,
        leader=leader.motion,
        euler_L=euler_angles(matrix_from_quaternion(leader.q_nb)),
        follower=ours,
        euler_F=euler,
    )
    family = f"{leader.name}, {geometry}"
    scenario = replace(scenario, camera=camera)
    return Encounter(family, seed, leader.leader_class, 0.0, scenario, truth, size_prior=scenario.leader.size)


def _smooth(place: Array) -> Motion:
    """The motion of one at these positions (N, 3), where recordings have corners of their own."""
    return moving(blurred(place, 0.06))


def _turned(R_nb: Array, yaw: Array) -> Array:
    """Attitudes (N, 3, 3) turned about their own z axes, until their noses point to `yaw` (N,), rad."""
    down = R_nb[:, :, 2]
    ahead = level(yaw)
    # the part across `down` of a vector that is across it and in the upright plane of `yaw`
    ahead = ahead - (np.einsum("ni,ni->n", ahead, down) / down[:, 2])[:, None] * np.array([0.0, 0.0, 1.0])
    ahead /= np.linalg.norm(ahead, axis=1)[:, None]
    return np.stack([ahead, np.cross(down, ahead), down], axis=-1)


def _share_in_view(camera: Camera, r_b: Array) -> float:
    """How often a leader at r_b (N, 3) is inside the image of a camera that is tilted alone."""
    up = np.radians(camera.mount_rpy_deg[1])
    ahead = np.cos(up) * r_b[:, 0] - np.sin(up) * r_b[:, 2]
    below = np.sin(up) * r_b[:, 0] + np.cos(up) * r_b[:, 2]
    inside = (ahead > 0.0) & (np.abs(r_b[:, 1]) * camera.f_px < 0.48 * camera.width_px * ahead)
    return float(np.mean(inside & (np.abs(below) * camera.f_px < 0.48 * camera.height_px * ahead)))


def euler_angles(R_nb: Array) -> Array:
    """Roll, pitch and yaw (N, 3), rad, of R_nb (N, 3, 3)."""
    roll = np.arctan2(R_nb[:, 2, 1], R_nb[:, 2, 2])
    pitch = np.arcsin(np.clip(-R_nb[:, 2, 0], -1.0, 1.0))
    return np.column_stack([roll, pitch, np.arctan2(R_nb[:, 1, 0], R_nb[:, 0, 0])])


def quaternions(euler: Array) -> Array:
    """q_nb (N, 4) of Euler angles (N, 3), rad."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(0.5 * euler).T, np.sin(0.5 * euler).T
    return np.column_stack(
        [
            cy * cp * cr + sy * sp * sr,
            cy * cp * sr - sy * sp * cr,
            cy * sp * cr + sy * cp * sr,
            sy * cp * cr - cy * sp * sr,
        ]
    )
