"""The particle filter: properties of the conformance suite, densities by quadrature, and what it alone can."""

from typing import Any

import numpy as np
import pytest

from onboard.arrays import Array
from onboard.filters import (
    Belief,
    FilterError,
    LinearModel,
    NotPositiveDefiniteError,
    kalman,
    log_likelihood,
    particle,
    run,
    simulate,
)
from onboard.filters.gating import mean_bounds, normalised_squared
from tests.conformance import test_methods as conformance
from tests.conformance import test_methods_angles as angles

ONE = np.eye(1)


@pytest.mark.parametrize(
    "property_",
    [
        conformance.test_pure_and_deterministic_on_read_only_arrays_seed_1,
        conformance.test_takes_fewer_measurements_than_states_seed_3,
        conformance.test_an_outage_is_predicted_through_seed_9,
        angles.test_an_angle_that_there_is_not_is_refused,
    ],
    ids=lambda f: f.__name__,
)
def test_it_has_this_property_of_all_filters(property_: Any) -> None:
    property_(particle.METHOD)


def test_nees_and_nis_keep_their_bounds_where_measurements_are_sharp_seed_4() -> None:
    """The plain bootstrap filter with 2,000 particles has a mean NEES of 1,385 here."""
    rng, runs, dt = np.random.default_rng(4), 100, 0.1
    F, H = np.eye(4) + dt * np.eye(4, k=2), np.eye(2, 4)
    Q, R, P = np.diag([1e-4, 1e-4, 0.01, 0.01]), np.diag([0.04, 0.09]), np.diag([1.0, 1.0, 4.0, 4.0])
    state = particle.start(np.zeros((runs, 4)), np.tile(P, (runs, 1, 1)))
    best = Belief(np.zeros((runs, 4)), np.tile(P, (runs, 1, 1)))
    x = rng.multivariate_normal(np.zeros(4), P, runs)
    for _ in range(15):
        x = x @ F.T + rng.multivariate_normal(np.zeros(4), Q, runs)
        y = x @ H.T + rng.multivariate_normal(np.zeros(2), R, runs)
        found = particle.update(particle.predict(state, lambda r: r @ F.T, Q), y, lambda r: r @ H.T, R)
        state, best = found.belief, kalman.update(kalman.predict(best, F, Q), y, H, R).belief
    mean, covariance = particle.belief(state)
    nees = normalised_squared(mean - x, covariance)
    for figure, degrees in ((nees, 4), (found.nis, 2)):
        low, high = mean_bounds(degrees, runs, 0.95)
        assert low < np.mean(figure) < high
    rms, least = (np.sqrt(np.mean((b - x) ** 2, axis=0)) for b in (mean, best.mean))
    assert np.all(rms < 1.1 * least), rms / least


def test_a_measurement_much_sharper_than_the_cloud_is_taken_in_parts_seeds_0_to_19() -> None:
    """500 particles, 30 times as broad: taken at once, one counts, and the evidence is off by up to 14."""
    y, R, S = np.ones(2), 1e-3 * np.eye(2), 1.001
    exact = -np.log(2 * np.pi * S) - 0.5 * float(y @ y) / S
    for seed in range(20):
        found = particle.update(particle.start(np.zeros(2), np.eye(2), 500, seed), y, lambda r: r.copy(), R)
        after = particle.belief(found.belief)
        assert found.log_evidence == pytest.approx(exact, abs=2.0)
        assert float(normalised_squared(after.mean - y / S, after.covariance)) < 1.0


def test_two_hypotheses_and_their_evidence_are_those_of_quadrature() -> None:
    """y = x^2 of x ~ N(0.3, 1): a line through the mean knows nothing of it."""
    y, R = np.array([1.5]), np.array([[0.1]])
    grid: Array = np.linspace(-8, 8, 200_001)
    joint = np.exp(-0.5 * (grid - 0.3) ** 2 - 0.5 * (1.5 - grid**2) ** 2 / 0.1) / (2 * np.pi * 0.1**0.5)
    evidence = float(joint.sum() * (grid[1] - grid[0]))
    right = float(joint[grid > 0].sum() / joint.sum())
    state = particle.start(np.array([0.3]), ONE, 4000, bandwidth=0.1)
    found = particle.update(state, y, lambda rows: rows**2, R)
    x, weights = found.belief.particles[:, 0], np.exp(found.belief.log_weights)
    assert found.log_evidence == pytest.approx(np.log(evidence), abs=0.05)
    assert weights[x > 0].sum() == pytest.approx(right, abs=0.03)
    assert weights[np.abs(np.abs(x) - 1.22) > 0.5].sum() < 0.01


