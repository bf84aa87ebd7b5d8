"""A whole flight as arrays: no MAVLink, no quantisation, no transport."""

from itertools import islice
from typing import Final, NamedTuple

import numpy as np

from onboard.messages import Vec3
from simlink.scenarios.scenario import Scenario
from simlink.sensors.arrays import Array
from simlink.sensors.camera import CameraSensor, Points, is_exposure
from simlink.sensors.navigation import readings, white
from simlink.world.attitude import add, difference
from simlink.world.constants import STEPS_PER_SECOND, step_count
from simlink.world.truth import State, states, true_size

NAV_RATE: Final = 50  # Hz


class TruthArrays(NamedTuple):
    """The truth at N times in n (NED), in SI units; relative vectors are leader minus follower."""

    r_FL_n: Array  # (N, 3)
    v_FL_n: Array  # (N, 3)
    a_lat: Array  # (N,)
    a_long: Array  # (N,)
    r_OF_n: Array  # (N, 3)
    v_F_n: Array  # (N, 3)
    a_F_n: Array  # (N, 3)
    q_nF: Array  # (N, 4)
    q_nL: Array  # (N, 4)


class Flight(NamedTuple):
    """One run.

    Times are seconds of flight; N nav samples at 50 Hz, M images at the camera's rate.

    `nav_*` are the outputs of the follower's navigation system (errors as in the scenario), `image_points` holds
    (Y_c/X_c, Z_c/X_c) of center, left and right point, NaN where no image was registered.
    """

    size: float  # true size of this run, m
    nav_t: Array  # (N,)
    nav_v_F_n: Array  # (N, 3)
    nav_a_F_n: Array  # (N, 3)
    nav_q_nb: Array  # (N, 4)
    nav_truth: TruthArrays
    image_t: Array  # (M,) exposure
    image_t_delivered: Array  # (M,)
    image_points: Array  # (M, 3, 2)
    image_truth: TruthArrays


def fly(scenario: Scenario, seed: int, duration: float | None = None) -> Flight:
    """The arrays of one run over `duration` s (None: the scenario's), both ends included."""
    size = true_size(scenario, seed)
    if scenario.camera.gimbal is not None:
        raise ValueError("fly knows no gimbal: use simlink.simulation")
    if scenario.camera.sees != "wing":
        raise ValueError("fly knows the wing only: use simlink.simulation")
    camera = CameraSensor(scenario, seed, size)
    errors = scenario.nav
    acceleration = white(seed, "nav.acceleration", errors.acceleration_white, errors.acceleration_bias)
    steps = step_count(scenario.duration if duration is None else duration)
    nav: list[tuple[State, Vec3, Vec3, tuple[float, ...]]] = []
    images: list[tuple[State, Points | None]] = []
    for state, reading in islice(readings(scenario, seed, states(scenario, seed)), steps + 1):
        if state.step % (STEPS_PER_SECOND // NAV_RATE) == 0:
            a_F_n = add(state.a_F_n, next(acceleration))
            nav.append((state, reading.v_F_n, a_F_n, reading.q_nb))
        if is_exposure(state.step, scenario.camera.rate):
            images.append((state, camera.expose(state)))
    image_t = np.array([state.t for state, _ in images])
    no_image = ((np.nan, np.nan),) * 3
    return Flight(
        size=size,
        nav_t=np.array([row[0].t for row in nav]),
        nav_v_F_n=np.array([row[1] for row in nav]),
        nav_a_F_n=np.array([row[2] for row in nav]),
        nav_q_nb=np.array([row[3] for row in nav]),
        nav_truth=_truth([row[0] for row in nav]),
        image_t=image_t,
        image_t_delivered=image_t + scenario.camera.latency,
        image_points=np.array([points or no_image for _, points in images]),
        image_truth=_truth([state for state, _ in images]),
    )


def _truth(rows: list[State]) -> TruthArrays:
    return TruthArrays(
        r_FL_n=np.array([difference(s.r_OL_n, s.r_OF_n) for s in rows]),
        v_FL_n=np.array([difference(s.v_L_n, s.v_F_n) for s in rows]),
        **{name: np.array([getattr(s, name) for s in rows]) for name in TruthArrays._fields[2:]},
    )
