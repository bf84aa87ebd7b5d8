"""Many flights of one scenario as arrays: the results of `flight.fly` for many seeds, but faster.

Profiles, slot, attitudes, camera and random streams are the same. Two things differ, and a test compares both with
`fly`: the leader's path is integrated once and rotated for each initial course; and the follower is exactly on its
slot, where `fly` integrates the slot's acceleration (and stays within a millimetre of the slot).
"""

import math
from collections.abc import Iterator, Sequence
from itertools import islice
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from onboard.geometry.rotations import quaternion_from_euler
from simlink.scenarios.profiles import GaussMarkov
from simlink.scenarios.scenario import Scenario
from simlink.scenarios.vehicle import Nav
from simlink.sensors.arrays import Array, Flags
from simlink.sensors.camera import (
    blob,
    in_camera,
    is_exposure,
    is_inside,
    leader_points_n,
    mount_quaternion,
    registrations,
)
from simlink.world import attitude
from simlink.world.constants import DT, GRAVITY, STEPS_PER_SECOND, step_count
from simlink.world.motion import Derivative, Kinematics, advance, leader_motion, pulses, slot, slot_in_n
from simlink.world.noise import gauss_markov, stream
from simlink.world.truth import coordinated_angles, hovering_angles, true_size
from studies.relative_motion.flight import NAV_RATE, Flight, TruthArrays

Components = tuple[Array, ...]  # a vector or quaternion as arrays of its components, each (B, N)
NAV_STEPS = STEPS_PER_SECOND // NAV_RATE  # world steps from one navigation sample to the next


class Flights(NamedTuple):
    """The same as `flight.Flight`, with a leading axis B of seeds (in `nav_truth` too).

    `image_at` (M,) is the index of the navigation sample at which each image was exposed. `in_view` (B, M) tells
    whether all three points were in the image, registered or not.
    """

    seeds: tuple[int, ...]
    size: Array  # (B,)
    nav_t: Array  # (N,)
    nav_v_F_n: Array  # (B, N, 3)
    nav_a_F_n: Array  # (B, N, 3)
    nav_q_nb: Array  # (B, N, 4)
    nav_truth: TruthArrays
    image_t: Array  # (M,)
    image_t_delivered: Array  # (M,)
    image_points: Array  # (B, M, 3, 2)
    image_at: npt.NDArray[np.intp]  # (M,)
    in_view: Flags  # (B, M)

    def one(self, b: int) -> Flight:
        """The flight of `seeds[b]`."""
        truth = TruthArrays(*(rows[b] for rows in self.nav_truth))
        return Flight(
            size=float(self.size[b]),
            nav_t=self.nav_t,
            nav_v_F_n=self.nav_v_F_n[b],
            nav_a_F_n=self.nav_a_F_n[b],
            nav_q_nb=self.nav_q_nb[b],
            nav_truth=truth,
            image_t=self.image_t,
            image_t_delivered=self.image_t_delivered,
            image_points=self.image_points[b],
            image_truth=TruthArrays(*(rows[self.image_at] for rows in truth)),
        )


def fly_many(
    scenario: Scenario,
    seeds: Sequence[int],
    courses_deg: Sequence[float] | None = None,
    duration: float | None = None,
) -> Flights:
    """Return the flights of `seeds` over `duration` s, each with its own initial course.

    A `duration` of None is the scenario's. Raises ValueError for features that only `fly` has: quadrotors, white
    attitude noise, outliers, and images that are exposed between navigation samples.
    """
    _check(scenario)
    steps = step_count(scenario.duration if duration is None else duration)
    nav = np.arange(0, steps + 1, NAV_STEPS)
    exposed = np.array([k for k in range(steps + 1) if is_exposure(k, scenario.camera.rate)])
    if np.any(exposed % NAV_STEPS):
        raise ValueError(f"images at {scenario.camera.rate:g} Hz are exposed between navigation samples")
    courses = np.full(len(seeds), scenario.leader.course_deg) if courses_deg is None else np.array(courses_deg)
    truth = _truth(scenario, seeds, np.radians(courses), nav / STEPS_PER_SECOND)
    size = np.array([true_size(scenario, seed) for seed in seeds])
    image_at = exposed // NAV_STEPS
    points, in_view = _images(scenario, seeds, size, TruthArrays(*(rows[:, image_at] for rows in truth)), exposed)
    image_t = exposed / STEPS_PER_SECOND
    return Flights(
        seeds=tuple(seeds),
        size=size,
        nav_t=nav / STEPS_PER_SECOND,
        nav_v_F_n=truth.v_F_n + _errors(seeds, "nav.velocity", scenario.nav.velocity, nav),
        nav_a_F_n=truth.a_F_n + _acceleration_errors(seeds, scenario.nav, len(nav)),
        nav_q_nb=_tilted(truth.q_nF, _errors(seeds, "nav.attitude", scenario.nav.attitude_deg, nav)),
        nav_truth=truth,
        image_t=image_t,
        image_t_delivered=image_t + scenario.camera.latency,
        image_points=points,
        image_at=image_at,
        in_view=in_view,
    )


