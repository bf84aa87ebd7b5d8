"""Encounters with one assumption false: what differs is what the departure names, by as much as it says."""

from itertools import islice

import numpy as np
import pytest
from numpy.typing import NDArray

from onboard.messages import LocalPosition
from simlink.encounters.attitudes import multirotor_attitude
from simlink.encounters.conditions import NOMINAL_SIZE
from simlink.encounters.curves import motion_from_positions
from simlink.encounters.departures import NO_DEPARTURE, Departure
from simlink.encounters.encounter import Encounter, make_encounter
from simlink.scenarios.camera import Camera
from simlink.scenarios.profiles import GaussMarkov
from simlink.sensors.camera import correlated_normals
from simlink.sensors.shapes import draw_rotors
from simlink.world.constants import DT, GRAVITY
from simlink.world.noise import normals
from studies.encounters.flights import received

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


def course_rate(encounter: Encounter) -> Array:
    (u, v, _), (du, dv, _) = encounter.truth.leader.v.T, encounter.truth.leader.a.T
    return np.asarray((u * dv - v * du) / (u**2 + v**2))


def test_a_yaw_leads_its_course_in_a_turn_seeds_1_to_8() -> None:
    for seed in SEEDS:
        plain, other = both("behind", seed, Departure(yaw_leads=0.8))
        ahead = other.truth.euler_L[:, 2] - plain.truth.euler_L[:, 2]
        assert ahead == pytest.approx(0.8 * course_rate(plain), abs=0.03)


def test_a_nose_swings_by_its_slack_and_turns_at_its_rate_seeds_1_to_8() -> None:
    for seed in SEEDS:
        plain, swung = (
            make_encounter("behind", seed, 30.0, departure=d)
            for d in (NO_DEPARTURE, Departure(nose_slack_deg=28.0))
        )
        swing = swung.truth.euler_L[:, 2] - plain.truth.euler_L[:, 2]
        assert np.degrees(np.sqrt(np.mean(swing**2))) == pytest.approx(28.0, abs=0.1)
        turned = make_encounter("behind", seed, 30.0, departure=Departure(nose_rate=3.1, nose_turns=0.95))
        rate = np.gradient(np.unwrap(turned.truth.euler_L[:, 2] - plain.truth.euler_L[:, 2]), DT)
        assert np.abs(rate).max() == pytest.approx(2.8, abs=0.4)
        assert np.mean(np.abs(rate) > 0.5) > 0.7


def test_a_leader_manoeuvres_and_hovers_by_hand_as_hard_as_is_said_seeds_1_to_8() -> None:
    for seed in SEEDS:
        calm = make_encounter("hover", seed, 30.0)
        wild = make_encounter("hover", seed, 30.0, departure=Departure(acceleration=9.0))
        more = wild.truth.leader.a - calm.truth.leader.a
        assert np.sqrt(np.mean(np.sum(more[3:-3] ** 2, axis=1))) == pytest.approx(9.0, rel=0.02)
        by_hand = make_encounter("hover", seed, 30.0, departure=Departure(jitter=0.57))
        more = by_hand.truth.leader.v - calm.truth.leader.v
        assert np.sqrt(np.mean(np.sum(more[3:-3] ** 2, axis=1))) == pytest.approx(0.57, rel=0.02)
        assert np.array_equal(by_hand.truth.follower.r, calm.truth.follower.r)


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


def test_a_size_is_off_to_either_side_seeds_1_to_8() -> None:
    others = (both("hover", seed, Departure(size_off=0.06))[1] for seed in SEEDS)
    sizes = {round(other.scenario.leader.size / NOMINAL_SIZE, 9) for other in others}
    assert sorted(sizes) == [0.94, 1.06]


def test_our_errors_and_the_image_noise_are_larger_and_nothing_else_seed_2() -> None:
    plain, worse = both("behind", 2, Departure(own_errors=2.0, image_noise=3.7))
    for a, b in zip(received(plain), received(worse), strict=True):
        assert type(a) is type(b)
    assert worse.scenario.camera.sigma_px == pytest.approx(3.7 * plain.scenario.camera.sigma_px)
    assert np.array_equal(plain.truth.euler_L, worse.truth.euler_L)
    assert np.array_equal(plain.truth.euler_F, worse.truth.euler_F)

    def velocity_errors(encounter: Encounter) -> Array:
        found = [m for m in received(encounter) if isinstance(m, LocalPosition)]
        return np.array([m.v_F_n for m in found])

    none = make_encounter("behind", 2, SECONDS, departure=Departure(own_errors=0.0))
    off, twice = (velocity_errors(e) - velocity_errors(none) for e in (plain, worse))
    assert np.abs(off).max() > 0.01
    assert twice == pytest.approx(2.0 * off, abs=1e-5)  # of single precision


def test_other_departures_change_what_they_name_and_nothing_else_seed_2() -> None:
    departure = Departure(
        wobble=4.0, image_noise_time=0.5, stamp_late=0.03, own_errors_time=3.0, attitude_white_deg=0.6
    )
    plain, other = (e.scenario for e in both("behind", 2, departure))
    assert other.leader.bank_wobble_deg.sigma == pytest.approx(4.0 * plain.leader.bank_wobble_deg.sigma)
    assert other.leader.heading_wobble_deg.sigma == pytest.approx(4.0 * plain.leader.heading_wobble_deg.sigma)
    assert other.leader.bank_wobble_deg.time == plain.leader.bank_wobble_deg.time
    assert (plain.camera.noise_time, other.camera.noise_time) == (0.0, 0.5)
    assert other.camera.stamp_late == min(0.03, plain.camera.latency)
    for name in ("attitude_deg", "yaw_deg", "velocity"):
        assert getattr(other.nav, name).time == 3.0
        assert getattr(other.nav, name).sigma == getattr(plain.nav, name).sigma
    assert np.degrees(other.nav.attitude_white) == pytest.approx([0.6] * 3)


def test_correlated_noise_of_images_is_as_large_and_lasts_as_long_as_it_says_seed_3() -> None:
    camera = Camera(rate=20.0, noise_time=0.5)
    x = np.array(list(islice(correlated_normals(normals(3, "test"), 6, camera), 20_000)))
    assert np.std(x, axis=0) == pytest.approx(np.ones(6), rel=0.1)
    assert np.mean(x[10:] * x[:-10]) == pytest.approx(np.exp(-1.0), abs=0.05)  # half a second later
    white = list(islice(correlated_normals(normals(3, "test"), 6, Camera()), 50))
    assert [*np.ravel(white)] == list(islice(normals(3, "test"), 300))


def test_a_quadrotor_is_as_wide_as_its_rotors_and_wider_across_the_corners_seeds_1_to_8() -> None:
    for seed in SEEDS:
        bounds = np.array(draw_rotors(np.random.default_rng(seed)))
        length, width, height = np.ptp(bounds, axis=0)
        assert width == pytest.approx(1.0)
        assert 0.9 < length < 1.1
        assert 0.12 <= height <= 0.45
        assert 1.15 < np.ptp(bounds[:, :2] @ [np.sqrt(0.5), np.sqrt(0.5)]) < 1.32
