"""The wing-line filter's modes, its noise of a delay and a velocity both unknown, and a leader that hovers."""

import numpy as np
import pytest
from scipy.linalg import expm

from onboard.estimators.leader.filters import modes as leader_modes
from onboard.estimators.leader.filters import wing_line
from onboard.estimators.leader.filters import wing_line_noise as noise
from onboard.estimators.leader.filters.wing_line import Filter
from onboard.estimators.leader.filters.wing_line_noise import Extras
from onboard.estimators.leader.settings import FIXED_WING, MULTIROTOR, ManoeuvreModel
from onboard.filters.belief import Belief
from onboard.models import leader_flight as flight
from onboard.models.leader_flight import ImageGeometry
from onboard.models.relative_motion import R, V
from studies.relative_motion.flights import fly_many
from studies.relative_motion.scores import truth_of
from studies.relative_motion.shipped import Shipped, track
from studies.relative_motion.variants import BY_NAME, scenario_of, setting_of


@pytest.mark.parametrize("largest", [0.0, 1e-6, 0.02, 0.3, 12.0])
def test_the_exponential_of_rates_is_scipys_seed_5(largest: float) -> None:
    rates = np.random.default_rng(5).uniform(0.0, 1.0, (5, 5))
    x = largest * (rates - np.diag(rates.sum(axis=1)))
    np.testing.assert_allclose(noise._exponential(x), expm(x), rtol=1e-11, atol=1e-15)


@pytest.mark.parametrize("extras", [Extras(), Extras(middle=True)])
@pytest.mark.parametrize("model", [FIXED_WING, MULTIROTOR])
def test_transition_probabilities_are_those_of_a_markov_chain(model: ManoeuvreModel, extras: Extras) -> None:
    step, double = (noise.transition_probabilities(model, extras, dt) for dt in (0.02, 0.04))
    np.testing.assert_allclose(step.sum(axis=1), 1.0, rtol=1e-12)
    assert step.min() >= 0.0
    np.testing.assert_allclose(step @ step, double, rtol=1e-12)
    modes = len(noise.mode_parameters(model, extras))
    assert modes == len(step) == len(noise.process_noise(model, extras, 2.0, 0.02))
    assert modes == (5 if model is MULTIROTOR and extras.middle else 2)


def test_a_hovering_leader_keeps_its_heading_or_turns_right_or_left() -> None:
    parameters = noise.mode_parameters(MULTIROTOR, Extras(middle=True))
    rate = MULTIROTOR.nose_rate
    assert [p.nose_rate for p in parameters] == [0.0, 0.0, 0.0, rate, -rate]
    assert [p.hover_time < np.inf for p in parameters] == [False, False, True, True, True]


def test_without_the_wings_middle_there_are_no_hovering_modes() -> None:
    """A nose that turns could not be distinguished from a leader that flies away."""
    assert not noise.can_hover(MULTIROTOR, Extras())
    assert noise.can_hover(MULTIROTOR, Extras(middle=True))
    assert not noise.can_hover(FIXED_WING, Extras(middle=True))


def test_a_hovering_leader_drifts_by_the_error_of_our_own_velocity() -> None:
    exact, wrong = (
        noise.process_noise(MULTIROTOR, Extras(middle=True, own_velocity=sigma), 2.0, 100.0)[2][V, V]
        for sigma in (0.0, 0.1)
    )
    np.testing.assert_allclose(np.sqrt(np.diag(exact)), MULTIROTOR.hover, rtol=1e-9)  # in the long run
    np.testing.assert_allclose(np.sqrt(np.diag(wrong)), np.hypot(MULTIROTOR.hover, 0.1), rtol=1e-9)


