"""Parameters from a record: the Nile's of Durbin & Koopman, known ones found again, and what is refused."""

import numpy as np
import pytest

from onboard.arrays import Array
from onboard.filters import (
    Belief,
    FilterError,
    LinearModel,
    Model,
    expectation_maximisation,
    maximum_likelihood,
    run,
)
from tests.support.nile import FLOW

ONE = np.eye(1)
DIFFUSE = Belief(np.zeros(1), 1e12 * ONE)


def nile(theta: Array) -> float:
    R, Q = np.exp(theta)
    return float(run("kalman", LinearModel(ONE, Q * ONE, ONE, R * ONE), DIFFUSE, FLOW).log_likelihood[1:].sum())


def test_the_nile_s_variances_by_maximum_likelihood() -> None:
    """Durbin & Koopman, section 2.10.2: 15,098.5 and 1,469.2, and a log-likelihood of -632.546 but for a
    constant."""
    found = maximum_likelihood(nile, np.log([10_000.0, 10_000.0]))
    np.testing.assert_allclose(np.exp(found.theta), [15_098.5, 1_469.2], atol=0.05)
    assert found.log_likelihood == pytest.approx(-632.5456, abs=1e-4)
    sigma = np.sqrt(np.diag(found.covariance))
    np.testing.assert_allclose(sigma, [0.2083, 0.8715], atol=2e-3)


def test_the_nile_s_variances_by_expectation_maximisation() -> None:
    first = LinearModel(ONE, 10_000 * ONE, ONE, 10_000 * ONE)
    fit = expectation_maximisation(first, DIFFUSE, FLOW, iterations=2000, tolerance=1e-13)
    assert fit.model.R[0, 0] == pytest.approx(15_098.5, abs=0.5)
    assert fit.model.Q[0, 0] == pytest.approx(1_469.2, abs=0.5)
    assert np.all(np.diff(fit.log_likelihood) >= 0)


def test_expectation_maximisation_climbs_to_the_likelihood_s_maximum_with_gaps_and_inputs_seed_1() -> None:
    """F, Q, R and the start of a batch of two states and two measurements, of which parts are missing."""
    rng, T, B = np.random.default_rng(1), 200, 3
    F, H = np.array([[0.9, 0.2], [-0.1, 0.8]]), np.array([[1.0, 0.0], [0.5, 1.0]])
    Q, R = np.array([[0.3, 0.1], [0.1, 0.2]]), np.array([[0.5, 0.2], [0.2, 0.4]])
    inputs, x, ys = rng.normal(0, 1, (T - 1, 2)), rng.normal(0, 1, (B, 2)), np.empty((T, B, 2))
    for k in range(T):
        if k:
            x = x @ F.T + inputs[k - 1] + rng.multivariate_normal(np.zeros(2), Q, B)
        ys[k] = x @ H.T + rng.multivariate_normal(np.zeros(2), R, B)
    ys[rng.random(ys.shape) < 0.2] = np.nan
    start = Belief(np.zeros((B, 2)), np.tile(np.eye(2), (B, 1, 1)))
    first = LinearModel(0.5 * np.eye(2), np.eye(2), H, np.eye(2), inputs)
    fit = expectation_maximisation(first, start, ys, ("F", "Q", "R", "start"), iterations=60, tolerance=0.0)
    assert np.all(np.diff(fit.log_likelihood) > -1e-9)
    for found, true, bound in ((fit.model.F, F, 0.06), (fit.model.Q, Q, 0.09), (fit.model.R, R, 0.09)):
        np.testing.assert_allclose(found, true, atol=bound)
    assert fit.start.covariance.trace(axis1=1, axis2=2).max() < 1.5


def test_parameters_of_a_nonlinear_model_are_found_again_seed_2() -> None:
    rng, T, true = np.random.default_rng(2), 200, np.array([0.7, np.log(0.1)])

    def model(theta: Array) -> Model:
        return Model(
            lambda rows: rows + theta[0] * np.sin(rows), np.exp(theta[1:]) * ONE, lambda rows: rows**3, ONE
        )

    x, ys = np.array([[2.0]]), []
    for _ in range(T):
        ys.append(x[0] ** 3 + rng.normal(0, 1, 1))
        x = x + true[0] * np.sin(x) + np.sqrt(0.1) * rng.normal(0, 1, (1, 1))
    start = Belief(np.array([2.0]), 0.01 * ONE)
    found = maximum_likelihood(
        lambda theta: float(run("extended", model(theta), start, np.stack(ys)).log_likelihood.sum()), [0.3, -1.0]
    )
    off = np.abs(found.theta - true) / np.sqrt(np.diag(found.covariance))
    assert off.max() < 3.0, (found.theta, off)


