"""Whole records: the compiled loop, missing measurements, changing models, and what is refused."""

from typing import Any

import numpy as np
import pytest

from onboard.arrays import Array
from onboard.filters import (
    Belief,
    FilterError,
    LinearModel,
    Model,
    Step,
    extended,
    kalman,
    log_likelihood,
    methods,
    multiple_model,
    run,
    unscented,
)
from onboard.filters.belief import Method
from tests.conformance.problems import cases
from tests.support.filter_problems import spd
from tests.support.nile import FLOW

ONE = np.eye(1)
N, M, T, B = 3, 2, 12, 4
EVERY = pytest.mark.parametrize("method", cases(methods()))


def problem(seed: int) -> tuple[LinearModel, Belief, Array]:
    """A model, a first belief, and measurements (T, B, m), every third component of which is missing."""
    rng = np.random.default_rng(seed)
    F = np.eye(N) + 0.1 * rng.normal(0, 1, (N, N))
    model = LinearModel(F, 0.1 * spd(rng, N), rng.normal(0, 1, (M, N)), spd(rng, M), rng.normal(0, 1, (T - 1, N)))
    ys = rng.normal(0, 2, (T, B, M))
    ys[rng.random(ys.shape) < 0.3] = np.nan
    ys[5] = np.nan
    return model, Belief(rng.normal(0, 1, (B, N)), np.stack([spd(rng, N) for _ in range(B)])), ys


def by_hand(model: LinearModel, start: Belief, ys: Array) -> tuple[list[Belief], list[float]]:
    """Predict and update of the textbook, for one filter, by the rows of H and R that are measured."""
    belief, beliefs, logs = start, [], []
    assert model.inputs is not None
    for k, y in enumerate(ys):
        if k:
            moved = kalman.predict(belief, model.F, model.Q)
            belief = Belief(moved.mean + model.inputs[k - 1], moved.covariance)
        seen = np.flatnonzero(~np.isnan(y))
        logs.append(0.0)
        if len(seen):
            S = model.H[seen] @ belief.covariance @ model.H[seen].T + model.R[np.ix_(seen, seen)]
            e = y[seen] - model.H[seen] @ belief.mean
            logs[-1] = -0.5 * float(e @ np.linalg.solve(S, e) + np.log(np.linalg.det(2 * np.pi * S)))
            belief = kalman.update(belief, y[seen], model.H[seen], model.R[np.ix_(seen, seen)]).belief
        beliefs.append(belief)
    return beliefs, logs


def test_the_nile_s_log_likelihood_is_that_of_durbin_and_koopman() -> None:
    model = LinearModel(ONE, 1469.1 * ONE, ONE, 15099.0 * ONE)
    found = run("kalman", model, Belief(np.zeros(1), 1e7 * ONE), FLOW)
    assert found.log_likelihood.sum() == pytest.approx(-641.5856, abs=1e-4)
    assert found.beliefs.mean[-1, 0] == pytest.approx(798.3703, abs=1e-4)
    assert found.beliefs.covariance[-1, 0, 0] == pytest.approx(4032.1579, abs=1e-4)


