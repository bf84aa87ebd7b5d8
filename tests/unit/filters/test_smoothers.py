"""Smoothing of whole runs: every Gaussian family is the linear one's on a linear model; fixed lag; modes."""

import numpy as np
import pytest

from onboard.arrays import Array
from onboard.filters import (
    Belief,
    FilterError,
    LinearModel,
    Model,
    Step,
    method,
    methods,
    multiple_model,
    run,
    smooth,
    smooth_modes,
    smoothing,
)
from onboard.filters.belief import Method
from tests.conformance.problems import cases
from tests.support.filter_problems import spd

N, T, B = 3, 14, 3
GAUSSIAN = {name: one for name, one in methods().items() if "kalman" not in one.exempt and name != "imm"}
OTHERS = {name: one for name, one in methods().items() if "kalman" in one.exempt}


def problem(seed: int) -> tuple[LinearModel, Belief, Array]:
    rng = np.random.default_rng(seed)
    F = np.eye(N) + 0.1 * rng.normal(0, 1, (N, N))
    model = LinearModel(F, 0.1 * spd(rng, N), rng.normal(0, 1, (1, N)), np.eye(1), rng.normal(0, 1, (T - 1, N)))
    ys = rng.normal(0, 2, (T, B, 1))
    ys[3:6, 1] = np.nan
    return model, Belief(rng.normal(0, 1, (B, N)), np.stack([spd(rng, N) for _ in range(B)])), ys


