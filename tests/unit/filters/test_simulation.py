"""Records drawn from a model: moments, consistency of the filter of the same model, and what is refused."""

import numpy as np
import pytest

from onboard.filters import Belief, FilterError, LinearModel, Model, Step, consistency, run, simulate

ONE = np.eye(1)


def test_the_filter_of_the_same_model_is_consistent_seed_1() -> None:
    """With inputs, matrices by step, and a Q and a start that are singular."""
    rng, T, B = np.random.default_rng(1), 20, 300
    F = np.tile([[1.0, 0.5], [0.0, 1.0]], (T - 1, 1, 1)) * rng.uniform(0.9, 1.1, (T - 1, 1, 1))
    G = np.array([[0.125], [0.5]])
    model = LinearModel(F, G @ G.T, np.eye(1, 2), rng.uniform(0.5, 2, (T, 1, 1)), rng.normal(0, 3, (T - 1, 2)))
    start = Belief(np.tile([5.0, 1.0], (B, 1)), np.tile(np.diag([4.0, 0.0]), (B, 1, 1)))
    truth, ys = simulate(model, start, T, rng)
    assert (truth.shape, ys.shape) == ((T, B, 2), (T, B, 1))
    found = run("kalman", model, start, ys)
    assert consistency.nis(found).inside > 0.8
    error = consistency.rms(found, truth, (0,)) ** 2
    np.testing.assert_allclose(error, found.beliefs.covariance[:, 0, 0, 0], rtol=0.3)
    assert truth[0, :, 1].std() == 0.0


def test_one_record_at_uneven_times_with_sensors_in_turn_seed_2() -> None:
    def at(step: Step) -> Model:
        m, dt = 1 + step.k % 2, np.nan_to_num(step.dt)
        return Model(
            lambda r: r + dt, 0.01 * dt * np.eye(2), lambda r: r[:, :m].copy(), 1e-6 * np.eye(m), angular=(0,)
        )

    ts = [0.0, 1.0, 1.0, 4.0]
    start = Belief(np.array([3.0, 0.0]), 1e-6 * np.eye(2))
    truth, ys = simulate(at, start, ts, np.random.default_rng(2))
    assert [len(y) for y in ys] == [1, 2, 1, 2]
    np.testing.assert_array_equal(truth[1], truth[2])  # nothing moves where a time repeats
    off = np.array([ys[k][0] - truth[k, 0] for k in range(4)])
    assert np.abs(np.angle(np.exp(1j * off))).max() < 0.01
    assert all(abs(y[0]) <= np.pi for y in ys)
    again = simulate(at, start, ts, np.random.default_rng(2))
    np.testing.assert_array_equal(truth, again.truth)
    assert len(run("unscented", at, start, ys, ts).ts) == 4


def test_misuse_is_refused() -> None:
    rng = np.random.default_rng(3)
    start, model = Belief(np.zeros(1), np.eye(1)), LinearModel(ONE, ONE, ONE, ONE)
    both = Model((np.copy, np.copy), ONE, np.copy, ONE)
    wrong = [
        ((model, start, 0), "ts: must be times"),
        ((model, start, [1.0, 0.0]), "ts: must be times that do not decrease"),
        ((model._replace(inputs=np.zeros((4, 1))), start, 3), "inputs: must be finite"),
        ((both, Belief(np.zeros(1), ONE), 3), "model: has several modes"),
        ((model._replace(R=-ONE), start, 3), "R: "),
    ]
    for arguments, message in wrong:
        with pytest.raises(FilterError, match=message):
            simulate(*arguments, rng)
