"""`step`, a prediction and an update in one call, of two kinds of filter, against the two calls."""

from collections.abc import Callable
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
import pytest

from onboard.arrays import Array
from onboard.filters import Belief, FilterError, NotPositiveDefiniteError, square_root, unscented
from onboard.filters.stepping import Rule
from tests.support.filter_problems import spd

STEPS = 40


class Family(NamedTuple):
    """A module with `step`, how its state begins, and the belief of it."""

    module: ModuleType
    start: Callable[[Belief], Any]
    belief: Callable[[Any], Belief]
    tolerance: float


FAMILIES = {
    "unscented": Family(unscented, lambda belief: belief, lambda belief: belief, 1e-12),
    "square root": Family(square_root, lambda belief: square_root.start(*belief), square_root.belief, 1e-10),
}
both = pytest.mark.parametrize("family", FAMILIES.values(), ids=FAMILIES)


class Bent:
    """A problem with a bent process and a bent measurement, whose first component is an angle across the seam."""

    def __init__(self, n: int, m: int) -> None:
        rng = np.random.default_rng(100 * n + m)
        self.F = 0.95 * np.eye(n) + 0.05 * rng.normal(0, 1, (n, n))
        self.H = rng.normal(0, 1, (m, n))
        self.H[0] *= 0.1  # an angle, of sigma points within 2 rad
        self.Q, self.R = (0.01 * spd(rng, n)), spd(rng, m)
        self.start = Belief(rng.normal(0, 1, n), spd(rng, n))
        self.seen = rng.normal(0, 2, (STEPS, m))
        self.seen[:, 0] = np.pi - 0.1

    def process(self, rows: Array) -> Array:
        return np.asarray(np.sin(rows) @ self.F.T)

    def measure(self, rows: Array) -> Array:
        images = rows @ self.H.T
        images[:, 0] = (images[:, 0] + 2 * np.pi) % (2 * np.pi) - np.pi
        return np.asarray(images)

    def arguments(self, k: int, **changed: Any) -> tuple[Any, ...]:
        """All arguments of the k-th step but for belief and rule, some of them replaced."""
        given = {"process": self.process, "Q": self.Q, "y": self.seen[k], "measure": self.measure, "R": self.R}
        return tuple((given | changed).values())


def rule_of(family: Family, n: int, m: int, spread: float, **more: Any) -> Rule:
    made: Rule = family.module.rule(unscented.julier_weights(n, spread), n, m, (0,), **more)
    return made


@both
@pytest.mark.parametrize(("n", "m"), [(1, 1), (2, 3), (3, 1), (4, 2), (5, 5), (9, 3), (10, 4)])
@pytest.mark.parametrize("considered", [(), (0,)])
def test_a_step_is_a_prediction_and_an_update_seeds_101_to_1004(
    family: Family, n: int, m: int, considered: tuple[int, ...]
) -> None:
    problem, filter_ = Bent(n, m), family.module
    rule = rule_of(family, n, m, float(n) + 1, considered=considered)
    one: Any = family.start(problem.start)
    two, tolerance = one, family.tolerance
    for k, y in enumerate(problem.seen):
        one = filter_.step(one, *problem.arguments(k), rule)
        prior = filter_.predict(two, problem.process, problem.Q, rule.weights)
        found = filter_.update(prior, y, problem.measure, problem.R, rule.weights, (0,), considered)
        two = found.belief
        np.testing.assert_allclose(one.mean, two.mean, rtol=tolerance, atol=tolerance)
        np.testing.assert_allclose(one.covariance, family.belief(two).covariance, rtol=tolerance, atol=tolerance)
        assert one.nis == pytest.approx(found.nis, rel=100 * tolerance)


