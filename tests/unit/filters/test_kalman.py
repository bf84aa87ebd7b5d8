"""Kalman, extended and cubature filters and posterior linearisation against textbook formulas in plain NumPy."""

from typing import Any

import numpy as np
import pytest

from onboard.filters import cubature, extended, kalman, posterior_linearisation, unscented
from onboard.filters.belief import Belief, FilterError, Update
from tests.support.filter_problems import bend, bend_slope, radar, spd

N, M = 5, 2


def problem(seed: int, lead: tuple[int, ...] = ()) -> dict[str, Any]:
    """F, H, Q, R, y and a belief; read-only, so that a filter that writes into them is caught."""
    rng = np.random.default_rng(seed)
    made = {
        "F": np.eye(N) + 0.2 * rng.normal(0, 1, (N, N)),
        "H": rng.normal(0, 1, (M, N)),
        "Q": spd(rng, N),
        "R": spd(rng, M),
        "mean": rng.normal(0, 3, (*lead, N)) + 40 * np.eye(N)[0],  # so far off that its bearing is known
        "P": spd(rng, N, lead),
        "y": rng.normal(0, 3, (*lead, M)),
    }
    for array in made.values():
        array.flags.writeable = False
    return made


def textbook(p: dict[str, Any]) -> tuple[Any, Any, Any, Any, float]:
    x, P = p["F"] @ p["mean"], p["F"] @ p["P"] @ p["F"].T + p["Q"]
    e = p["y"] - p["H"] @ x
    S = p["H"] @ P @ p["H"].T + p["R"]
    K = P @ p["H"].T @ np.linalg.inv(S)
    return x + K @ e, P - K @ S @ K.T, e, S, float(e @ np.linalg.inv(S) @ e)


def same(got: Update, want: tuple[Any, Any, Any, Any, float], rtol: float = 1e-10) -> None:
    for a, b in zip([*got.belief, got.innovation, got.innovation_covariance, got.nis], want, strict=True):
        np.testing.assert_allclose(a, b, rtol=rtol, atol=rtol)


def test_kalman_is_the_textbook_seed_1() -> None:
    p = problem(1)
    prior = kalman.predict(Belief(p["mean"], p["P"]), p["F"], p["Q"])
    update = kalman.update(prior, p["y"], p["H"], p["R"])
    same(update, textbook(p))
    assert np.array_equal(update.belief.covariance, update.belief.covariance.T)


def test_an_offset_of_the_model_moves_the_mean_and_not_the_covariance_seed_14() -> None:
    """The method finds the matrices of an affine model, whose value at the origin is not zero."""
    p, method, offset = problem(14), kalman.METHODS[0], np.array([5.0, -3.0, 2.0, 7.0, 1.0])
    prior = method.predict(Belief(p["mean"], p["P"]), lambda rows: rows @ p["F"].T + offset, p["Q"])
    np.testing.assert_allclose(prior.mean, p["F"] @ p["mean"] + offset)
    np.testing.assert_allclose(prior.covariance, p["F"] @ p["P"] @ p["F"].T + p["Q"])
    shifted = p | {"F": np.eye(N), "Q": np.zeros((N, N)), "mean": prior.mean, "P": prior.covariance}
    update = method.update(prior, p["y"] + offset[:M], lambda rows: rows @ p["H"].T + offset[:M], p["R"], ())
    same(update, textbook(shifted))


def test_kalman_broadcasts_over_two_leading_axes_seed_2() -> None:
    p = problem(2, (3, 4))
    prior = kalman.predict(Belief(p["mean"], p["P"]), p["F"], p["Q"])
    update = kalman.update(prior, p["y"], p["H"], p["R"])
    assert update.belief.covariance.shape == (3, 4, N, N)
    assert update.nis.shape == (3, 4)
    for index in np.ndindex(3, 4):
        one = p | {name: p[name][index] for name in ("mean", "P", "y")}
        got = Update(Belief(*(a[index] for a in update.belief)), *(np.asarray(a)[index] for a in update[1:5]))
        same(got, textbook(one))


def test_a_considered_state_keeps_mean_and_variance_and_costs_the_rest_seed_4() -> None:
    p = problem(4)
    prior = Belief(p["mean"], p["P"])
    free, held = (kalman.update(prior, p["y"], p["H"], p["R"], considered).belief for considered in ((), (1,)))
    assert held.mean[1] == prior.mean[1]
    assert held.covariance[1, 1] == pytest.approx(prior.covariance[1, 1], rel=1e-14)
    # its covariance with the others: (I - K H) P with a gain without its row
    S = p["H"] @ p["P"] @ p["H"].T + p["R"]
    K = p["P"] @ p["H"].T @ np.linalg.inv(S)
    K[1] = 0
    G = np.eye(N) - K @ p["H"]
    np.testing.assert_allclose(held.covariance, G @ p["P"] @ G.T + K @ p["R"] @ K.T, rtol=1e-10, atol=1e-10)
    assert np.linalg.eigvalsh(held.covariance - free.covariance).min() > -1e-12  # the free gain is the best one
    both = unscented.update(
        prior, p["y"], lambda rows: rows @ p["H"].T, p["R"], cubature.weights(N), considered=(1,)
    ).belief
    np.testing.assert_allclose(held.covariance, both.covariance, rtol=1e-10, atol=1e-10)


