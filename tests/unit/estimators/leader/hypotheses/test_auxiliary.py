"""Reports and ranges as rows: what particles becomes by them, on errors as they are assumed."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from onboard.arrays import Array
from onboard.estimators.leader.config import Config
from onboard.estimators.leader.hypotheses import prediction, update
from onboard.estimators.leader.hypotheses.auxiliary import DELAY, DISTANCE, TURN, Auxiliary, Range, Report
from onboard.estimators.leader.hypotheses.motion import (
    ACCELERATION,
    COURSE_LOCKED,
    FREE,
    LOG_SIZE,
    POSITION,
    STEADY,
    VELOCITY,
    N,
    courses,
)
from onboard.estimators.leader.hypotheses.particles import Bias, Particles
from onboard.estimators.leader.hypotheses.update import corrected
from onboard.estimators.leader.reports.broadcast import biases_of
from onboard.filters.belief import FilterError
from tests.unit.estimators.leader.hypotheses.test_belief import filter_of, watched
from tests.unit.estimators.leader.test_pose import settings_of

RANGE, SPEED = 28.0, 20.0  # m, m/s
BIASES = biases_of(Config(own_position_sigma_m=0.0))  # 2 m, 0.1 s, 0.14 m/s, 1.4 degrees
WHITE = np.diag([4.0] * 3 + [0.09] * 3)
NEW = Range(0, RANGE, 0.1, (Bias(DISTANCE, 0.5),))


def cloud_of(count: int, seed: int = 1, *, sizes: float = 0.3) -> Particles:
    """Particles about a leader 28 m ahead of us that flies ahead; their sizes are uncertain by a share."""
    rng = np.random.default_rng(seed)
    means = np.zeros((count, N))
    means[:, 0], means[:, 3], means[:, LOG_SIZE] = RANGE, SPEED, math.log(2.0)
    means += 0.1 * rng.normal(size=means.shape)
    P = np.tile(np.diag([0.5, 0.5, 0.5, 1.0, 1.0, 1.0, *[0.5] * (N - 6)]) ** 2, (count, 1, 1))
    by_size = np.zeros((count, N))
    by_size[:, POSITION], by_size[:, LOG_SIZE] = means[:, POSITION], 1.0
    P[:, LOG_SIZE, LOG_SIZE] = 0.0
    P += sizes**2 * by_size[:, :, None] * by_size[:, None, :]
    headings, zeros = np.arctan2(means[:, 4], means[:, 3]), np.zeros(count)
    weights = np.full(count, -math.log(count))
    regimes, course_locked, drags = (
        np.full(count, float(STEADY)),
        np.full(count, COURSE_LOCKED),
        np.full(count, settings_of().drag),
    )
    return Particles(
        headings, zeros, regimes, means, P, np.zeros((count, 3)), course_locked, drags, zeros, weights, 0
    )


def report(r: Array, v: Array) -> Report:
    return Report(0, r, v, WHITE, BIASES, trusted=True)


TRUE_REPORT = report(np.array([RANGE, 0.0, 0.0]), np.array([SPEED, 0.0, 0.0]))


@pytest.mark.parametrize("taken", [NEW, TRUE_REPORT])
def test_the_rows_are_the_derivatives_of_what_is_expected_seed_1(taken: Auxiliary) -> None:
    particles = cloud_of(3).with_biases(*taken.biases)
    particles.means[:, N : N + len(taken.biases) - 1] += 0.01  # all but the delay, which is never learnt
    rows, step = taken.rows(particles), 1e-6
    for i in range(particles.means.shape[1]):
        moved = particles.means.copy()
        moved[:, i] += step
        change = rows.innovations - taken.rows(particles._replace(means=moved)).innovations
        assert_allclose(change / step, rows.H[:, :, i], atol=1e-5)


def test_rows_are_a_kalman_update_of_each_particle_seed_2() -> None:
    particles = cloud_of(4, 2).with_biases(*NEW.biases)
    rows = NEW.rows(particles)
    after, nis, log_l = corrected(particles, *rows)
    for k in range(4):
        P, h, off = particles.covariances[k], rows.H[k, 0], rows.innovations[k, 0]
        S = h @ P @ h + NEW.sigma**2
        assert_allclose(after.means[k], particles.means[k] + P @ h / S * off)
        assert_allclose(after.covariances[k], P - np.outer(P @ h, h @ P) / S, atol=1e-10)
        assert nis[k] == pytest.approx(off**2 / S)
        assert log_l[k] == pytest.approx(-0.5 * (off**2 / S + math.log(S)))


def test_a_range_whose_error_lasts_stays_as_uncertain_as_that() -> None:
    """0.5 m that last, of 28 m: a hundred ranges of 0.1 m say no more than 1.8 % of the size."""
    particles = cloud_of(1)
    particles.covariances[:, POSITION, POSITION] -= 0.25 * np.eye(3) * 0.99  # for a size, the place is known
    for _ in range(100):
        after = update.assist(settings_of(), particles, NEW, is_open=False)
        assert after is not None
        particles = after
    sigma = math.sqrt(particles.covariances[0, LOG_SIZE, LOG_SIZE])
    assert sigma == pytest.approx(0.5 / RANGE, rel=0.15)


def test_a_delay_is_considered_and_not_learnt() -> None:
    particles = cloud_of(1)
    for _ in range(20):
        after = update.assist(settings_of(), particles, TRUE_REPORT, is_open=False)
        assert after is not None
        particles = after
    at = particles.column(DELAY)
    assert particles.covariances[0, at, at] == pytest.approx(0.01)
    assert particles.means[0, at] == 0.0
    P = particles.covariances[0]
    assert P[0, at] / 0.1 > 0.5  # m, ahead: the leader may be 2 m along its course by the delay
    assert_allclose(P, P.T)
    assert np.linalg.eigvalsh(P).min() > -1e-9


def test_each_bias_is_forgotten_in_its_own_time() -> None:
    particles = cloud_of(2).with_biases(Bias("quick", 3.0, 2.0), Bias("slow", 5.0, 40.0))
    particles.means[:, N:] = 1.0
    particles.covariances[:, range(N, N + 2), range(N, N + 2)] = 0.1
    after = prediction.predict(settings_of(), particles, 1.0, np.zeros(3))
    left = np.exp([-1.0 / 2.0, -1.0 / 40.0])
    assert_allclose(after.means[:, N:], [left, left])
    spread = 0.1 * left**2 + np.array([9.0, 25.0]) * (1.0 - left**2)
    assert_allclose(np.diagonal(after.covariances[:, N:, N:], axis1=1, axis2=2), [spread, spread])


def test_what_is_considered_is_that_of_a_gain_without_it_seed_4() -> None:
    """In Joseph's form, which holds for any gain."""
    particles = cloud_of(3, 4).with_biases(*BIASES)
    rows = TRUE_REPORT.rows(particles)
    after, _, _ = corrected(particles, *rows)
    at = particles.column(DELAY)
    for k in range(3):
        P, H = particles.covariances[k], rows.H[k]
        gain = P @ H.T @ np.linalg.inv(H @ P @ H.T + WHITE)
        gain[at] = 0.0
        left = np.eye(len(P)) - gain @ H
        assert_allclose(after.means[k], particles.means[k] + gain @ rows.innovations[k], atol=1e-9)
        assert_allclose(after.covariances[k], left @ P @ left.T + gain @ WHITE @ gain.T, atol=1e-8)


