"""The misprints of the paper on the cubature SVSF: what goes wrong as printed, and not with the right forms."""

import numpy as np

from onboard.filters import cubature_smooth
from onboard.filters import smooth_variable_structure as svsf
from onboard.filters.belief import Method
from tests.support.filter_problems import identity, rows

METHODS: dict[str, Method] = {m.name: m for m in (*svsf.METHODS, *cubature_smooth.METHODS)}


def test_eq_2_3_3_as_printed_is_no_number_where_the_innovation_is_zero() -> None:
    e, psi = np.array([0.0, 1.0]), np.array([2.0, 2.0])
    with np.errstate(invalid="ignore", divide="ignore"):
        printed = (np.abs(e) * np.clip(e / psi, -1, 1)) / e
    assert np.isnan(printed[0])
    for name, method in METHODS.items():
        after = method.update(method.start(np.zeros(2), np.eye(2)), e, identity, np.eye(2), ())
        assert np.isfinite(method.belief(after.belief).mean).all(), name
        assert np.isfinite(method.belief(after.belief).covariance).all(), name


def test_eq_2_2_4_as_printed_cancels_a_million_metres_off() -> None:
    """E[X X^T] - x x^T loses the covariance to rounding; deviations from the mean keep it."""
    P = np.diag([1e-3, 1e-3])
    offsets = np.sqrt(2) * np.concatenate([np.sqrt(P), -np.sqrt(P)])
    X = 1e6 + offsets
    mean = X.mean(axis=0)
    printed = X.T @ X / 4 - np.outer(mean, mean)
    assert np.abs(printed - P).max() > 0.02 * 1e-3
    state = svsf.predict(svsf.start(np.array([1e6, 1e6]), P), identity, np.zeros((2, 2)))
    np.testing.assert_allclose(state.covariance, P, atol=1e-10)


def test_eq_2_2_12_as_printed_explodes_within_37_steps() -> None:
    """P + W Pzz W^T, where there is hardly any process noise: the covariance all but doubles at every step."""
    F, Q, R, P = np.array([[1.0, 0.01], [0.0, 1.0]]), 1e-6 * np.eye(2), np.diag([8e-4, 8e-4]), np.eye(2) * 32e-4
    printed, right = P, svsf.start(np.zeros(2), P)
    for _ in range(37):
        prior = F @ printed @ F.T + Q
        W = prior @ np.linalg.inv(prior + R)
        printed = prior + W @ (prior + R) @ W.T
        right = cubature_smooth.update(svsf.predict(right, rows(F), Q), np.zeros(2), identity, R).belief
    assert np.sqrt(printed[0, 0]) > 1e4  # metres, of a position measured to 3 cm
    assert np.sqrt(right.covariance[0, 0]) < 0.01