def close(got: Belief, want: Belief) -> None:
    np.testing.assert_allclose(got.mean, want.mean, rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(got.covariance, want.covariance, rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize("one", cases(GAUSSIAN))
def test_each_gaussian_family_smooths_a_linear_record_as_rauch_tung_and_striebel_do_seed_1(one: Method) -> None:
    model, start, ys = problem(1)
    found = run(one, model, start, ys)
    inputs = np.tile(np.asarray(model.inputs)[:, None], (1, B, 1))
    want = smoothing.rauch_tung_striebel(found.beliefs, model.F, model.Q, inputs)
    close(smooth(found), want)
    close(smooth(run(one, lambda step: model.at(step.k), start, ys)), want)
    constant = Model(lambda rows: rows @ model.F.T, model.Q, lambda rows: rows @ model.H.T, model.R)
    found = run(one, constant, start, ys)
    close(smooth(found), smoothing.rauch_tung_striebel(found.beliefs, model.F, model.Q))


@pytest.mark.parametrize("one", cases(OTHERS))
def test_a_filter_whose_covariance_is_not_the_optimal_one_is_not_smoothed(one: Method) -> None:
    state = Belief(np.zeros((2, 1)), np.ones((2, 1, 1)))
    model = LinearModel(*[np.eye(1)] * 4)
    found = run("kalman", model, Belief(np.zeros(1), np.eye(1)), np.zeros((2, 1)))._replace(
        beliefs=state, method=one
    )
    with pytest.raises(FilterError, match=f"{one.name} cannot be smoothed by its covariance: "):
        smooth(found)


@pytest.mark.parametrize("lag", [1, 4, T - 2])
def test_a_fixed_lag_is_the_smoother_of_the_record_until_then_seed_2(lag: int) -> None:
    model, start, ys = problem(2)
    assert model.inputs is not None
    delayed = smooth(run("kalman", model, start, ys), lag=lag)
    for k in range(T):
        end = min(T, k + lag + 1)
        until = run("kalman", model._replace(inputs=model.inputs[: end - 1]), start, ys[:end])
        close(Belief(delayed.mean[k], delayed.covariance[k]), Belief(*(a[k] for a in smooth(until))))
    alone = smooth(run("kalman", model, Belief(*(a[1] for a in start)), ys[:, 1]), lag=lag)
    close(alone, Belief(delayed.mean[:, 1], delayed.covariance[:, 1]))


def test_a_lag_of_nothing_is_the_filter_and_of_all_the_smoother_seed_3() -> None:
    model, start, ys = problem(3)
    found = run("kalman", model, start, ys)
    assert smooth(found, lag=0) is found.beliefs
    close(smooth(found, lag=T), smooth(found))
    with pytest.raises(FilterError, match="lag: must be 0 or more"):
        smooth(found, lag=-1)


def test_where_a_time_repeats_the_state_stays_seed_4() -> None:
    """Two measurements of one time, one after the other, are both at once."""
    rng = np.random.default_rng(4)
    ys, start = rng.normal(0, 1, (3, 2)), Belief(np.zeros(2), np.eye(2))
    F, Q = np.array([[1.0, 1.0], [0.0, 1.0]]), 0.1 * np.eye(2)

    def at(step: Step) -> Model:
        row = np.eye(2)[step.k % 2]
        return Model(lambda rows: rows @ F.T, Q, lambda rows: rows @ row[:, None], np.eye(1))

    both = smooth(run("kalman", LinearModel(F, Q, np.eye(2), np.eye(2)), start, ys))
    ts = np.repeat(np.arange(3.0), 2)
    apart = smooth(run("cubature", at, start, ys.reshape(6, 1), ts))
    close(Belief(apart.mean[::2], apart.covariance[::2]), both)
    close(Belief(apart.mean[1::2], apart.covariance[1::2]), both)


def test_two_equal_modes_are_one_smoother_seed_5() -> None:
    model, start, ys = problem(5)
    transition = np.array([[0.9, 0.1], [0.2, 0.8]])
    imm = multiple_model.interacting("two", [method("kalman")] * 2, transition)
    found = smooth_modes(run(imm, model, start, ys), [method("kalman")] * 2, transition)
    close(Belief(*found[:2]), smooth(run("kalman", model, start, ys)))
    np.testing.assert_allclose(found.probabilities.sum(axis=-1), 1.0)
    with pytest.raises(FilterError, match="takes one filter; that of several modes has `smooth_modes`"):
        smooth(run(imm, model, start, ys))
    with pytest.raises(FilterError, match="kalman has no modes"):
        smooth_modes(run("kalman", model, start, ys), [], transition)


def test_smoothed_modes_know_a_manoeuvre_better_and_earlier_seed_6() -> None:
    """A jump Markov system, 300 runs: smaller errors, the right mode more probable, and no more certain than it
    is."""
    rng, runs, steps = np.random.default_rng(6), 300, 40
    F, L = np.array([[1.0, 1.0], [0.0, 1.0]]), np.array([0.5, 1.0])
    noises = (0.01**2 * np.outer(L, L) + 1e-6 * np.eye(2), 1.0 * np.outer(L, L) + 1e-6 * np.eye(2))
    transition = np.array([[0.95, 0.05], [0.15, 0.85]])
    x, mode = rng.normal(0, 1, (runs, 2)), np.zeros(runs, int)
    truth, modes, ys = [], [], []
    for k in range(steps):
        if k:
            mode = (rng.random(runs) < transition[mode, 1]).astype(int)
            x = x @ F.T + np.where(mode, 1.0, 0.01)[:, None] * L * rng.normal(0, 1, (runs, 1))
        truth.append(x)
        modes.append(mode)
        ys.append(x[:, :1] + rng.normal(0, 0.5, (runs, 1)))
    two = [method("kalman")] * 2
    imm = multiple_model.interacting("two", two, transition, np.array([1.0, 0.0]))
    move = lambda rows: rows @ F.T  # noqa: E731
    model = Model(move, noises, lambda rows: rows[:, :1], 0.25 * np.eye(1))
    found = run(imm, model, Belief(np.zeros((runs, 2)), np.tile(np.eye(2), (runs, 1, 1))), np.stack(ys))
    smoothed, states = smooth_modes(found, two, transition), np.stack(truth)
    errors = {name: b.mean - states for name, b in (("filter", found.beliefs), ("smoother", smoothed))}
    rms = {name: np.sqrt(np.mean(e[5:-5] ** 2, axis=(0, 1))) for name, e in errors.items()}
    assert np.all(rms["smoother"] < 0.65 * rms["filter"]), rms
    filtered = np.stack([state.probabilities for state in found.states])
    right = [
        np.mean(np.take_along_axis(p, np.stack(modes)[..., None], -1)) for p in (filtered, smoothed.probabilities)
    ]
    assert right[1] > right[0] + 0.09, right
    e = errors["smoother"][5:-5]
    nees = np.mean(np.einsum("tbi,tbi->tb", e, np.linalg.solve(smoothed.covariance[5:-5], e[..., None])[..., 0]))
    assert 1.6 < nees < 2.4, nees