def _check(s: Scenario) -> None:
    if s.quadrotor is not None or any(s.nav.attitude_white) or s.outliers.probability > 0.0 or s.camera.gimbal:
        raise ValueError("fly_many supports no quadrotor, gimbal, white attitude noise or outliers: use fly")
    if s.camera.distortion or s.camera.noise_time:
        raise ValueError("fly_many supports no distorted lens and no correlated noise of images: use fly")


# ----------------------------------------------------------------------------------------------- truth


def _truth(scenario: Scenario, seeds: Sequence[int], courses: Array, t: Array) -> TruthArrays:
    path = _leader_path(scenario, len(t))
    course0, climb = path[:, 0] - path[0, 0], path[:, 1]
    course = courses[:, None] + course0
    m = leader_motion(scenario, np)(t, course, climb)
    r_L = _rotated(path[:, 2:] - path[0, 2:], courses[:, None] - path[0, 0])
    r_L = (r_L[0], r_L[1], r_L[2] - scenario.leader.height)
    phases = 2 * np.pi * np.array([stream(seed, "follower.wander").random(3) for seed in seeds])
    px, py, pz = phases.T[:, :, None]
    follower = slot_in_n(course, m, r_L, slot(scenario.follower, (px, py, pz), scenario.repeat, np)(t), np)
    if scenario.follower.attitude == "hover":
        angles = hovering_angles(follower.a_n, course, np)
    else:
        angles = coordinated_angles(follower.v_n, follower.a_n, np)
    wobble, yaw = scenario.leader, pulses(scenario.leader.yaw_pulses_deg, scenario.repeat, np)(t)[0]
    bank = _wobble(seeds, "leader.bank", wobble.bank_wobble_deg, len(t))
    heading = _wobble(seeds, "leader.heading", wobble.heading_wobble_deg, len(t)) + np.radians(yaw)
    shape = course.shape
    # the function takes arrays of angles too
    q_nL = quaternion_from_euler(np.arctan(m.a_lat / GRAVITY) + bank, climb + 0.0 * bank, course + heading)  # type: ignore[arg-type]
    return TruthArrays(
        r_FL_n=_stack(r_L, shape) - _stack(follower.r_n, shape),
        v_FL_n=_stack(m.v_n, shape) - _stack(follower.v_n, shape),
        a_lat=np.broadcast_to(m.a_lat, shape),
        a_long=np.broadcast_to(m.a_long, shape),
        r_OF_n=_stack(follower.r_n, shape),
        v_F_n=_stack(follower.v_n, shape),
        a_F_n=_stack(follower.a_n, shape),
        q_nF=np.moveaxis(quaternion_from_euler(*angles), 0, -1),
        q_nL=np.moveaxis(q_nL, 0, -1),
    )


def _leader_path(scenario: Scenario, samples: int) -> Array:
    """Return course, climb angle and position of the leader (N, 5), integrated as in `truth`."""
    motion = leader_motion(scenario)

    def derivative(t: float, y: Kinematics) -> Derivative:
        m = motion(t, y[0], y[1])
        return Derivative((m.course_rate, m.climb_rate, *m.v_n), m.v_n, m.a_n, (0.0, 0.0, 0.0), m.a_lat, m.a_long)

    y: Kinematics = (
        math.radians(scenario.leader.course_deg),
        math.radians(scenario.leader.climb_deg),
        0.0,
        0.0,
        0.0,
    )
    rows = [y]
    for step in range(NAV_STEPS * (samples - 1)):
        t = step / STEPS_PER_SECOND
        y = advance(derivative, t, y, derivative(t, y), DT)
        if (step + 1) % NAV_STEPS == 0:
            rows.append(y)
    return np.array(rows)


def _rotated(r: Array, by: Array) -> tuple[Array, Array, Array]:
    """Components of positions r (N, 3), rotated about the vertical by angles (B, 1), rad."""
    c, s = np.cos(by), np.sin(by)
    return c * r[:, 0] - s * r[:, 1], s * r[:, 0] + c * r[:, 1], r[:, 2]