def test_a_batch_is_as_its_members_and_a_seed_draws_again() -> None:
    mean, P, y, R = np.zeros((3, 2)), np.tile(np.eye(2), (3, 1, 1)), np.ones((3, 1)), 0.01 * ONE
    states = [particle.start(mean, P, 200, seed) for seed in (1, 1, 2)]
    ahead = [particle.predict(state, lambda rows: 1.1 * rows, np.eye(2)) for state in states]
    found = [particle.belief(particle.update(s, y, lambda rows: rows[:, :1].copy(), R).belief) for s in ahead]
    np.testing.assert_array_equal(found[0].mean, found[1].mean)
    assert np.abs(found[0].mean - found[2].mean).min() > 0
    np.testing.assert_allclose(found[0].mean[:, 0], 0.995, atol=0.05)
    alone = particle.predict(particle.start(mean[0], P[0], 200, 1), lambda rows: 1.1 * rows, np.eye(2))
    np.testing.assert_allclose(alone.particles, ahead[0].particles[0], atol=1e-12)


def test_misuse_is_refused() -> None:
    state = particle.start(np.zeros(1), ONE, 100)
    wrong: list[tuple[Any, type[FilterError], str]] = [
        (lambda: particle.start(np.zeros(1), ONE, 1), FilterError, "particles 1"),
        (lambda: particle.start(np.zeros(1), -ONE), NotPositiveDefiniteError, "covariance"),
        (lambda: particle.predict(state, lambda r: r, -ONE), NotPositiveDefiniteError, "Q: not"),
        (lambda: particle.predict(state, lambda r: r, np.eye(2)), FilterError, r"Q: must be \(1, 1\)"),
        (lambda: particle.predict(state, lambda r: r * np.nan, ONE), FilterError, "process: gave states"),
        (lambda: particle.update(state, np.ones(1), lambda r: r, 0 * ONE), NotPositiveDefiniteError, "R: must be"),
        (lambda: particle.update(state, np.ones((2, 1)), lambda r: r, ONE), FilterError, "y: must be"),
        (lambda: particle.update(state, np.ones(1) * np.nan, lambda r: r, ONE), FilterError, "not finite"),
    ]
    for call, error, message in wrong:
        with pytest.raises(error, match=message):
            call()


@pytest.mark.parametrize("sharp", [1.0, 0.1, 0.01, 0.001], ids="R of {}".format)
@pytest.mark.parametrize("off", [0.0, 3.0, 10.0, 40.0])
def test_an_outlier_leaves_the_cloud_as_the_kalman_filter_is_seeds_0_to_4(off: float, sharp: float) -> None:
    """Ten deviations off, 500 particles were left at 2.5 +- 0.004, all of them effective, for 9.9 +- 0.1."""
    R = np.array([[sharp**2]])
    y = np.array([off])
    want = kalman.update(Belief(np.zeros(1), ONE), y, ONE, R)
    sigma = float(np.sqrt(want.belief.covariance[0, 0]))
    for seed in range(5):
        found = particle.update(particle.start(np.zeros(1), ONE, 500, seed), y, lambda r: r.copy(), R)
        after = particle.belief(found.belief)
        assert abs(after.mean[0] - want.belief.mean[0]) < 0.8 * sigma
        assert 0.7 < np.sqrt(after.covariance[0, 0]) / sigma < 1.3
        assert found.log_evidence == pytest.approx(log_likelihood(want), abs=3.0)


def test_after_an_outlier_it_finds_back_seed_5() -> None:
    """In a batch of which one has it; the other measures nothing of it."""
    model = LinearModel(ONE, 0.01 * ONE, ONE, 0.01 * ONE)
    start = Belief(np.zeros((2, 1)), np.tile(ONE, (2, 1, 1)))
    _, ys = simulate(model, start, 20, np.random.default_rng(5))
    ys[8, 1] += 10.0
    ys[12, 0] = np.nan
    found, want = (run(name, model, start, ys) for name in ("particle", "kalman"))
    off = np.abs(found.beliefs.mean - want.beliefs.mean) / np.sqrt(want.beliefs.covariance[..., 0])
    assert off.max() < 0.8
    np.testing.assert_allclose(found.nis[8, 1], want.nis[8, 1], rtol=0.3)


