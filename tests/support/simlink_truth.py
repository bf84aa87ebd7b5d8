"""The simulator's truth, and its dead reckoning from an ideal inertial sensor."""

from itertools import islice, pairwise

import numpy as np

from onboard.arrays import Array
from simlink.scenarios.scenario import Scenario
from simlink.world import attitude
from simlink.world.truth import State, states

HZ = 200
GRAVITY = 9.80665


def flight(scenario: Scenario, seed: int, seconds: float) -> list[State]:
    return list(islice(states(scenario, seed), round(seconds * HZ) + 1))


def dead_reckoned(rows: list[State]) -> tuple[Array, tuple[float, float, float, float]]:
    """Return the final velocity (NED, m/s) and attitude q_nF, integrated from specific force and rates."""
    v, q = np.array(rows[0].v_F_n), rows[0].q_nF
    for before, now in pairwise(rows):
        f_n = np.array(attitude.to_n(q, before.f_b))
        q = attitude.product(q, attitude.from_vector(*(w / HZ for w in now.omega_b)))
        v += (f_n + np.array(attitude.to_n(q, now.f_b))) / 2 / HZ + np.array([0.0, 0.0, GRAVITY]) / HZ
    return v, q
