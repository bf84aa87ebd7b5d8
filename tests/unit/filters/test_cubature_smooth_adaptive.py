"""The adaptive cubature SVSF: innovations that keep to one side are followed, or if small widen the belief."""

from functools import partial
from typing import Any

import numpy as np
import pytest

from onboard.filters import cubature, cubature_smooth
from onboard.filters import smooth_variable_structure as svsf
from onboard.filters.belief import Belief
from tests.support.filter_problems import identity, near, rows


@pytest.mark.parametrize("m", [1, 2, 4])
def test_innovations_on_one_side_widen_the_prior_seed_15(m: int) -> None:
    """Dense: P + G D G^T, G = P H^T (H P H^T)^-1, then the Kalman filter; D only of quantities beyond the limit. A
    smaller mean that lasts is in the model's error."""
    H, R, x, P, y = near(15, m)
    w = np.zeros(m)
    w[0] = 0.4
    slow = np.full(m, 0.3)
    state = svsf.start(x, P)._replace(
        residual=np.zeros(m), updates_outside=np.zeros(m), switching=w, slow_switching=slow
    )
    found = cubature_smooth.update_adaptive(state, y, rows(H), R)
    e, HPH = y - H @ x, H @ P @ H.T
    psi = 5 * np.sqrt(np.diag(HPH + R))
    w = 0.9 * w + 0.1 * e / psi
    np.testing.assert_allclose(found.belief.switching, w, rtol=1e-12)
    G = P @ H.T @ np.linalg.inv(HPH)
    wide = P + G @ np.diag(np.where(np.arange(m) == 0, (w * psi) ** 2, 0)) @ G.T
    slow = 0.98 * slow + 0.02 * e / psi
    widened = np.where((np.arange(m) > 0) & (np.abs(slow) > 0.4 * np.sqrt(0.02 / 1.98)), (slow * psi) ** 2, 0)
    np.testing.assert_allclose(found.belief.model_error, G @ np.diag(widened) @ G.T, rtol=1e-8, atol=1e-12)
    expected = cubature.update(Belief(x, wide), y, rows(H), R)
    np.testing.assert_allclose(found.belief.mean, expected.belief.mean, rtol=1e-9)
    np.testing.assert_allclose(found.belief.covariance, expected.belief.covariance, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(found.layer, 5 * np.sqrt(np.diag(expected.innovation_covariance)), rtol=1e-9)
    np.testing.assert_allclose(found.innovation_covariance, HPH + R, rtol=1e-9)


def test_a_second_sensor_of_one_quantity_widens_it_too() -> None:
    H = np.array([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    state = svsf.start(np.zeros(2), np.eye(2))
    zeros = np.zeros(3)
    biased = state._replace(
        residual=zeros, updates_outside=zeros, switching=np.array([0.5, 0.5, 0.0]), slow_switching=zeros
    )
    update: Any = partial(cubature_smooth.update_adaptive, y=np.ones(3), measure=rows(H), R=np.eye(3))
    still, moved = (update(s).belief.mean for s in (state, biased))
    assert moved[0] > still[0] + 0.1
    assert moved[1] == pytest.approx(still[1])


def test_an_outlier_is_rejected_and_a_drift_is_followed_seed_16() -> None:
    """A level that the model holds for constant: one sample 20 deviations off, then a deviation a step."""
    rng, Q, R = np.random.default_rng(16), np.array([[1e-4]]), np.eye(1)
    truth = np.concatenate([np.zeros(200), np.arange(100.0)])
    seen = truth + rng.normal(0, 1, 300)
    seen[150] += 20
    means = {}
    for update in (cubature_smooth.update_robust, cubature_smooth.update_adaptive):
        state, found = svsf.start(np.zeros(1), np.eye(1)), []
        for k, y in enumerate(seen):
            answer = update(svsf.predict(state, identity, Q), np.array([y]), identity, R)
            state = answer.belief
            assert answer.rejected[0] or k != 150
            found.append(state.mean[0])
        means[update.__name__] = np.array(found)
    robust, adaptive = means["update_robust"], means["update_adaptive"]
    np.testing.assert_array_equal(adaptive[:200], robust[:200])  # white innovations and one outlier: no difference
    lag = np.sqrt(np.mean((adaptive[-50:] - truth[-50:]) ** 2))
    assert lag < 1.6
    assert lag < 0.6 * np.sqrt(np.mean((robust[-50:] - truth[-50:]) ** 2))


def test_a_small_lasting_error_widens_the_belief_and_is_not_followed_seed_9() -> None:
    """A drift too small to be followed: the mean stays the robust form's, the covariance does not."""
    rng = np.random.default_rng(9)
    Q, R, drift = np.diag([1e-4]), np.diag([1.0]), 0.004
    truth, robust = 0.0, cubature_smooth.start(np.zeros(1), np.eye(1))
    adaptive, errors, variances, kept = robust, [], [], []
    for k in range(3000):
        truth += drift + 0.01 * rng.standard_normal()
        y = np.array([truth + rng.standard_normal()])
        for name in ("robust", "adaptive"):
            state = robust if name == "robust" else adaptive
            state = cubature_smooth.predict(state, lambda rows: rows, Q)
            update = getattr(cubature_smooth, f"update_{name}")(state, y, lambda rows: rows, R)
            if name == "robust":
                robust = update.belief
            else:
                adaptive = update.belief
        if k > 500:
            errors.append(adaptive.mean[0] - truth)
            variances.append(cubature_smooth.belief(adaptive).covariance[0, 0])
            kept.append(adaptive.covariance[0, 0])
    np.testing.assert_allclose(adaptive.mean, robust.mean, atol=0.05)
    squares = np.square(errors)
    assert np.mean(squares / kept) > 10.0
    assert np.mean(squares / variances) < 4.0


def test_without_error_the_belief_is_hardly_ever_widened_seed_10() -> None:
    rng = np.random.default_rng(10)
    Q, R, truth = np.diag([1e-4]), np.diag([1.0]), 0.0
    state, widened = cubature_smooth.start(np.zeros(1), np.eye(1)), []
    for _ in range(4000):
        truth += 0.01 * rng.standard_normal()
        state = cubature_smooth.predict(state, lambda rows: rows, Q)
        y = np.array([truth + rng.standard_normal()])
        state = cubature_smooth.update_adaptive(state, y, lambda rows: rows, R).belief
        widened.append(state.model_error[0, 0] > 0.0)
    assert np.mean(widened) < 0.08
