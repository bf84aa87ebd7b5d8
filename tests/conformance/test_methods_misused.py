"""No method gives a wrong number for what cannot be right: it refuses, and says why. They are found, not listed.

The figures in docstrings are what was given before it was refused.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from onboard.arrays import Array
from onboard.filters import (
    augmented,
    extended,
    kalman,
    methods,
    multiple_model,
    posterior_linearisation,
    smoothing,
    square_root,
    unscented,
)
from onboard.filters.belief import Belief, FilterError, Method
from onboard.filters.discretisation import white_acceleration
from onboard.filters.unscented_transform import julier_weights
from tests.support.filter_problems import identity
from tests.support.tables import each

every = each("method", methods())
MEAN, P = np.array([10.0, 5.0]), np.diag([4.0, 1.0])
Q, R, Y = 0.1 * np.eye(2), np.eye(2), np.array([10.5, 5.5])


@every
def test_no_measurement_is_refused_by_name_or_changes_nothing(method: Method) -> None:
    state = method.start(MEAN, P)
    nothing = np.empty(0), lambda rows: rows[:, :0], np.empty((0, 0))
    if "svsf" in method.name:
        with pytest.raises(FilterError, match=r"y \(1, 0\)"):
            method.update(state, *nothing)
    else:
        np.testing.assert_allclose(method.belief(method.update(state, *nothing).belief).mean, MEAN)


# ----------------------------------------------------------------------------------- weights of other states

FIVE = Belief(np.array([34.95, 1.0, 2.0, 3.0, 4.0]), np.eye(5))


def test_weights_are_those_of_the_states() -> None:
    """Three states' on five: their sum is 5/3, and 34.95 was predicted as 58.3."""
    right = unscented.predict(FIVE, identity, np.eye(5), julier_weights(5))
    assert right.mean[0] == pytest.approx(34.95)
    y, measure, r = np.array([35.0]), lambda rows: rows[:, :1].copy(), np.eye(1)
    wrong = julier_weights(3)
    rooted = square_root.start(*FIVE)
    calls: list[Callable[[], Any]] = [
        lambda: unscented.sigma_points(FIVE, wrong),
        lambda: unscented.predict(FIVE, identity, np.eye(5), wrong),
        lambda: unscented.update(FIVE, y, measure, r, wrong),
        lambda: unscented.rule(wrong, 5, 1),
        lambda: square_root.predict(rooted, identity, np.eye(5), wrong),
        lambda: square_root.update(rooted, y, measure, r, wrong),
        lambda: square_root.update_joseph(rooted, y, measure, r, wrong),
        lambda: square_root.update_classical(rooted, y, measure, r, wrong),
        lambda: square_root.rule(wrong, 5, 1),
        lambda: posterior_linearisation.update(FIVE, y, measure, r, weights=wrong),
        lambda: augmented.predict_augmented(FIVE, augmented.additive(identity), np.eye(5), lambda _: wrong),
        lambda: augmented.update_augmented(FIVE, y, augmented.additive(measure), r, lambda _: wrong),
    ]
    for call in calls:
        with pytest.raises(FilterError, match=r"^weights: are for 3 states, not (5|6|10)"):
            call()


# ------------------------------------------------------------------------------------------ smoothers, Jacobians


@pytest.mark.parametrize(
    "q", [np.array(0.1), np.array([0.1, 0.1]), np.array([[0.1]])], ids=["()", "(n,)", "(1, 1)"]
)
def test_a_smoother_does_not_spread_a_number_over_a_matrix(q: Array) -> None:
    """Q = 0.1 filled the matrix: positions were off by up to 1.69, 1.7 standard deviations."""
    record, F = Belief(np.zeros((4, 2)), np.tile(np.eye(2), (4, 1, 1))), np.array([[1.0, 1.0], [0.0, 1.0]])
    smoothing.rauch_tung_striebel(record, F, 0.1 * np.eye(2))
    with pytest.raises(FilterError, match=r"^Q: must be \(2, 2\)"):
        smoothing.rauch_tung_striebel(record, F, q)
    with pytest.raises(FilterError, match=r"^F: must be \(2, 2\)"):
        smoothing.rauch_tung_striebel(record, q, F)
    with pytest.raises(FilterError, match=r"^inputs: must be \(3, 2\)"):
        smoothing.rauch_tung_striebel(record, F, 0.1 * np.eye(2), np.zeros((3, 1)))