def test_our_own_yaw_turns_what_a_report_says() -> None:
    """It is to the right by 1.4 m, as our yaw of 0.05 rad makes it: that is learnt, and not the leader's place."""
    particles = cloud_of(1, sizes=0.02)
    exact = tuple(bias._replace(sigma=0.05 if bias.name == TURN else 1e-3) for bias in BIASES)
    r, v = particles.means[0, POSITION], particles.means[0, VELOCITY]
    turned = Report(
        0, r + np.array([-r[1], r[0], 0.0]) * 0.05, v, np.diag([1e-4] * 3 + [1.0] * 3), exact, trusted=True
    )
    particles.covariances[:, POSITION, POSITION] = 1e-4 * np.eye(3)
    after = update.assist(settings_of(), particles, turned, is_open=False)
    assert after is not None
    assert after.means[0, after.column(TURN)] == pytest.approx(-0.05, abs=0.002)
    assert_allclose(after.means[0, POSITION], r, atol=0.02)


def test_what_most_particles_did_not_expect_is_not_used_unless_the_range_is_open() -> None:
    """Of 50 particles three are where the range says."""
    particles = cloud_of(50, sizes=0.005)
    particles.means[3:, POSITION] *= 2.0
    assert update.assist(settings_of(), particles, NEW, is_open=False) is None
    after = update.assist(settings_of(), particles, NEW, is_open=True)
    assert after is not None
    assert np.exp(after.log_weights) @ (np.linalg.norm(after.means[:, POSITION], axis=1) < 30.0) > 0.9