@both
def test_a_belief_of_another_rule_is_drawn_anew_seed_402(family: Family) -> None:
    problem, filter_ = Bent(4, 2), family.module
    first = filter_.step(family.start(problem.start), *problem.arguments(0), rule_of(family, 4, 2, 9.0))
    rule = rule_of(family, 4, 2, 5.0)
    anew = filter_.step(family.start(Belief(first.mean, first.covariance)), *problem.arguments(1), rule)
    drawn = filter_.step(first, *problem.arguments(1), rule)
    np.testing.assert_allclose(drawn.mean, anew.mean, rtol=1e-12)
    np.testing.assert_allclose(drawn.covariance, anew.covariance, rtol=1e-12)


@both
def test_what_a_step_gives_cannot_be_written_into_seed_402(family: Family) -> None:
    problem, rule = Bent(4, 2), rule_of(family, 4, 2, 5.0)
    first = family.module.step(family.start(problem.start), *problem.arguments(0), rule)
    before = first.mean.copy(), first.covariance.copy()
    for array in (first.mean, first.covariance):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0

    def in_place(rows: Array) -> Array:
        rows *= 0.5
        return rows

    with pytest.raises(ValueError, match="read-only"):
        family.module.step(first, *problem.arguments(1, process=in_place), rule)
    np.testing.assert_array_equal(first.mean, before[0])
    np.testing.assert_array_equal(first.covariance, before[1])


BROKEN: list[tuple[dict[str, Any], str]] = [
    ({"process": lambda rows: rows * np.nan}, "process: gave states that are not finite"),
    ({"process": lambda rows: rows[:, :2]}, r"process: gave \(9, 2\) for points \(9, 4\)|shapes do not fit"),
    ({"process": lambda rows: rows[0]}, "arrays must agree"),
    ({"measure": lambda rows: rows[:, :2] * np.nan}, "measure: gave measurements that are not finite"),
    ({"measure": lambda rows: rows[:, :3]}, "shapes do not fit"),
    ({"measure": lambda rows: rows[:, :2].tolist()}, "measure: must be a NumPy array"),
    ({"y": np.array([0.0, np.nan])}, "y: not finite"),
    ({"y": np.zeros(3)}, "shapes do not fit"),
    ({"y": [0.0, 0.0]}, "y: must be a NumPy array"),
    ({"Q": np.full((4, 4), np.inf)}, "Q: not (finite|positive)"),
    ({"Q": np.eye(4, dtype=np.float32)}, "Q: must be float64"),
]
INDEFINITE = {"Q": -100 * np.eye(4), "R": -100 * np.eye(2)}


@both
def test_a_step_refuses_what_the_two_calls_refuse_seed_402(family: Family) -> None:
    problem, rule = Bent(4, 2), rule_of(family, 4, 2, 5.0)
    begun, step = family.start(problem.start), family.module.step
    for wrong, message in BROKEN:
        with pytest.raises(FilterError, match=message):
            step(begun, *problem.arguments(0, **wrong), rule)
    for name, array in INDEFINITE.items():
        with pytest.raises(NotPositiveDefiniteError, match=f"{name}: not positive semi-definite"):
            step(begun, *problem.arguments(0, **{name: array}), rule)
    with pytest.raises(FilterError, match="must be below 2 and 4"):
        family.module.rule(rule.weights, 4, 2, (2,))


def test_beliefs_and_weights_that_no_step_takes_seed_402() -> None:
    problem, family = Bent(4, 2), FAMILIES["unscented"]
    rule, (mean, P) = rule_of(family, 4, 2, 5.0), problem.start
    for belief, message in (
        (Belief(mean * np.nan, P), "mean: not finite"),
        (Belief(np.tile(mean, (2, 1)), np.tile(P, (2, 1, 1))), "step: takes one filter"),
        (Belief(mean, -P), "covariance: not positive semi-definite"),
    ):
        with pytest.raises(FilterError, match=message):
            family.module.step(belief, *problem.arguments(0), rule)
    with pytest.raises(FilterError, match="must not be negative"):
        square_root.rule(unscented.julier_weights(4, 3.0), 4, 2)
