"""`step`, a prediction and an update in one call, of two kinds of filter, against the two calls."""

from typing import Any

import numpy as np
import pytest

from onboard.arrays import Array
from onboard.filters import Belief, FilterError, NotPositiveDefiniteError, square_root, unscented
from onboard.filters.stepping import Rule
from tests.support.filter_problems import spd

STEPS = 40


class Bent:
    """A problem with a bent process and a bent measurement, whose first component is an angle across the seam."""

    def __init__(self, n: int, m: int, dtype: type = np.float64) -> None:
        rng = np.random.default_rng(100 * n + m)
        self.F = (0.95 * np.eye(n) + 0.05 * rng.normal(0, 1, (n, n))).astype(dtype)
        self.H = rng.normal(0, 1, (m, n)).astype(dtype)
        self.H[0] *= 0.1  # an angle, of sigma points within 2 rad
        self.Q, self.R = (0.01 * spd(rng, n)).astype(dtype), spd(rng, m).astype(dtype)
        self.start = Belief(rng.normal(0, 1, n).astype(dtype), spd(rng, n).astype(dtype))
        self.seen = rng.normal(0, 2, (STEPS, m)).astype(dtype)
        self.seen[:, 0] = np.pi - 0.1

    def process(self, rows: Array) -> Array:
        return np.asarray(np.sin(rows) @ self.F.T)

    def measure(self, rows: Array) -> Array:
        images = rows @ self.H.T
        images[:, 0] = (images[:, 0] + 2 * np.pi) % (2 * np.pi) - np.pi
        return np.asarray(images)


def steps(problem: Bent, rule: Rule, considered: tuple[int, ...] = ()) -> tuple[Any, Belief]:
    """The last of what `step` gives and the belief of the two calls; they are compared at every step."""
    one: Any = problem.start
    two = problem.start
    tolerance = 1e-12 if two.mean.dtype == np.float64 else 1e-4
    for y in problem.seen:
        one = unscented.step(one, problem.process, problem.Q, y, problem.measure, problem.R, rule)
        prior = unscented.predict(two, problem.process, problem.Q, rule.weights)
        found = unscented.update(prior, y, problem.measure, problem.R, rule.weights, (0,), considered)
        two = found.belief
        np.testing.assert_allclose(one.mean, two.mean, rtol=tolerance, atol=tolerance)
        np.testing.assert_allclose(one.covariance, two.covariance, rtol=tolerance, atol=tolerance)
        assert one.nis == pytest.approx(found.nis, rel=100 * tolerance)
    return one, two


@pytest.mark.parametrize(("n", "m"), [(1, 1), (2, 3), (3, 1), (4, 2), (5, 5), (9, 3), (10, 4)])
@pytest.mark.parametrize("dtype", [np.float64, pytest.param(np.float32, marks=pytest.mark.single)])
def test_a_step_is_a_prediction_and_an_update_seeds_101_to_1004(n: int, m: int, dtype: type) -> None:
    weights = unscented.julier_weights(n, float(n) + 1)
    one, _ = steps(Bent(n, m, dtype), unscented.rule(weights, n, m, (0,), dtype=dtype))
    assert one.mean.dtype == one.covariance.dtype == dtype


def test_a_step_leaves_considered_states_alone_seed_503() -> None:
    problem = Bent(5, 3)
    rule = unscented.rule(unscented.julier_weights(5, 6.0), 5, 3, (0,), (1, 4))
    steps(problem, rule, (1, 4))


def test_a_belief_of_another_rule_is_drawn_anew_seed_402() -> None:
    problem, narrow = Bent(4, 2), unscented.julier_weights(4, 5.0)
    first = unscented.step(
        problem.start,
        problem.process,
        problem.Q,
        problem.seen[0],
        problem.measure,
        problem.R,
        unscented.rule(unscented.julier_weights(4, 9.0), 4, 2, (0,)),
    )
    arguments = problem.process, problem.Q, problem.seen[1], problem.measure, problem.R
    rule = unscented.rule(narrow, 4, 2, (0,))
    anew = unscented.step(Belief(first.mean, first.covariance), *arguments, rule)
    drawn = unscented.step(first, *arguments, rule)
    np.testing.assert_array_equal(drawn.points, anew.points)
    np.testing.assert_array_equal(drawn.covariance, anew.covariance)
    two = unscented.predict(Belief(first.mean, first.covariance), problem.process, problem.Q, narrow)
    np.testing.assert_allclose(unscented.predict(first, problem.process, problem.Q, narrow).mean, two.mean)


def test_what_a_step_gives_cannot_be_written_into_seed_402() -> None:
    problem, rule = Bent(4, 2), unscented.rule(unscented.julier_weights(4, 5.0), 4, 2, (0,))
    first = unscented.step(
        problem.start, problem.process, problem.Q, problem.seen[0], problem.measure, problem.R, rule
    )
    before = first.storage.copy()
    for array in (first.mean, first.covariance):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0

    def in_place(rows: Array) -> Array:
        rows *= 0.5
        return rows

    with pytest.raises(ValueError, match="read-only"):
        unscented.step(first, in_place, problem.Q, problem.seen[1], problem.measure, problem.R, rule)
    np.testing.assert_array_equal(first.storage, before)