def test_a_transposed_jacobian_is_refused() -> None:
    """(k, n, m) for (k, m, n) was reshaped: -0.333 for 0."""
    belief = Belief(np.arange(3.0), np.eye(3))
    y, measure = np.zeros(2), lambda rows: rows[:, :2] * 1
    right = extended.update(belief, y, measure, R, jacobian=lambda r: np.tile(np.eye(2, 3), (len(r), 1, 1)))
    np.testing.assert_allclose(right.belief.mean, [0.0, 0.5, 2.0], atol=1e-12)
    with pytest.raises(FilterError, match=r"^jacobian: gave \(1, 3, 2\), must be \(1, 2, 3\)"):
        extended.update(belief, y, measure, R, jacobian=lambda r: np.tile(np.eye(3, 2), (len(r), 1, 1)))


# -------------------------------------------------------------------------------- the linear filter on a curve


def ranges(rows: Array) -> Array:
    return np.hypot(rows[:, :1], rows[:, 1:2])


def test_the_kalman_filter_refuses_a_model_that_is_not_affine() -> None:
    """The range of (30, 40): 30.498 for 30.594, without a word."""
    linear, other = methods()["kalman"], methods()["extended"]
    belief, y, r = Belief(np.array([30.0, 40.0]), np.eye(2)), np.array([51.0]), np.array([[0.01]])
    assert other.update(belief, y, ranges, r).belief.mean[0] == pytest.approx(30.594, abs=5e-4)
    for mean in (belief.mean, np.zeros(2), np.array([0.0, 40.0])):
        with pytest.raises(FilterError, match=r"^measure: is not affine"):
            linear.update(Belief(mean, np.eye(2)), y, ranges, r)
        with pytest.raises(FilterError, match=r"^process: is not affine"):
            linear.predict(Belief(mean, np.eye(2)), lambda rows: rows + 0.01 * rows**2, np.eye(2))


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e7])
def test_an_affine_model_may_be_of_any_size_seed_1(scale: float) -> None:
    rng = np.random.default_rng(1)
    F, offset = rng.normal(0, 1, (4, 4)), scale * rng.normal(0, 1, 4)
    mean = scale * rng.normal(0, 1, 4)
    matrix, value = kalman.affine(lambda rows: rows @ F.T + offset, mean)
    np.testing.assert_allclose(value, F @ mean + offset, rtol=1e-4, atol=1e-4 * scale)
    np.testing.assert_allclose(matrix, F, atol=4 * np.finfo(float).eps * (1 + abs(offset).max()))


# --------------------------------------------------------------------------------------------- multiple models


@every
def test_a_model_twice_is_the_single_filter_seed_3(method: Method) -> None:
    """csvsf-adaptive's `model_error` was counted twice: a variance 1.53 times as large."""
    if method.name == "csvsf-printed":
        return  # its two filters are started anew from the mixed belief, as `multiple_model` says
    F, noise = white_acceleration(0.1, 0.01, axes=1)
    process, measure, r = (lambda rows: rows @ F.T), (lambda rows: rows[:, :1].copy()), np.array([[0.01]])
    rng, transition = np.random.default_rng(3), np.array([[0.9, 0.1], [0.1, 0.9]])
    alone = method.start(np.zeros(2), np.eye(2))
    both = multiple_model.start((method, method), np.zeros(2), np.eye(2), np.array([0.5, 0.5]))
    x = 0.0
    for k in range(150):
        x += 0.1 if k < 100 else 0.15  # its speed jumps
        y = np.array([x + 0.1 * rng.normal()])
        alone = method.update(method.predict(alone, process, noise), y, measure, r).belief
        both = multiple_model.predict((method, method), both, [process] * 2, [noise] * 2, transition)
        both = multiple_model.update((method, method), both, y, [measure] * 2, r).belief
    one, mixed = method.belief(alone), multiple_model.belief((method, method), both)
    np.testing.assert_allclose(mixed.mean, one.mean, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(mixed.covariance, one.covariance, rtol=1e-9, atol=1e-12)


def test_probabilities_remain_a_distribution_whatever_is_measured() -> None:
    pair = (methods()["kalman"],) * 2
    state = multiple_model.start(pair, MEAN, P, np.array([0.7, 0.3]))
    y = np.array([1e200, 0.0])
    with np.errstate(over="ignore", invalid="ignore"):
        after = multiple_model.update(pair, state, y, [identity, identity], R).belief
    np.testing.assert_allclose(after.probabilities, [0.7, 0.3], rtol=1e-6)
