"""The cubature filter with a smoothing layer, in its recursive and its robust form."""

from collections.abc import Callable

import numpy as np
import pytest

from onboard.filters import cubature, cubature_smooth
from onboard.filters import smooth_variable_structure as svsf
from onboard.filters.belief import Belief
from onboard.filters.smooth_variable_structure import LayerUpdate
from tests.support.filter_problems import near, rows


@pytest.mark.parametrize(
    "update", [cubature_smooth.update, cubature_smooth.update_robust, cubature_smooth.update_adaptive]
)
@pytest.mark.parametrize("m", [1, 2, 4])
def test_within_the_layer_it_is_the_cubature_filter_seed_8(update: Callable[..., LayerUpdate], m: int) -> None:
    H, R, x, P, y = near(8, m)
    found, expected = update(svsf.start(x, P), y, rows(H), R), cubature.update(Belief(x, P), y, rows(H), R)
    assert not found.outside.any()
    for a, b in zip((*svsf.belief(found.belief), *found[1:5]), (*expected.belief, *expected[1:5]), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-10, atol=1e-10)


def test_a_component_outside_is_met_and_the_others_are_filtered_without_it_seed_9() -> None:
    """Dense: K of the others alone, then along G to where the far one is met."""
    H, R, x, P, y = near(9, 2)
    y[1] += 100
    found = cubature_smooth.update(svsf.start(x, P), y, rows(H), R)
    np.testing.assert_array_equal(found.outside, [False, True])
    h = H[:1]
    k = P @ h.T / (h @ P @ h.T + R[:1, :1])
    G = P @ H.T @ np.linalg.inv(H @ P @ H.T)
    step = k[:, 0] * (y[0] - h[0] @ x)
    mean = x + step + G[:, 1] * (y[1] - H[1] @ x - H[1] @ step)
    K = np.column_stack([k[:, 0] - G[:, 1] * (H[1] @ k[:, 0]), G[:, 1]])
    left = np.eye(4) - K @ H
    np.testing.assert_allclose(found.belief.mean, mean, rtol=1e-10)
    np.testing.assert_allclose(found.belief.covariance, left @ P @ left.T + K @ R @ K.T, rtol=1e-9, atol=1e-9)
    assert H[1] @ found.belief.mean == pytest.approx(y[1])


def test_the_robust_form_rejects_two_samples_and_follows_the_third_seed_10() -> None:
    H, R, x, P, y = near(10, 2)
    far = y + np.array([0.0, 1000.0])
    state = svsf.start(x, P)
    for k in range(2):
        alone = cubature.update(svsf.belief(state), y[:1], rows(H[:1]), R[:1, :1])
        update = cubature_smooth.update_robust(state, far, rows(H), R)
        np.testing.assert_array_equal(update.rejected, [False, True])
        np.testing.assert_allclose(update.belief.mean, alone.belief.mean, rtol=1e-10)
        np.testing.assert_allclose(update.belief.covariance, alone.belief.covariance, rtol=1e-10, atol=1e-12)
        np.testing.assert_array_equal(update.belief.updates_outside, [0, k + 1])
        state = update.belief
    followed = cubature_smooth.update_robust(state, far, rows(H), R)
    assert not followed.rejected.any()
    np.testing.assert_array_equal(followed.outside, [False, True])
    # by all of e and gamma of the last residual, which is as large
    assert H[1] @ followed.belief.mean - far[1] == pytest.approx(100, rel=0.01)


def test_patience_of_one_is_the_recursive_form_seed_12() -> None:
    H, R, x, P, y = near(12)
    y[2] += 50
    a = cubature_smooth.update_robust(svsf.start(x, P), y, rows(H), R, patience=1)
    b = cubature_smooth.update(svsf.start(x, P), y, rows(H), R)
    np.testing.assert_array_equal(a.belief.mean, b.belief.mean)
    np.testing.assert_array_equal(a.belief.covariance, b.belief.covariance)