@EVERY
def test_each_filter_takes_a_batch_of_which_each_member_misses_something_else_seed_1(method: Method) -> None:
    model, start, ys = problem(1)
    if "partial" in method.exempt:
        with pytest.raises(FilterError, match=r"ys\[0\], t = 0: y: .* takes no partial measurement"):
            run(method, model, start, ys)
        ys[np.isnan(ys)] = 0.0
        ys[5] = np.nan
    together = run(method, model, start, ys)
    assert np.isfinite(together.log_likelihood).all()
    np.testing.assert_array_equal(together.degrees, np.sum(~np.isnan(ys), axis=-1))
    np.testing.assert_array_equal(np.isnan(together.innovation), np.isnan(ys))
    for b in range(B):
        alone = run(method, model, Belief(start.mean[b], start.covariance[b]), ys[:, b])
        np.testing.assert_allclose(alone.beliefs.mean, together.beliefs.mean[:, b], rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(alone.log_likelihood, together.log_likelihood[:, b], rtol=1e-9, atol=1e-9)
        if "kalman" in method.exempt:
            continue
        beliefs, logs = by_hand(model, Belief(start.mean[b], start.covariance[b]), ys[:, b])
        np.testing.assert_allclose(alone.beliefs.mean, [each.mean for each in beliefs], rtol=1e-8, atol=1e-8)
        np.testing.assert_allclose(alone.beliefs.covariance, [each.covariance for each in beliefs], atol=1e-8)
        np.testing.assert_allclose(alone.log_likelihood, logs, rtol=1e-8, atol=1e-8)


def test_the_compiled_loop_keeps_single_precision_seed_2() -> None:
    model, start, ys = problem(2)
    single = LinearModel(*(a.astype(np.float32) for a in model[:5]))
    found = run("kalman", single, Belief(*(a.astype(np.float32) for a in start)), ys.astype(np.float32))
    double = run("kalman", model, start, ys)
    assert found.beliefs.covariance.dtype == np.float32
    np.testing.assert_allclose(found.beliefs.mean, double.beliefs.mean, rtol=1e-4, atol=1e-4)


def test_a_masked_array_and_none_are_missing_seed_3() -> None:
    model, start, ys = problem(3)
    start, ys = Belief(start.mean[0], start.covariance[0]), ys[:, 0]
    want = run("kalman", model, start, ys)
    masked = np.ma.masked_array(np.where(np.isnan(ys), 7.0, ys), np.isnan(ys))
    listed = [None if np.isnan(y).all() else y for y in ys]
    for given in (masked, listed, [*masked]):
        np.testing.assert_array_equal(run("kalman", model, start, given).beliefs.mean, want.beliefs.mean)


def test_a_model_of_the_step_has_its_time_and_measures_what_it_will_seed_4() -> None:
    """Uneven times, and two sensors of different size: as predict and update of the same."""
    rng = np.random.default_rng(4)
    ts = np.array([0.0, 0.5, 2.0, 2.0, 5.0])
    ys = [rng.normal(0, 1, 1 + k % 2) for k in range(5)]
    steps: list[Step] = []

    def process(dt: float) -> Any:
        return lambda rows: np.stack([rows[:, 0] + dt * np.sin(rows[:, 1]), rows[:, 1]], 1)

    def at(step: Step) -> Model:
        steps.append(step)
        m = 1 + step.k % 2
        return Model(process(step.dt), step.dt * np.eye(2), lambda rows: rows[:, :m] ** 2, np.eye(m))

    start = Belief(np.array([1.0, 0.5]), np.eye(2))
    found = run("unscented", at, start, ys, ts)
    assert [(step.k, step.t) for step in steps] == [*enumerate(ts)]
    belief, weights = start, unscented.julier_weights(2)
    for k, y in enumerate(ys):
        if k and ts[k] > ts[k - 1]:
            dt = ts[k] - ts[k - 1]
            belief = unscented.predict(belief, process(dt), dt * np.eye(2), weights)
        update = unscented.update(belief, y, at(Step(k, 0.0, 1.0)).measure, np.eye(len(y)), weights)
        belief = update.belief
        np.testing.assert_array_equal(found.beliefs.mean[k], belief.mean)
        assert found.log_likelihood[k] == pytest.approx(log_likelihood(update), rel=1e-12)
    assert found.innovation.shape == (5, 2)
    np.testing.assert_array_equal(found.degrees, [1, 2, 1, 2, 1])


def test_late_measurements_in_the_order_of_their_times_seed_5() -> None:
    model, start, ys = problem(5)
    model, start, ys = model._replace(inputs=None), Belief(start.mean[0], start.covariance[0]), ys[:, 0]
    ts = np.arange(float(T))
    ts[[3, 4]] = ts[[4, 3]]
    with pytest.raises(FilterError, match=r"ts\[4\] = 3 is before ts\[3\] = 4: put the record in the order"):
        run("kalman", model, start, ys, ts)
    order = np.argsort(ts, kind="stable")
    late = run("extended", model, start, ys[order], ts[order])
    np.testing.assert_allclose(late.beliefs.mean[5], run("kalman", model, start, ys[order]).beliefs.mean[5])


def test_modes_with_a_model_each_and_their_mixture_s_likelihood_seed_6() -> None:
    rng = np.random.default_rng(6)
    transition = np.array([[0.9, 0.1], [0.3, 0.7]])
    slow, fast = 0.01 * np.eye(1), 4.0 * np.eye(1)
    imm = multiple_model.interacting("two", [methods()["kalman"]] * 2, transition, np.array([0.6, 0.4]))
    model = Model((lambda rows: rows, lambda rows: 0.5 * rows), (slow, fast), lambda rows: rows.copy(), np.eye(1))
    found = run(imm, model, Belief(np.zeros(1), np.eye(1)), rng.normal(0, 1, (2, 1)))
    # the second measurement's density, by hand: mixed, predicted and weighed
    y0, y1 = found.innovation[0, 0], found.innovation[1, 0] + found.predicted[1, 0]
    after = y0 / 2, 0.5  # both modes alike
    ahead = np.array([0.6, 0.4]) @ transition
    each = [(after[0], after[1] + 0.01), (0.5 * after[0], 0.25 * after[1] + 4.0)]
    density = sum(
        p * np.exp(-0.5 * (y1 - m) ** 2 / (v + 1)) / np.sqrt(2 * np.pi * (v + 1))
        for p, (m, v) in zip(ahead, each, strict=True)
    )
    assert found.log_likelihood[1] == pytest.approx(np.log(density), rel=1e-12)


def test_what_does_not_fit_is_refused_and_where() -> None:
    model, start, ys = LinearModel(ONE, ONE, ONE, ONE), Belief(np.zeros(1), ONE), np.zeros((3, 1))
    bad = Model(lambda rows: rows * np.nan, ONE, lambda rows: rows.copy(), ONE)
    wrong: list[tuple[Any, str]] = [
        (("kalman", model, start, np.zeros((3, 1, 1))), r"ys\[0\]: has shape \(1, 1\); ys must be \(T, m\)"),
        (("kalman", model, start, []), "ys: has no measurement"),
        (("kalman", model, start, ys, [0.0, 1.0]), "ts: must be 3 finite times"),
        (("kalman", model, start, ys, [0.0, 1.0, 1.0]), "ts: must increase for a LinearModel"),
        (("kalman", model._replace(F=np.eye(2)), start, ys), r"F: must be finite and \(1, 1\), or \(2, 1, 1\)"),
        (("kalman", model, start, np.full((3, 1), np.inf)), r"ys\[0\], t = 0: y: not finite"),
        (("kalman", model._replace(R=-ONE), start, ys), r"ys\[0\], t = 0: "),
        (("unscented", bad, start, ys), r"ys\[1\], t = 1: process: gave states"),
        (("unscented", model, Belief(np.zeros(1), np.eye(2)), ys), "mean"),
    ]
    for arguments, message in wrong:
        with pytest.raises(FilterError, match=message):
            run(*arguments)
    with pytest.raises(KeyError, match="no filter named 'kalmann'"):
        run("kalmann", model, start, ys)
    one = run("kalman", model, start, ys[:1])  # nothing leads anywhere
    np.testing.assert_allclose(one.beliefs.covariance, [[[0.5]]])
    assert extended.METHODS[0].name == run("extended", model, start, ys).method.name
