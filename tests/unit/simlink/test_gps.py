"""Our vehicle's GPS errs by as much as the scenario says, no more and no less."""

from itertools import islice

import numpy as np
import pytest

from onboard.arrays import Array
from simlink.scenarios.profiles import GaussMarkov
from simlink.scenarios.scenario import Scenario
from simlink.scenarios.vehicle import Gps
from simlink.sensors.navigation import readings
from simlink.world.truth import states

HZ = 200


def errors(gps: Gps, seed: int, seconds: float) -> tuple[Array, Array]:
    """Errors of position (N, 3) and velocity (N, 3)."""
    scenario = Scenario(gps=gps)
    rows = list(islice(readings(scenario, seed, states(scenario, seed)), round(seconds * HZ)))
    position = [np.subtract(reading.gps_r_OF_n, state.r_OF_n) for state, reading in rows]
    return np.array(position), np.array([np.subtract(reading.gps_v_F_n, state.v_F_n) for state, reading in rows])


def test_white_errors_have_the_scenarios_sigmas_on_each_axis_seed_15() -> None:
    gps = Gps(position=GaussMarkov(), position_white=(0.5, 1.0, 2.0))
    position, velocity = errors(gps, 15, 15.0)
    np.testing.assert_allclose(position.std(axis=0), (0.5, 1.0, 2.0), rtol=0.05)
    np.testing.assert_allclose(velocity.std(axis=0), (0.1, 0.1, 0.3), rtol=0.05)
    np.testing.assert_allclose(position.mean(axis=0), 0.0, atol=0.1)


def test_the_slow_error_has_its_sigma_and_its_time_seed_16() -> None:
    """Short against the flight, so that one flight shows many of its turns."""
    position, _ = errors(Gps(position=GaussMarkov(sigma=1.5, time=0.2)), 16, 40.0)
    assert position.std() == pytest.approx(1.5, rel=0.1)
    later = round(0.2 * HZ)
    correlation = np.mean(position[later:] * position[:-later]) / np.mean(position**2)
    assert correlation == pytest.approx(np.exp(-1), abs=0.08)


def test_a_flight_by_default_errs_by_a_metre_seeds_1_to_150() -> None:
    first = [errors(Gps(), seed, 1 / HZ)[0][0] for seed in range(1, 151)]
    assert np.std(first) == pytest.approx(1.0, rel=0.1)
