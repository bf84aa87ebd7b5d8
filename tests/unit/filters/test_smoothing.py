"""Smoothing against the textbook's recursion and against least squares over the whole record."""

from typing import Any

import numpy as np
import pytest

from onboard.filters import kalman, smoothing
from onboard.filters.belief import Belief, FilterError, NotPositiveDefiniteError

N, T = 3, 12
H, R = np.array([[1.0, 0.3, 0.0]]), np.array([[0.2]])


def record(seed: int, varying: bool = False) -> tuple[Any, Any, Any, Any, Belief]:
    """F and Q of each of the T-1 steps, what each adds, y (T, 1), and the filtered beliefs, stacked."""
    rng = np.random.default_rng(seed)
    F = np.tile(np.eye(N) + 0.2 * rng.normal(0, 1, (N, N)), (T - 1, 1, 1))
    Q = np.tile(np.diag([0.1, 0.2, 0.3]), (T - 1, 1, 1))
    inputs = np.zeros((T - 1, N))
    if varying:
        F = F + 0.1 * rng.normal(0, 1, F.shape)
        Q = Q * rng.uniform(0.5, 2, (T - 1, 1, 1))
        inputs = rng.normal(0, 1, inputs.shape)
    y = rng.normal(0, 2, (T, 1))
    beliefs = [kalman.update(Belief(np.zeros(N), 2 * np.eye(N)), y[0], H, R).belief]
    for k in range(1, T):
        prior = kalman.predict(beliefs[-1], F[k - 1], Q[k - 1])
        beliefs.append(kalman.update(Belief(prior.mean + inputs[k - 1], prior.covariance), y[k], H, R).belief)
    return F, Q, inputs, y, Belief(*(np.stack(parts) for parts in zip(*beliefs, strict=True)))


def textbook(F: Any, Q: Any, inputs: Any, filtered: Belief) -> Belief:
    mean, P = np.array(filtered.mean), np.array(filtered.covariance)
    for k in range(T - 2, -1, -1):
        forecast = F[k] @ filtered.covariance[k] @ F[k].T + Q[k]
        G = filtered.covariance[k] @ F[k].T @ np.linalg.inv(forecast)
        mean[k] = filtered.mean[k] + G @ (mean[k + 1] - F[k] @ filtered.mean[k] - inputs[k])
        P[k] = filtered.covariance[k] + G @ (P[k + 1] - forecast) @ G.T
    return Belief(mean, P)


def least_squares(F: Any, Q: Any, inputs: Any, y: Any) -> Belief:
    """All states at once: prior, every step and every measurement, each weighed by its covariance."""
    information, vector = np.zeros((T * N, T * N)), np.zeros(T * N)

    def add(A: Any, b: Any, covariance: Any) -> None:
        weight = np.linalg.inv(covariance)
        information[:] += A.T @ weight @ A
        vector[:] += A.T @ weight @ b

    pick = np.eye(T * N).reshape(T, N, T * N)
    add(pick[0], np.zeros(N), 2 * np.eye(N))
    for k in range(T - 1):
        add(pick[k + 1] - F[k] @ pick[k], inputs[k], Q[k])
    for k in range(T):
        add(H @ pick[k], y[k], R)
    covariance = np.linalg.inv(information)
    blocks = np.stack([covariance[k * N : (k + 1) * N, k * N : (k + 1) * N] for k in range(T)])
    return Belief((covariance @ vector).reshape(T, N), blocks)


def close(got: Belief, want: Belief, tolerance: float = 1e-9) -> None:
    np.testing.assert_allclose(got.mean, want.mean, rtol=tolerance, atol=tolerance)
    np.testing.assert_allclose(got.covariance, want.covariance, rtol=tolerance, atol=tolerance)


@pytest.mark.parametrize("varying", [False, True])
def test_it_is_the_textbook_and_the_least_squares_of_the_record_seed_1(varying: bool) -> None:
    F, Q, inputs, y, filtered = record(1, varying)
    smoothed = smoothing.rauch_tung_striebel(filtered, F, Q, inputs)
    close(smoothed, textbook(F, Q, inputs, filtered))
    close(smoothed, least_squares(F, Q, inputs, y))
    assert np.array_equal(smoothed.covariance, np.swapaxes(smoothed.covariance, 1, 2))
    if not varying:
        close(smoothing.rauch_tung_striebel(filtered, F[0], Q[0]), smoothed, 1e-13)


def test_what_cannot_be_used_is_refused_by_name_seed_7() -> None:
    F, Q, _, _, filtered = record(7)
    smooth = smoothing.rauch_tung_striebel
    nan = np.array(filtered.mean)
    nan[3] = np.nan
    for bad, name in (
        ((Belief(filtered.mean[0], filtered.covariance[0]), F, Q), "mean"),
        ((Belief(nan, filtered.covariance), F, Q), "mean"),
        ((filtered, F[:-1], Q), "F"),
        ((filtered, np.full((N, N), np.nan), Q), "F"),
        ((filtered, F, np.eye(N + 1)), "Q"),
        ((filtered, F, np.full((N, N), np.inf)), "Q"),
        ((filtered, F.astype(np.float32), Q), "F"),
    ):
        with pytest.raises(FilterError, match=rf"\b{name}\b"):
            smooth(*bad)
    with pytest.raises(NotPositiveDefiniteError, match="covariance"):
        smooth(Belief(filtered.mean, -filtered.covariance), F, Q)
