"""Encounters with one assumption false: what differs is what the departure names, by as much as it says."""

from itertools import islice

import numpy as np
import pytest
from numpy.typing import NDArray

from simlink.encounters.attitudes import multirotor_attitude
from simlink.encounters.curves import motion_from_positions
from simlink.encounters.departures import Departure
from simlink.encounters.encounter import Encounter, make_encounter
from simlink.scenarios.camera import Camera
from simlink.scenarios.profiles import GaussMarkov
from simlink.sensors.camera import correlated_normals
from simlink.world.constants import DT, GRAVITY
from simlink.world.noise import normals

Array = NDArray[np.float64]
SEEDS = range(1, 9)
SECONDS = 3.0


def both(family: str, seed: int, departure: Departure) -> tuple[Encounter, Encounter]:
    """An encounter as drawn, and with a departure."""
    return make_encounter(family, seed, SECONDS), make_encounter(family, seed, SECONDS, departure=departure)


def lean(encounter: Encounter) -> float:
    """The mean tilt, rad."""
    return float(np.mean(np.hypot(*encounter.truth.euler_L[:, :2].T)))


def test_a_leader_without_drag_leans_only_as_it_accelerates_seed_1() -> None:
    plain, upright = both("behind", 1, Departure(drag=0.0))
    assert lean(plain) > 3.0 * lean(upright)
    assert lean(both("behind", 1, Departure(drag=2.0 * plain.drag))[1]) > 1.7 * lean(plain)
    assert np.array_equal(plain.truth.leader.r, upright.truth.leader.r)


def test_wind_makes_a_leader_that_hovers_lean_seeds_1_to_8() -> None:
    for seed in SEEDS:
        windy = make_encounter("hover", seed, SECONDS, departure=Departure(wind=8.0, wobble=0.0, vigour=0.0))
        expected = np.arctan(8.0 * windy.drag / GRAVITY)
        assert lean(windy) == pytest.approx(expected, abs=5e-3)


def test_a_nose_that_points_anywhere_does_so_seeds_1_to_8() -> None:
    turned = []
    for seed in SEEDS:
        plain, other = both("behind", seed, Departure(any_nose=True))
        turned.append(other.truth.euler_L[:, 2] - plain.truth.euler_L[:, 2])
    assert np.ptp(turned, axis=1) == pytest.approx(np.zeros(len(SEEDS)), abs=1e-9)
    at = np.array(turned)[:, 0]
    assert np.all((at >= 0.0) & (at < 2.0 * np.pi))
    assert np.ptp(at) > np.pi


def test_a_bank_wobbles_and_a_standing_wing_leans_against_the_air_seed_1() -> None:
    of_bank = (Departure(bank=GaussMarkov(sigma=sigma, time=0.3)) for sigma in (0.0, 9.0))
    plain, rough = (make_encounter("behind", 1, 30.0, departure=d) for d in of_bank)
    error = np.degrees(rough.truth.euler_L[:, 0] - plain.truth.euler_L[:, 0])
    assert np.std(error) == pytest.approx(9.0, abs=1.0)
    assert np.corrcoef(error[60:], error[:-60])[0, 1] == pytest.approx(np.exp(-1.0), abs=0.15)
    o = np.zeros(3)
    flying = motion_from_positions(np.column_stack([4.0 * np.arange(9) * DT, np.zeros(9), np.zeros(9)]))
    for nose, angle in ((0.0, np.arctan(2.2 * 4.0 / GRAVITY)), (np.pi / 2, 0.0)):
        euler = multirotor_attitude(flying, np.full(9, nose), o, 0.0, 2.2)
        assert -euler[4, 1] == pytest.approx(angle, abs=1e-6)
        assert euler[4, 0] == pytest.approx(0.0, abs=1e-6)


def test_correlated_noise_of_images_is_as_large_and_lasts_as_long_as_it_says_seed_3() -> None:
    camera = Camera(rate=20.0, noise_time=0.5)
    x = np.array(list(islice(correlated_normals(normals(3, "test"), 6, camera), 20_000)))
    assert np.std(x, axis=0) == pytest.approx(np.ones(6), rel=0.1)
    assert np.mean(x[10:] * x[:-10]) == pytest.approx(np.exp(-1.0), abs=0.05)  # half a second later
    white = list(islice(correlated_normals(normals(3, "test"), 6, Camera()), 50))
    assert [*np.ravel(white)] == list(islice(normals(3, "test"), 300))
