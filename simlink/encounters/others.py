"""Encounters with a recorded leader, and a drawn or recorded follower.

A recorded follower is moved to the slot of the geometry. Its attitude is rotated about its own thrust axis until
its camera points at the leader, as a multirotor may.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np
from msgspec.structs import replace

from onboard.geometry.rotations import matrix_from_quaternion
from simlink.encounters.attitudes import follower_attitude, limit_slew
from simlink.encounters.curves import Motion, follow_path, heading_vector, motion_from_positions, wander, wobble
from simlink.encounters.encounter import Encounter
from simlink.encounters.recording import LogError
from simlink.encounters.trajectory import Trajectory, smooth_columns, time_grid
from simlink.encounters.truth import EncounterTruth
from simlink.scenarios.camera import Camera
from simlink.scenarios.profiles import GaussMarkov
from simlink.scenarios.scenario import Scenario
from simlink.sensors.arrays import Array
from simlink.world.constants import DT, step_count
from simlink.world.noise import stream

DISTANCE_RANGE_M: Final = (6.0, 35.0)  # log-uniform
MIN_DISTANCE: Final = 3.5  # m; a slot that leads nearer is drawn again
MAX_DISTANCE: Final = 60.0  # m, at which a leader of half a metre is 5 px wide
MIN_VIEW_SHARE: Final = 0.6  # of the time
MAX_ATTEMPTS: Final = 60
SWAY_WINDOW_S: Final = 8.0  # slower motion of a recorded follower is its route, not its sway
MIN_MEAN_SPEED: Final = 0.7  # m/s; a leader that is slower on average has no course
DELAY_RANGE_S: Final = (1.0, 12.0)  # of a leader's own flight that follows it
MAX_TRAIL_OFFSET: Final[Array] = np.array([4.0, 4.0, 2.0])  # m, from the recorded path
AIM_ERROR: Final = GaussMarkov(sigma=2.0, time=6.0)  # degrees, of the camera's direction


class Slot(NamedTuple):
    """The positions (N, 3) of a follower in n, m, and its attitude (N, 4) if it is recorded."""

    place: Array
    q_nb: Array | None = None  # None: the attitude is drawn, and the position may sway


def _course(rng: np.random.Generator, leader: Trajectory) -> float:
    """Return the leader's mean course (rad), or a random one if it has none."""
    v = leader.motion.v.mean(axis=0)
    return (
        float(np.arctan2(v[1], v[0]))
        if np.hypot(v[0], v[1]) > MIN_MEAN_SPEED
        else float(rng.uniform(0.0, math.tau))
    )