@pytest.mark.parametrize(("off_m", "least", "most"), [(0.0, 0.0, 1.5), (12.0, 2.0, 2.0)])
def test_reports_that_fit_take_the_surprise_of_the_last_images_away_and_others_add_none(
    off_m: float, least: float, most: float
) -> None:
    """While no image comes, nothing else would."""
    particles = cloud_of(4)._replace(mean_nis=2.0, unseen=3.0)
    at = report(np.array([RANGE, off_m, 0.0]), np.array([SPEED, 0.0, 0.0]))
    after = update.assist(settings_of(), particles, at, is_open=False)
    assert after is not None
    assert least <= after.mean_nis <= most


@pytest.mark.parametrize("trusted", [True, False])
@pytest.mark.parametrize(("off", "is_credible"), [(0.0, True), (2.5, True), (3.5, False), (-3.5, False)])
def test_a_report_that_may_be_false_leads_the_size_no_farther_than_3_sigmas(
    trusted: bool, off: float, is_credible: bool
) -> None:
    """Whatever leads it there, and however slowly."""
    filter_ = filter_of()  # of a size that is known to 2 %
    state, _ = watched(filter_, 2.0, sway=1.0)
    state.particles.means[:, LOG_SIZE] += 0.02 * off
    x = state.summary.mean
    at = Report(0, x[POSITION], x[VELOCITY], np.diag([1e4] * 6), BIASES, trusted=trusted)
    assert (filter_.assist(state, at) is not None) is (trusted or is_credible)


def test_tied_noses_turn_with_the_courses_that_a_report_corrects_and_free_ones_stay() -> None:
    particles = cloud_of(4).with_biases(*TRUE_REPORT.biases)
    particles.headings[:2] += 0.05
    particles.course_locked[1::2] = FREE
    taken = report(np.array([RANGE, 0.0, 0.0]), np.array([SPEED, 3.0, 0.0]))
    after, _, _ = corrected(particles, *taken.rows(particles))
    was, now = (courses(c.means) for c in (particles, after))
    assert np.abs(now - was).min() > 1e-3
    assert (after.headings - particles.headings)[::2] == pytest.approx((now - was)[::2])
    assert_allclose(after.headings[1::2], particles.headings[1::2], rtol=0.0, atol=0.0)


def test_numbers_that_are_none_are_an_error() -> None:
    with pytest.raises(FilterError, match="numbers"):
        update.assist(settings_of(), cloud_of(3), report(np.full(3, math.nan), np.zeros(3)), is_open=False)


def carried(seed: int, seconds: int = 20) -> float:
    """The normalised square of the error of r_FL_n after reports alone, of a leader that holds its course."""
    settings = settings_of()._replace(doubted_after=1e9, tied_for=1e9)  # one hypothesis keeps its heading
    rng, particles = np.random.default_rng(seed), cloud_of(1, sizes=0.02)
    first = particles.covariances[0, :9, :9]
    x = np.concatenate(
        [particles.means[0, :6] + np.linalg.cholesky(first[:6, :6]) @ rng.normal(size=6), np.zeros(3)]
    )
    bias, delay, yaw = rng.normal(size=3) * [2.0, 2.0, 2.0], 0.1 * rng.normal(), 0.025 * rng.normal()
    for _ in range(seconds):
        for _ in range(10):
            particles = prediction.predict(settings, particles, 0.1, np.zeros(3))
            x[POSITION], x[VELOCITY], x[ACCELERATION] = (
                x[POSITION] + 0.1 * x[VELOCITY],
                x[VELOCITY] + 0.1 * x[ACCELERATION],
                x[ACCELERATION] + 0.1 * rng.normal(size=3),
            )
        turned = x[POSITION] - yaw * np.array([-x[1], x[0], 0.0])
        noise = np.sqrt(np.diag(WHITE)) * rng.normal(size=6)
        y = np.concatenate([turned + bias - delay * x[VELOCITY], x[VELOCITY]]) + noise
        after = update.assist(settings, particles, report(y[:3], y[3:]), is_open=False)
        particles = particles if after is None else after
    off = particles.means[0, POSITION] - x[POSITION]
    return float(off @ np.linalg.solve(particles.covariances[0, POSITION, POSITION], off))


@pytest.mark.parametrize(("flights", "most"), [(20, 4.8), pytest.param(60, 4.0, marks=pytest.mark.slow)])
def test_carried_by_reports_for_20_s_it_is_as_sure_as_it_is_right_seeds_1_to_60(flights: int, most: float) -> None:
    """The mean of the normalised square of three errors is 3, within what 60 flights show (2.1 to 4)."""
    assert 1.5 < np.mean([carried(seed) for seed in range(1, 1 + flights)]) < most