def test_a_new_track_keeps_the_motion_that_the_last_one_knew_better() -> None:
    """Velocity, accelerations, heading, delay and bias: not the position or the size, which its image gave, and of
    two targets only what that target's earlier track knew better."""
    n = flight.N_BOTH
    mean, P = np.zeros((2, n)), np.tile(4.0 * np.eye(n) + 1.0, (2, 1, 1))
    before = Belief(np.arange(1.0, 2 * n + 1).reshape(2, n), np.tile(np.eye(n), (2, 1, 1)))
    before.covariance[1] = 9.0 * np.eye(n)
    before.covariance[0, flight.A_ALONG, flight.A_ALONG] = 9.0
    wing_line._keep_motion(mean, P, before)
    motion = {*range(V.start, V.stop), 7, 8, flight.HEADING, *range(flight.BASE, n)}
    for i in range(n):
        assert mean[0, i] == (before.mean[0, i] if i in motion else 0.0)
        assert P[0, i, i] == pytest.approx(1.0 if i in motion else 5.0)
    correlations = P[0] / np.sqrt(np.outer(np.diag(P[0]), np.diag(P[0])))
    np.testing.assert_allclose(correlations, 0.2 + 0.8 * np.eye(n))  # as before
    np.testing.assert_array_equal(mean[1], 0.0)
    np.testing.assert_array_equal(P[1], 4.0 * np.eye(n) + 1.0)


def test_a_delay_and_a_velocity_both_unknown_blur_the_direction_by_their_product() -> None:
    """By drawing both: the variance of delay times velocity over the distance, beyond what each does alone."""
    n, rng = flight.N_DELAY, np.random.default_rng(4)
    mean, P = np.zeros((1, n)), np.zeros((1, n, n))
    mean[0, R], mean[0, V], mean[0, flight.BASE] = (25.0, 0.0, 0.0), (1.0, 2.0, -1.0), 0.05
    at = [*range(V.start, V.stop), flight.BASE]
    root = rng.normal(size=(4, 4)) * np.array([1.0, 2.0, 1.5, 0.1])[:, None]
    P[np.ix_([0], at, at)] = root @ root.T
    geometry = ImageGeometry(
        np.eye(3)[None], np.zeros((1, 3)), np.zeros((1, 3)), np.zeros((1, 3)), np.eye(3)[None]
    )
    ours = wing_line._delay_noise(leader_modes.start(mean, P, np.ones(1)), geometry, 6)[0]
    drawn = rng.multivariate_normal(np.zeros(4), root @ root.T, 400_000)
    products = drawn[:, 3:] * drawn[:, 1:3] / 25.0
    np.testing.assert_allclose(ours[:2, :2], np.cov(products.T), rtol=0.03, atol=1e-6)
    for i in (0, 4):
        for j in (0, 4):
            np.testing.assert_array_equal(ours[i : i + 2, j : j + 2], ours[:2, :2])
    assert not ours[2:4].any()


def test_a_leader_that_hovers_and_turns_its_nose_stays_where_it_is_seeds_1_and_2() -> None:
    variant = BY_NAME["hover"]
    scenario = scenario_of(variant)
    exact = [f"ownship.errors.{key}=0" for key in ("tilt_sigma_deg", "yaw_sigma_deg", "velocity_sigma_m_s")]
    settings = ('estimator.leader.filter="wing-line"', "estimator.leader.center_on_wing=true", *exact)
    for seed in (1, 2):
        flight = fly_many(scenario, [seed], duration=40.0).one(0)
        found = track(flight, setting_of(variant, scenario), Shipped("wing-line", "", settings))
        error = found.mean[:, R] - truth_of(flight)[:, R]
        late = flight.nav_t > 26.0  # yawed by 30 degrees and more; taken for distance, 4 m and then 25 m
        assert np.sqrt(np.mean(np.sum(error[late] ** 2, axis=1))) < 0.24


def test_a_filter_measures_the_middle_only_if_the_center_is_there() -> None:
    assert (Filter(2.0, 0.04).m, Filter(2.0, 0.04, extras=Extras(middle=True)).m) == (4, 6)