def _draw_side(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _slot_offset(rng: np.random.Generator, distance: float, direction: float, elevation: float = 0.0) -> Array:
    """Return the vector from the leader to a follower that sees it at these angles (rad)."""
    raised = elevation + rng.uniform(-0.12, 0.12)
    away: Array = -distance * (
        np.cos(raised) * heading_vector(np.array(direction)) + np.array([0.0, 0.0, -np.sin(raised)])
    )
    return away


def _delayed_path(rng: np.random.Generator, leader: Trajectory) -> Array:
    """Return the path of a follower that repeats the leader's, late and smoothly."""
    most = max(5.0, 1.5 * float(np.sqrt(np.mean(np.sum(leader.motion.a**2, axis=1)))))
    return follow_path(leader.motion.r, rng.uniform(0.5, 2.0), rng.uniform(2.0, most))


def behind(rng: np.random.Generator, leader: Trajectory, distance: float) -> Slot:
    """We follow behind its mean course."""
    return Slot(
        _delayed_path(rng, leader) + _slot_offset(rng, distance, _course(rng, leader) + rng.uniform(-0.4, 0.4))
    )


def abreast(rng: np.random.Generator, leader: Trajectory, distance: float) -> Slot:
    """We fly to the side of its mean course."""
    direction = _course(rng, leader) + _draw_side(rng) * math.tau / 4 + rng.uniform(-0.3, 0.3)
    return Slot(_delayed_path(rng, leader) + _slot_offset(rng, distance, direction))


def sideways(rng: np.random.Generator, leader: Trajectory, distance: float) -> Slot:
    """We see it from the side of its nose, whatever its course."""
    ahead = matrix_from_quaternion(leader.q_nb)[:, :, 0].mean(axis=0)
    nose = float(np.arctan2(ahead[1], ahead[0]))
    return Slot(
        _delayed_path(rng, leader) + _slot_offset(rng, distance, nose + _draw_side(rng) * rng.uniform(0.7, 2.4))
    )


def orbit(rng: np.random.Generator, leader: Trajectory, distance: float) -> Slot:
    """We circle it at 2 to 5 m/s while it flies."""
    t = time_grid(len(leader.q_nb))
    direction = rng.uniform(0.0, math.tau) + _draw_side(rng) * rng.uniform(2.0, 5.0) / distance * t
    return Slot(
        _delayed_path(rng, leader)
        - distance * heading_vector(direction)
        + np.array([0.0, 0.0, rng.uniform(-2.0, 2.0)])
    )


def steep(rng: np.random.Generator, leader: Trajectory, distance: float) -> Slot:
    """We see it from 45 to 65 degrees above or below."""
    elevation = _draw_side(rng) * np.radians(rng.uniform(45.0, 65.0))
    return Slot(_delayed_path(rng, leader) + _slot_offset(rng, distance, rng.uniform(0.0, math.tau), elevation))


def hover(rng: np.random.Generator, leader: Trajectory, distance: float) -> Slot:
    """We hover at a distance from its mean position."""
    middle = leader.motion.r.mean(axis=0)
    return Slot(
        np.broadcast_to(middle + _slot_offset(rng, distance, rng.uniform(0.0, math.tau)), leader.motion.r.shape)
    )


def tour(rng: np.random.Generator, leader: Trajectory, distance: float) -> Slot:
    """We hover outside its area and turn after it."""
    middle = leader.motion.r.mean(axis=0)
    reach = float(np.linalg.norm((leader.motion.r - middle)[:, :2], axis=1).max())
    away = _slot_offset(rng, reach + 0.5 * distance, rng.uniform(0.0, math.tau))
    return Slot(np.broadcast_to(middle + away, leader.motion.r.shape))


def survey(rng: np.random.Generator, leader: Trajectory, distance: float) -> Slot:
    """We fly straight with its mean velocity."""
    t = time_grid(len(leader.q_nb))
    v = leader.motion.v.mean(axis=0)
    middle = (leader.motion.r - t[:, None] * v).mean(axis=0)
    return Slot(middle + t[:, None] * v + _slot_offset(rng, distance, rng.uniform(0.0, math.tau)))


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
TRAIL: Final = "trail"  # the leader's own flight follows it, some seconds late
GEOMETRY_NAMES: Final = (*GEOMETRIES, TRAIL)


def recorded_encounter(
    scenario: Scenario,
    seed: int,
    leader: Trajectory,
    geometry: str,
    seconds: float,
    *,
    follower: Trajectory | None = None,
    distance: tuple[float, float] = DISTANCE_RANGE_M,
) -> Encounter:
    """Return an encounter with a part of a recorded flight; `seed` draws everything.

    Camera, autopilot and errors are those of the scenario; the camera's mount is tilted as the geometry and the
    follower's attitude require.

    Raises ValueError for an unknown geometry, and LogError if the flight is too short or if no drawn slot keeps
    its distance with the leader in view.
    """
    if geometry not in GEOMETRY_NAMES:
        raise ValueError(f"unknown geometry {geometry!r}; choose one of {', '.join(GEOMETRY_NAMES)}")
    rng, count = stream(seed, f"encounters.others.{geometry}"), step_count(seconds) + 1
    before = step_count(DELAY_RANGE_S[1]) if geometry == TRAIL else 0
    for _ in range(MAX_ATTEMPTS):
        long = _random_part(rng, leader, count + before)
        far = float(np.exp(rng.uniform(*np.log(distance))))
        late = _trail_delay(rng, long, far, before, count) if geometry == TRAIL else 0
        flown = long.part(before, count)
        if geometry == TRAIL:
            earlier = long.part(before - late, count)
            apart = long.motion.r[before - late] - long.motion.r[before]
            slot = Slot(earlier.motion.r + apart + MAX_TRAIL_OFFSET * rng.uniform(-1.0, 1.0, 3), earlier.q_nb)
        else:
            slot = GEOMETRIES[geometry](rng, flown, far)
        if follower is not None and slot.q_nb is None:
            other = _random_part(rng, follower, count)
            sway = other.motion.r - smooth_columns(other.motion.r, SWAY_WINDOW_S)
            slot = Slot(slot.place + sway, other.q_nb)
        elif slot.q_nb is None:
            t = time_grid(count)
            amplitude = 10.0 ** rng.uniform(-1.0, 0.0)
            slot = Slot(slot.place + wander(rng, t, (amplitude, amplitude, 0.3 * amplitude), (11.0, 7.0, 5.0)))
        found = _encounter_in_slot(rng, scenario, seed, flown, geometry, slot)
        if found is not None:
            return found
    raise LogError(
        f"{leader.name}: no slot of the geometry {geometry!r} keeps it in view; try another geometry or seed"
    )


def max_duration(geometry: str, flights: Sequence[Trajectory]) -> float:
    """Return the longest possible duration (s) of an encounter with these flights.

    They are the leader and, if it is recorded, the follower.
    """
    return min(
        flights[0].seconds - (DELAY_RANGE_S[1] if geometry == TRAIL else 0.0), *(f.seconds for f in flights)
    )


def _random_part(rng: np.random.Generator, flight: Trajectory, count: int) -> Trajectory:
    """Return `count` steps of a flight from a random position. Raises LogError."""
    spare = len(flight.q_nb) - count
    if spare < 0:
        raise LogError(
            f"{flight.name}: the flight lasts {flight.seconds:.0f} s, shorter than {DT * (count - 1):.0f} s"
        )
    return flight.part(int(rng.integers(spare + 1)), count)


def _trail_delay(rng: np.random.Generator, long: Trajectory, far: float, before: int, count: int) -> int:
    """Return the delay (steps) at which a flight follows itself at about this distance."""
    r = long.motion.r
    choices = range(step_count(DELAY_RANGE_S[0]), before + 1, step_count(0.25))
    now = r[before : before + count]
    apart = [np.median(np.linalg.norm(now - r[before - n :][:count], axis=1)) for n in choices]
    near = np.abs(np.array(apart) - far)
    return choices[int(rng.choice(np.argsort(near)[:3]))]


def _encounter_in_slot(
    rng: np.random.Generator, scenario: Scenario, seed: int, leader: Trajectory, geometry: str, slot: Slot
) -> Encounter | None:
    """Return the encounter with the follower in its slot, or None if that is not usable.

    It must neither come too near, nor be too far, nor lose sight of the leader.
    """
    ours = motion_from_positions(slot.place) if slot.q_nb is None else _smooth(slot.place)
    r_FL_n = leader.motion.r - ours.r
    apart = np.linalg.norm(r_FL_n, axis=1)
    if apart.min() < MIN_DISTANCE or apart.max() > MAX_DISTANCE:
        return None
    camera = replace(scenario.camera, mount_rpy_deg=(0.0, 0.0, 0.0))
    sight = np.unwrap(np.arctan2(r_FL_n[:, 1], r_FL_n[:, 0]))
    t = time_grid(len(sight))
    if slot.q_nb is None:
        euler = follower_attitude(rng, seed, t, ours, sight, camera.mount_rpy_deg)
        R_nb = matrix_from_quaternion(quaternions(euler))
    else:
        aim = wobble(seed, "encounters.aim", AIM_ERROR, len(t), np.pi / 180)
        R_nb = _yaw_to(matrix_from_quaternion(slot.q_nb), limit_slew(sight + aim))
        euler = euler_angles(R_nb)
    r_b = np.einsum("nij,ni->nj", R_nb, r_FL_n)
    up = np.degrees(np.arctan2(-r_b[:, 2], r_b[:, 0]))
    camera = replace(camera, mount_rpy_deg=(0.0, float(round(np.median(up))), 0.0))
    if _share_in_view(camera, r_b) < MIN_VIEW_SHARE:
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
    """Return the smoothed motion through these positions (N, 3)."""
    return motion_from_positions(smooth_columns(place, 0.06))


def _yaw_to(R_nb: Array, yaw: Array) -> Array:
    """Rotate attitudes (N, 3, 3) about their own z axes to a `yaw` (N,), rad."""
    down = R_nb[:, :, 2]
    ahead = heading_vector(yaw)
    # the part across `down` of a vector that is across it and in the upright plane of `yaw`
    ahead = ahead - (np.einsum("ni,ni->n", ahead, down) / down[:, 2])[:, None] * np.array([0.0, 0.0, 1.0])
    ahead /= np.linalg.norm(ahead, axis=1)[:, None]
    return np.stack([ahead, np.cross(down, ahead), down], axis=-1)


def _share_in_view(camera: Camera, r_b: Array) -> float:
    """Return the share of positions r_b (N, 3) inside the image of a pitched camera."""
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
