"""The figures of merit of the study of Oh & Johnson's paper, by hand, and the bound beside them."""

import numpy as np
import pytest

from onboard.arrays import Array
from onboard.geometry.rotations import matrix_from_euler
from simlink.scenarios.scenario import load_scenario
from studies.relative_motion.bound import bounds
from studies.relative_motion.flight import Flight
from studies.relative_motion.flights import Flights, fly_many
from studies.relative_motion.formation import M_PER_FT, Track
from studies.relative_motion.noise import honest_noise
from studies.relative_motion.reference import compare
from studies.relative_motion.scores import Score, make_row, score, truth_of, unseen_samples

SCENARIO = load_scenario("formation")


@pytest.fixture(scope="module")
def flights() -> Flights:
    return fly_many(SCENARIO, [1, 2, 3], duration=20.0)


@pytest.fixture(scope="module")
def flight(flights: Flights) -> Flight:
    return flights.one(0)


def a_track(flight: Flight, mean: Array, *, failed_at: float = np.nan) -> Track:
    """A filter that reported `mean` throughout, with unit covariance, NIS 3 and no image gated."""
    n, m = len(mean), len(flight.image_t)
    return Track(
        t=flight.nav_t,
        mean=mean,
        covariance=np.broadcast_to(np.eye(9), (n, 9, 9)),
        nis=np.full(m, 3.0),
        fused=np.ones(m, dtype=bool),
        failed_at=failed_at,
    )


def test_errors_are_lengths_of_vectors_in_feet(flight: Flight) -> None:
    mean = truth_of(flight)
    mean[:, :3] += np.array([3.0, 4.0, 0.0]) * M_PER_FT
    mean[:, 3:6] += np.array([0.0, 0.6, 0.8]) * M_PER_FT
    mean[:, 6] *= 1.02
    mean[:, 7] -= 2.0 * M_PER_FT
    s = score(1, flight, a_track(flight, mean))
    assert s.position_ft == pytest.approx(5.0)
    assert s.velocity_ft_s == pytest.approx(1.0)
    assert s.size_percent == pytest.approx(2.0)
    assert s.a_lat_ft_s2 == pytest.approx(2.0)
    squares = np.array([5.0, 1.0, 0.02 * flight.size / M_PER_FT, 2.0]) * M_PER_FT
    assert s.nees == pytest.approx(float(squares @ squares))
    assert s.a_lat_converged_s is None  # 2 of 8 ft/s^2 is a quarter


def test_errors_before_15_s_do_not_count(flight: Flight) -> None:
    mean = truth_of(flight)
    mean[flight.nav_t < 14.99] += 1e6
    assert score(1, flight, a_track(flight, mean)).position_ft == 0.0


@pytest.mark.parametrize(("factor", "verdict"), [(1.49, None), (1.51, "range"), (0.51, None), (0.49, "range")])
def test_half_the_range_off_is_diverged(flight: Flight, factor: float, verdict: str | None) -> None:
    mean = truth_of(flight)
    mean[:, :3] *= factor
    s = score(1, flight, a_track(flight, mean))
    assert s.diverged == verdict
    assert s.range_percent == pytest.approx(100 * abs(factor - 1))


@pytest.mark.parametrize(("degrees", "verdict"), [(4.9, None), (5.1, "bearing")])
def test_five_degrees_off_is_diverged(flight: Flight, degrees: float, verdict: str | None) -> None:
    mean = truth_of(flight)
    # about an axis across the sight line, so that the whole angle shows
    turn = matrix_from_euler(0.0, 0.0, np.radians(degrees))
    mean[:, 2] = 0.0
    flat = flight.nav_truth.r_FL_n.copy()
    flat[:, 2] = 0.0
    level = flight._replace(nav_truth=flight.nav_truth._replace(r_FL_n=flat))
    mean[:, :3] = flat @ turn.T
    assert score(1, level, a_track(level, mean)).diverged == verdict