def test_each_of_a_batch_may_miss_something_else_though_some_are_done_seed_6() -> None:
    """A member whose measurement is taken at once is done before one that takes parts."""
    model = LinearModel(np.eye(2), 0.01 * np.eye(2), np.eye(2), np.diag([1.0, 1e-4]))
    start = Belief(np.zeros((4, 2)), np.tile(np.eye(2), (4, 1, 1)))
    _, ys = simulate(model, start, 6, np.random.default_rng(6))
    ys[:, 0, 1] = ys[:, 1, 1] = ys[:, 2, 0] = np.nan
    found, want = (run(name, model, start, ys) for name in ("particle", "kalman"))
    sigma = np.sqrt(np.diagonal(want.beliefs.covariance, axis1=-2, axis2=-1))
    assert (np.abs(found.beliefs.mean - want.beliefs.mean) / sigma).max() < 0.6


def by_grid(prior: Any, density: Any, value: Any, axes: Any) -> tuple[float, float, float]:
    """Mean and sigma of a value after a measurement, and its log evidence, on a regular grid of points (k, n)."""
    cell = np.prod([axis[1] - axis[0] for axis in axes])
    points = np.stack([part.ravel() for part in np.meshgrid(*axes, indexing="ij")], axis=-1)
    log_w = prior(points) + density(points)
    w = np.exp(log_w - log_w.max())
    mean = float(w @ value(points) / w.sum())
    variance = float(w @ (value(points) - mean) ** 2 / w.sum())
    return mean, variance**0.5, float(np.log(w.sum() * cell) + log_w.max())


def distance(rows: Array) -> Array:
    return np.hypot(rows[:, :1], rows[:, 1:2])


def squared(rows: Array) -> Array:
    return rows * rows / 20


@pytest.mark.parametrize(
    ("measure", "mean", "sigma", "y", "R"),
    [
        *((distance, (0.0, 0.0), 1.0, y, 0.04) for y in (4.0, 4.5, 5.0)),
        *((squared, (0.0,), 1.0, y, R) for y, R in ((1.0, 0.01), (3.0, 0.01), (7.8, 1.0), (12.0, 1.0))),
        *((squared, (5.0,), 2.0, y, R) for y, R in ((7.8, 0.01), (12.0, 1.0), (12.0, 0.01))),
    ],
)
def test_what_no_line_explains_is_neither_ignored_nor_followed_seeds_0_to_2(
    measure: Any, mean: tuple[float, ...], sigma: float, y: float, R: float
) -> None:
    """A beacon in the middle of the cloud has no slope: a range of 4.5 left 1.26 +- 0.65 for 4.34 +- 0.20."""
    n, size = len(mean), abs if measure is squared else distance
    axes = [np.linspace(-22, 22, 44_001 if n == 1 else 441)] * n

    def prior(x: Array) -> Array:
        return -0.5 * np.sum((x - mean) ** 2, axis=1) / sigma**2 - n * np.log(sigma * np.sqrt(2 * np.pi))

    def density(x: Array) -> Array:
        return -0.5 * (measure(x)[:, 0] - y) ** 2 / R - 0.5 * np.log(2 * np.pi * R)

    want = by_grid(prior, density, lambda x: np.abs(size(x))[:, 0], axes)
    for seed in range(3):
        start = particle.start(np.array(mean), sigma**2 * np.eye(n), 1000, seed)
        found = particle.update(start, np.array([y]), measure, np.array([[R]]))
        weights, values = np.exp(found.belief.log_weights), np.abs(size(found.belief.particles))[:, 0]
        middle = float(weights @ values)
        assert abs(middle - want[0]) < 0.3 * want[1]
        assert 0.75 < float(weights @ (values - middle) ** 2) ** 0.5 / want[1] < 1.25
        assert float(found.log_evidence) == pytest.approx(want[2], abs=1.0)