def test_a_function_without_a_maximum_and_parts_that_are_none_are_refused() -> None:
    with pytest.raises(FilterError, match="guess: the log-likelihood is not finite at"):
        maximum_likelihood(lambda _: np.nan, [0.0])
    model = LinearModel(ONE, ONE, ONE, ONE)
    with pytest.raises(FilterError, match=r"estimate: must be of F, Q, R, start, .* not \['H'\]"):
        expectation_maximisation(model, DIFFUSE, FLOW, ["H"])
    with pytest.raises(FilterError, match="of a model that does not change"):
        expectation_maximisation(model._replace(F=np.ones((99, 1, 1))), DIFFUSE, FLOW)
    with pytest.raises(FilterError, match="ys: nothing is measured"):
        expectation_maximisation(model, DIFFUSE, np.full(5, np.nan), ["R"])
    flat = maximum_likelihood(lambda theta: -float(theta[0] ** 2), [1.0, 1.0])  # says nothing of the second
    assert np.isnan(flat.covariance).all()
    assert flat.theta[0] == pytest.approx(0.0, abs=1e-4)


CV, PLACE = np.array([[1.0, 1.0], [0.0, 1.0]]), np.eye(1, 2)
EXACT = {  # records that a model fits to the last digit: the model, the record, and its first belief
    "constant": (LinearModel(ONE, ONE, ONE, ONE), np.full((50, 1), 3.0), Belief(np.zeros(1), 100 * ONE)),
    "nothing": (LinearModel(ONE, ONE, ONE, ONE), np.zeros((50, 1)), Belief(np.zeros(1), 100 * ONE)),
    "geometric": (LinearModel(ONE, ONE, ONE, ONE), 0.9 ** np.arange(50.0)[:, None], Belief(np.zeros(1), ONE)),
    "line": (
        LinearModel(CV, np.eye(2), PLACE, ONE),
        np.arange(50.0)[:, None],
        Belief(np.zeros(2), 100 * np.eye(2)),
    ),
    "two": (LinearModel(ONE, ONE, ONE, ONE), np.ones((2, 1)), Belief(np.zeros(1), 100 * ONE)),
    "a batch": (
        LinearModel(CV, np.eye(2), PLACE, ONE),
        np.arange(50.0)[:, None, None] * np.array([[1.0], [2.0]]),
        Belief(np.zeros((2, 2)), np.tile(100 * np.eye(2), (2, 1, 1))),
    ),
}


@pytest.mark.parametrize("record", EXACT)
def test_a_record_that_the_model_fits_exactly_is_fitted(record: str) -> None:
    """Variances fall towards zero, and rounding left Q without a factor: an error for a fit, on the line."""
    model, ys, start = EXACT[record]
    parts = ("Q", "R") if record == "line" else ("F", "Q", "R", "start")
    fit = expectation_maximisation(model, start, ys, parts, iterations=300)
    assert np.all(np.diff(fit.log_likelihood) >= 0)
    found = run("kalman", fit.model, fit.start, ys)
    assert found.log_likelihood.sum() == pytest.approx(fit.log_likelihood[-1], rel=0.2)
    if "F" in parts or record in {"constant", "line", "nothing", "a batch"}:
        assert not fit.converged or fit.log_likelihood[-1] > 10 * ys.size
        assert np.trace(fit.model.R) < 1e-8


def test_a_fit_says_whether_it_converged() -> None:
    first = LinearModel(ONE, 10_000 * ONE, ONE, 10_000 * ONE)
    assert expectation_maximisation(first, DIFFUSE, FLOW, iterations=2000).converged
    assert not expectation_maximisation(first, DIFFUSE, FLOW, iterations=3).converged
    assert maximum_likelihood(nile, np.log([10_000.0, 10_000.0])).converged
    flat = maximum_likelihood(lambda theta: -float(theta[0] ** 2), np.ones(2))  # nothing says the second
    assert np.isnan(flat.covariance).all()
    assert not flat.converged


def test_one_measurement_leaves_what_leads_to_the_next_open() -> None:
    model, start = LinearModel(ONE, ONE, ONE, ONE), Belief(np.zeros(1), ONE)
    for parts in (("Q",), ("F",)):
        with pytest.raises(FilterError, match="ys: F and Q need at least two measurements"):
            expectation_maximisation(model, start, np.ones((1, 1)), parts)
    assert expectation_maximisation(model, start, np.ones((1, 1)), ("R",), 5).model.R[0, 0] < 1.0