def _stack(components: Components, shape: tuple[int, ...]) -> Array:
    return np.stack([np.broadcast_to(component, shape) for component in components], axis=-1)


def _wobble(seeds: Sequence[int], name: str, process: GaussMarkov, samples: int) -> Array:
    """The process (B, N), rad."""
    return np.radians(_gauss_markov(seeds, name, process, NAV_STEPS * np.arange(samples)))


# --------------------------------------------------------------------------------------------- sensors


def _gauss_markov(seeds: Sequence[int], name: str, process: GaussMarkov, steps: npt.NDArray[np.intp]) -> Array:
    """The process (B, N) at these world steps."""
    if process.sigma == 0.0:
        return np.zeros((len(seeds), len(steps)))
    count = int(steps[-1]) + 1
    z: Iterator[Array] = iter(np.array([stream(seed, name).standard_normal(count) for seed in seeds]).T)
    # the generator only multiplies and adds: it takes arrays as well as floats
    rows = islice(gauss_markov(z, process, DT), count)  # type: ignore[arg-type]
    return np.array(list(rows)).T[:, steps]


def _errors(seeds: Sequence[int], name: str, process: GaussMarkov, steps: npt.NDArray[np.intp]) -> Array:
    """Errors (B, N, 3), the three axes independent."""
    return np.stack([_gauss_markov(seeds, f"{name}.{axis}", process, steps) for axis in "xyz"], axis=-1)


def _acceleration_errors(seeds: Sequence[int], nav: Nav, samples: int) -> Array:
    """White errors (B, N, 3) about a bias drawn once a run."""
    name, rows = "nav.acceleration", []
    for seed in seeds:
        bias = nav.acceleration_bias * stream(seed, f"{name}.bias").standard_normal(3)
        rows.append(bias + nav.acceleration_white * stream(seed, name).standard_normal((samples, 3)))
    return np.array(rows)


def _tilted(q: Array, error_deg: Array) -> Array:
    """Return attitudes (B, N, 4) with errors, rotation vectors (B, N, 3) in their body axes, deg."""
    vector = np.radians(error_deg)
    angle = np.linalg.norm(vector, axis=-1)
    scale = 0.5 * np.sinc(angle / (2 * np.pi))
    turn = (np.cos(angle / 2), *(scale * vector[..., i] for i in range(3)))
    return np.stack(attitude.product(_components(q), turn), axis=-1)  # type: ignore[arg-type]


def _images(
    scenario: Scenario, seeds: Sequence[int], size: Array, truth: TruthArrays, steps: npt.NDArray[np.intp]
) -> tuple[Array, Flags]:
    """Return image points (B, M, 3, 2), NaN if not registered, and whether they were in view (B, M)."""
    camera, count = scenario.camera, len(steps)
    q_bc, q_nF, q_nL = mount_quaternion(camera), _components(truth.q_nF), _components(truth.q_nL)
    r_FL_n = _components(truth.r_FL_n)
    in_view, ideal = np.ones(truth.a_lat.shape, dtype=bool), []
    with np.errstate(divide="ignore", invalid="ignore"):
        for r_FP_n in leader_points_n(r_FL_n, q_nL, size[:, None]):  # type: ignore[arg-type]
            x, y, z = in_camera(r_FP_n, q_nF, camera, q_bc)  # type: ignore[arg-type]
            in_view &= is_inside(camera, x, y, z)
            ideal.append(np.stack([y / x, z / x], axis=-1))
    noise = np.array([stream(seed, "camera.noise").standard_normal((count, 3, 2)) for seed in seeds])
    points = np.stack(ideal, axis=2) + camera.sigma_px / camera.f_px * noise
    drawn = np.array([stream(seed, "camera.wrong").random((count, 4)) for seed in seeds])
    u, v, w = np.moveaxis(drawn[..., 1:], -1, 0)
    other = np.moveaxis(np.array([_pair(p) for p in blob(camera, u, v, w)]), (0, 1), (2, 3))
    points = np.where((drawn[..., 0] < camera.wrong_blob)[..., None, None], other, points)
    found = np.array([list(islice(registrations(camera, seed), count)) for seed in seeds])
    t = steps / STEPS_PER_SECOND % scenario.repeat
    for b in camera.blackouts:
        found &= ~((b.start <= t) & (t < b.end))
    points[~(found & in_view)] = np.nan
    return points, in_view


def _pair(point: tuple[float, float]) -> Array:
    return np.array(np.broadcast_arrays(*point))


def _components(rows: Array) -> Components:
    return tuple(np.moveaxis(rows, -1, 0))