def test_extended_is_the_textbook_with_jacobians_and_with_differences_seed_7() -> None:
    p = problem(7)
    belief = Belief(p["mean"], p["P"])
    F = bend_slope(p["mean"][None])[0]
    given = extended.predict(belief, bend, p["Q"], bend_slope)
    np.testing.assert_allclose(given.mean, bend(p["mean"][None])[0], rtol=1e-14)
    np.testing.assert_allclose(given.covariance, F @ p["P"] @ F.T + p["Q"], rtol=1e-12, atol=1e-12)
    differences = extended.predict(belief, bend, p["Q"])
    np.testing.assert_allclose(differences.covariance, given.covariance, rtol=1e-7, atol=1e-7)
    assert np.array_equal(differences.covariance, differences.covariance.T)


def test_differences_step_over_large_coordinates_and_over_the_cut_of_an_angle() -> None:
    mean = np.array([-4e6, -5e6])  # earth-centred, known to a centimetre
    value, slope = extended.tangent(Belief(mean, np.diag([1e-4, 1e-4])), radar, None, np.zeros(2), (1,))
    r = np.hypot(*mean)
    np.testing.assert_allclose(slope[0], mean / r, rtol=1e-6)
    np.testing.assert_allclose(value, [r, np.arctan2(*mean[::-1])], rtol=1e-15)
    behind = Belief(np.array([-10.0, 0.0]), np.eye(2))
    np.testing.assert_allclose(
        extended.tangent(behind, radar, None, np.zeros(2), (1,))[1], [[-1, 0], [0, -0.1]], rtol=1e-7, atol=1e-7
    )


def test_a_bearing_behind_wraps_seed_10() -> None:
    p = problem(10)
    belief = Belief(np.array([-10.0, 0.02, 0, 0, 0]), 0.01 * np.eye(N))
    y, R = np.array([10.0, -np.pi + 0.001]), np.diag([1e-2, 1e-4])
    for update in (extended.update, cubature.update, posterior_linearisation.update):
        found = update(belief, y, radar, R, (1,))
        assert found.innovation[1] == pytest.approx(0.003, abs=2e-4)
        assert -0.05 < found.belief.mean[1] < 0.02
    assert p  # the seed only names the problem


def test_posterior_linearisation_acquires_from_far_seed_13() -> None:
    """A target 20 km away known to 1 km, seen to 1 m and .2 mrad."""
    rng = np.random.default_rng(13)
    R, P = np.diag([1.0, 4e-8]), np.diag([1e6, 1e6])
    errors: dict[str, list[float]] = {"unscented": [], "iterated": []}
    nees = []
    for _ in range(40):
        truth = np.array([20e3, 5e3])
        prior = Belief(truth + 1e3 * rng.normal(0, 1, 2), P)
        y = radar(truth[None])[0] + np.sqrt(np.diag(R)) * rng.normal(0, 1, 2)
        once = unscented.update(prior, y, radar, R, cubature.weights(2), (1,)).belief
        often = posterior_linearisation.update(prior, y, radar, R, (1,)).belief
        errors["unscented"].append(float(np.linalg.norm(once.mean - truth)))
        errors["iterated"].append(float(np.linalg.norm(often.mean - truth)))
        nees.append((often.mean - truth) @ np.linalg.solve(often.covariance, often.mean - truth))
    assert np.median(errors["iterated"]) < 6  # 1 m and 20 km x .2 mrad = 4 m
    assert np.median(errors["unscented"]) > 3 * np.median(errors["iterated"])
    assert 1.1 < np.mean(nees) < 3.2  # 2, +- 3 sigma of 40


def test_matrices_that_cannot_be_used_are_refused_by_name() -> None:
    belief = Belief(np.ones(2), np.eye(2))
    for F, Q, name in (
        (np.full((2, 2), np.inf), np.eye(2), "F"),
        (np.eye(3), np.eye(2), "F"),
        (np.eye(2), np.eye(3), "Q"),
        (np.eye(2), np.full((2, 2), np.nan), "Q"),
    ):
        with pytest.raises(FilterError, match=rf"\b{name}\b"):
            kalman.predict(belief, F, Q)
    with pytest.raises(FilterError, match=r"\bQ \(3, 2, 2\)"):  # four beliefs, three Qs
        kalman.predict(Belief(np.ones((4, 2)), np.tile(np.eye(2), (4, 1, 1))), np.eye(2), np.ones((3, 2, 2)))
    with pytest.raises(FilterError, match=r"\bH\b"):
        kalman.update(belief, np.ones(1), np.array([[np.nan, 1.0]]), np.eye(1))
    with pytest.raises(FilterError, match="iterations"):
        posterior_linearisation.update(belief, np.ones(2), lambda rows: rows, np.eye(2), iterations=0)
    assert np.array_equal(kalman.predict(belief, np.eye(2), np.zeros((2, 2))).covariance, np.eye(2))