def test_a_step_refuses_what_the_two_calls_refuse_seed_402() -> None:
    problem, rule = Bent(4, 2), unscented.rule(unscented.julier_weights(4, 5.0), 4, 2, (0,))
    good: dict[str, Any] = {
        "belief": problem.start,
        "process": problem.process,
        "Q": problem.Q,
        "y": problem.seen[0],
        "measure": problem.measure,
        "R": problem.R,
        "rule": rule,
    }
    unscented.step(**good)
    mean, P = problem.start
    cases: list[tuple[dict[str, Any], str]] = [
        ({"belief": Belief(mean * np.nan, P)}, "mean: not finite"),
        ({"belief": Belief(np.tile(mean, (2, 1)), np.tile(P, (2, 1, 1)))}, "step: takes one filter"),
        ({"process": lambda rows: rows * np.nan}, "process: gave states that are not finite"),
        ({"process": lambda rows: rows[:, :2]}, r"process: gave \(9, 2\) for points \(9, 4\)|shapes do not fit"),
        ({"process": lambda rows: rows[0]}, "arrays must agree"),
        ({"measure": lambda rows: rows[:, :2] * np.nan}, "measure: gave measurements that are not finite"),
        ({"measure": lambda rows: rows[:, :3]}, "shapes do not fit"),
        ({"measure": lambda rows: rows[:, :2].tolist()}, "measure: must be a NumPy array"),
        ({"y": np.array([0.0, np.nan])}, "y: not finite"),
        ({"y": np.zeros(3)}, "shapes do not fit"),
        ({"y": [0.0, 0.0]}, "y: must be a NumPy array"),
        ({"Q": problem.Q * np.inf}, "Q: not finite"),
        ({"Q": problem.Q.astype(np.float32)}, "arrays must agree in precision"),
    ]
    for wrong, message in cases:
        with pytest.raises(FilterError, match=message):
            unscented.step(**{**good, **wrong})
    for wrong, message in (
        ({"belief": Belief(mean, -P)}, "covariance: not positive semi-definite"),
        ({"Q": -100 * np.eye(4)}, "Q: not positive semi-definite"),
        ({"R": -100 * np.eye(2)}, "R: not positive semi-definite"),
    ):
        with pytest.raises(NotPositiveDefiniteError, match=message):
            unscented.step(**{**good, **wrong})
    with pytest.raises(FilterError, match="must be below 2 and 4"):
        unscented.rule(rule.weights, 4, 2, (2,))


@pytest.mark.parametrize(("n", "m"), [(1, 1), (3, 1), (4, 2), (5, 5), (9, 3)])
@pytest.mark.parametrize("dtype", [np.float64, pytest.param(np.float32, marks=pytest.mark.single)])
@pytest.mark.parametrize("considered", [(), (0,)])
def test_a_step_of_the_square_root_is_a_prediction_and_an_update_seeds_101_to_903(
    n: int, m: int, dtype: type, considered: tuple[int, ...]
) -> None:
    problem, weights = Bent(n, m, dtype), unscented.julier_weights(n, float(n) + 1)
    rule = square_root.rule(weights, n, m, (0,), considered, dtype=dtype)
    one: Any = square_root.start(*problem.start)
    two = one
    tolerance = 1e-10 if dtype == np.float64 else 1e-3
    for y in problem.seen:
        one = square_root.step(one, problem.process, problem.Q, y, problem.measure, problem.R, rule)
        prior = square_root.predict(two, problem.process, problem.Q, weights)
        found = square_root.update(prior, y, problem.measure, problem.R, weights, (0,), considered)
        two = found.belief
        np.testing.assert_allclose(one.mean, two.mean, rtol=tolerance, atol=tolerance)
        covariance = square_root.belief(two).covariance
        np.testing.assert_allclose(one.covariance, covariance, rtol=tolerance, atol=tolerance)
        assert one.nis == pytest.approx(found.nis, rel=100 * tolerance)
    assert one.mean.dtype == one.covariance.dtype == dtype


def test_a_step_of_the_square_root_refuses_what_its_two_calls_refuse_seed_402() -> None:
    problem = Bent(4, 2)
    rule = square_root.rule(unscented.julier_weights(4, 5.0), 4, 2, (0,))
    start = square_root.start(*problem.start)
    arguments = problem.process, problem.Q, problem.seen[0], problem.measure, problem.R
    first = square_root.step(start, *arguments, rule)
    with pytest.raises(ValueError, match="read-only"):
        first.covariance[0] = 0.0
    process, Q, y, measure, R = arguments
    cases: list[tuple[tuple[Any, ...], str]] = [
        ((lambda rows: rows * np.nan, Q, y, measure, R), "process: gave states that are not finite"),
        ((process, -Q, y, measure, R), "Q: not positive semi-definite"),
        ((process, Q, y, lambda rows: rows[:, :2] * np.nan, R), "measure: gave measurements that are not finite"),
        ((process, Q, np.array([0.0, np.nan]), measure, R), "y: not finite"),
        ((process, Q, np.zeros(3), measure, R), "shapes do not fit"),
        ((process, Q.astype(np.float32), y, measure, R), "arrays must agree in precision"),
    ]
    for wrong, message in cases:
        with pytest.raises(FilterError, match=message):
            square_root.step(first, *wrong, rule)  # type: ignore[call-arg]  # each has five
    with pytest.raises(FilterError, match="must not be negative"):
        square_root.rule(unscented.julier_weights(4, 3.0), 4, 2)
    other = square_root.rule(unscented.julier_weights(4, 6.0), 4, 2, (0,))
    anew = square_root.step(square_root.start(first.mean, first.covariance), *arguments, other)
    np.testing.assert_allclose(square_root.step(first, *arguments, other).mean, anew.mean, rtol=1e-12)