def test_a_numerical_failure_is_diverged(flight: Flight) -> None:
    s = score(1, flight, a_track(flight, truth_of(flight), failed_at=12.0))
    assert s.diverged == "numerical failure at 12.00 s"


def test_a_filter_without_an_estimate_in_the_end_has_diverged(flight: Flight) -> None:
    mean = truth_of(flight)
    mean[flight.nav_t > 14.0] = np.nan
    s = score(1, flight, a_track(flight, mean))
    assert (s.diverged, s.valid_percent) == ("no estimate", 0.0)
    mean = truth_of(flight)
    mean[(flight.nav_t > 15.99) & (flight.nav_t < 16.99)] = np.nan
    s = score(1, flight, a_track(flight, mean))
    assert s.diverged is None
    assert s.valid_percent == pytest.approx(80.0, abs=0.1)


def test_the_ellipsoid_holds_the_truth_or_does_not(flight: Flight) -> None:
    mean = truth_of(flight)
    late = flight.nav_t >= 17.5
    mean[late, 0] += 2.9  # unit covariance: 95 % lie within 2.795
    mean[~late, 0] += 2.7
    unseen = flight.nav_t >= 18.75
    s = score(1, flight, a_track(flight, mean), unseen)
    assert s.inside_percent == pytest.approx(50.0, abs=0.5)
    assert s.inside_unseen_percent == 0.0
    assert score(1, flight, a_track(flight, mean)).inside_unseen_percent is None


def test_out_of_view_lasts_from_image_to_image() -> None:
    in_view = np.array([True, False, True])
    assert unseen_samples(np.array([0, 2, 4]), in_view, 6).tolist() == [False, False, True, True, False, False]


def scores(flight: Flight) -> list[Score]:
    rows = []
    for k, feet in enumerate((3.0, 4.0, 900.0)):
        mean = truth_of(flight)
        mean[:, 0] += feet * M_PER_FT
        rows.append(score(k, flight, a_track(flight, mean)))
    return rows


def test_rows_pool_squares_over_the_runs_that_did_not_diverge(flight: Flight) -> None:
    row = make_row("a", "paper", scores(flight))
    assert row.runs == 3
    assert row.diverged_percent == pytest.approx(100 / 3)
    assert row.diverged_why == ("range",)
    assert row.quantities["position_ft"].value == pytest.approx(12.5**0.5)
    assert row.position_m == pytest.approx(12.5**0.5 * M_PER_FT)
    # squares 9 and 16: their mean is off by 3.5; that of a root is 1 / (2 root) of it
    assert row.quantities["position_ft"].standard_error == pytest.approx(3.5 / (2 * 12.5**0.5))


def test_comparisons_agree_within_two_standard_errors(flight: Flight) -> None:
    position = next(c for c in compare(make_row("a", "paper", scores(flight))) if c.quantity == "position_ft")
    assert position.reference == 2.72
    assert position.tolerance == pytest.approx(2 * 3.5 / (2 * 12.5**0.5) * (1 + 3 / 50) ** 0.5 + 0.005)
    assert position.agrees
    alike = make_row("a", "paper", [scores(flight)[1]] * 2)
    assert not next(c for c in compare(alike) if c.quantity == "position_ft").agrees


def test_the_bound_is_below_what_filters_reach_seeds_1_to_3(flights: Flights) -> None:
    """The position's error is that of the size prior, 2 % of 90 ft."""
    least = bounds(flights, SCENARIO.camera, honest_noise("fixed_wing"), 15.0)
    assert [b.seed for b in least] == [1, 2, 3]
    for one in least:
        assert 1.5 < one.range_percent < 2.0
        assert 1.3 < one.position_ft < 1.9
        assert 0.2 < one.velocity_ft_s < 0.6
    alone = fly_many(SCENARIO, [2], duration=20.0)
    assert bounds(alone, SCENARIO.camera, honest_noise("fixed_wing"), 15.0)[0].position_ft == pytest.approx(
        least[1].position_ft, rel=1e-4
    )
