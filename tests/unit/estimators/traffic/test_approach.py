"""Closest approach: by hand, and its uncertainty by Monte Carlo."""

import math

import numpy as np
import pytest

from onboard.estimators.traffic.approach import closest, closest_in_turns
from onboard.estimators.traffic.config import Config
from onboard.estimators.traffic.publication import _threat, curvature
from onboard.messages import ThreatLevel


def test_closest_approach_by_hand() -> None:
    r = np.array([[100.0, 30.0, -40.0], [100.0, 0.0, 0.0], [10.0, 20.0, 0.0]])
    v = np.array([[-10.0, 0.0, 0.0], [5.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    a = closest(r, v, np.broadcast_to(np.eye(6), (3, 6, 6)))
    np.testing.assert_allclose(a.time, [10.0, 0.0, 0.0])
    np.testing.assert_allclose(a.distance, [50.0, 100.0, math.hypot(10, 20)])
    np.testing.assert_allclose(a.miss[0], [0.0, 30.0, -40.0])
    assert np.isfinite(a.time_sigma).all()


@pytest.mark.parametrize(
    ("time", "distance", "sigma", "threat"),
    [
        (29.0, 99.0, 1.0, ThreatLevel.HIGH),
        (31.0, 99.0, 1.0, ThreatLevel.NONE),
        (29.0, 119.0, 10.0, ThreatLevel.LOW),
        (29.0, 121.0, 10.0, ThreatLevel.NONE),
        (31.0, 119.0, 10.0, ThreatLevel.NONE),
    ],
)
def test_a_threat_is_soon_and_near_within_two_sigmas(
    time: float, distance: float, sigma: float, threat: ThreatLevel
) -> None:
    config = Config(threat_time_s=30.0, threat_distance_m=100.0)
    assert _threat(time, distance, sigma, config) is threat


@pytest.mark.parametrize("miss", [300.0, 60.0])
def test_its_sigmas_by_monte_carlo_seed_7(miss: float) -> None:
    rng = np.random.default_rng(7)
    r, v = np.array([1500.0, miss, 20.0]), np.array([-60.0, 3.0, 1.0])
    P = np.diag([20.0, 15.0, 10.0, 1.0, 0.8, 0.5]) ** 2
    P[0, 3] = P[3, 0] = 8.0
    draws = rng.multivariate_normal(np.concatenate([r, v]), P, 40_000)
    one = closest(r[None], v[None], P[None])
    many = closest(draws[:, :3], draws[:, 3:], np.broadcast_to(P, (40_000, 6, 6)))
    assert one.time_sigma[0] == pytest.approx(many.time.std(), rel=0.05)
    assert one.distance_sigma[0] == pytest.approx(many.distance.std(), rel=0.12)


def test_the_sigma_of_a_distance_below_its_uncertainty_is_that_of_the_whole_vector() -> None:
    a = closest(
        np.array([[1000.0, 0.0, 0.0]]), np.array([[-50.0, 0.0, 0.0]]), np.diag([9.0] * 3 + [1.0] * 3)[None]
    )
    assert a.distance[0] == pytest.approx(0.0, abs=1e-9)
    assert a.distance_sigma[0] == pytest.approx(math.sqrt(2 * (9.0 + 400.0)), rel=0.01)


def test_the_covariance_includes_the_sphere_s_curvature_seed_11() -> None:
    r, sigma = np.array([3000.0, 400.0, -200.0]), 40.0
    u = r / np.linalg.norm(r)
    P = 0.25 * np.outer(u, u) + sigma**2 * (np.eye(3) - np.outer(u, u))
    draws = np.random.default_rng(11).multivariate_normal(np.zeros(3), P, 20_000)
    places = r + draws
    on_it = places / np.linalg.norm(places, axis=1)[:, None] * (np.linalg.norm(r) + draws @ u)[:, None]
    sag = (on_it - r) @ u - draws @ u
    (more,) = curvature(r[None], P[None])
    assert u @ more @ u == pytest.approx(np.mean(sag**2), rel=0.1)
    assert np.trace(more) == pytest.approx(u @ more @ u)  # along the line of sight alone


def along_a_turn(seconds: float = 40.0) -> tuple[float, float]:
    """Time and distance of the next test's closest approach, step by step."""
    speed, rate, r, v_F = 30.0, 0.08, np.array([700.0, 250.0, -20.0]), np.array([20.0, 0.0, 0.0])
    t = np.arange(0.0, seconds, 1e-3)
    path = -speed / rate * np.column_stack([np.sin(rate * t), 1 - np.cos(rate * t), 0 * t])
    distance = np.linalg.norm(r + path - v_F * t[:, None], axis=1)
    return float(t[distance.argmin()]), float(distance.min())


def turning(sigma: float) -> tuple[np.ndarray, ...]:
    r, v = np.array([[700.0, 250.0, -20.0]]), np.array([[-50.0, 0.0, 0.0]])
    P = np.diag(np.repeat([3.0, 0.4, sigma], 3) ** 2)[None]
    return r, v, np.array([[0.0, -2.4, 0.0]]), P, np.array([20.0, 0.0, 0.0])


def test_the_closest_approach_of_one_that_turns_is_along_its_turn() -> None:
    time, distance = along_a_turn()
    a = closest_in_turns(*turning(0.1))
    assert a.turn_rate[0] == pytest.approx(0.08)
    assert a.time[0] == pytest.approx(time, abs=1e-2)
    assert a.distance[0] == pytest.approx(distance, abs=0.01)
    assert np.linalg.norm(a.miss[0]) == pytest.approx(distance, abs=0.01)
    r, v, _, P, _ = turning(0.1)
    assert closest(r, v, P[:, :6, :6]).distance[0] > distance + 50.0  # straight on


def test_the_sigmas_in_a_turn_by_monte_carlo_seed_9() -> None:
    r, v, a, P, v_F = turning(0.2)
    one = closest_in_turns(r, v, a, P, v_F)
    draws = np.random.default_rng(9).multivariate_normal(np.concatenate([r, v, a], axis=1)[0], P[0], 4000)
    sure = np.broadcast_to(1e-9 * np.eye(9), (4000, 9, 9))
    many = closest_in_turns(draws[:, :3], draws[:, 3:6], draws[:, 6:], sure, v_F)
    assert one.distance_sigma[0] == pytest.approx(many.distance.std(), rel=0.15)
    assert one.time_sigma[0] == pytest.approx(many.time.std(), rel=0.15)


def test_an_uncertain_turn_is_predicted_straight() -> None:
    a = closest_in_turns(*turning(0.9))  # 2.4 m/s^2 is not three sigmas
    assert a.turn_rate[0] == 0.0
    r, v, _, P, _ = turning(0.9)
    assert a.distance[0] == closest(r, v, P[:, :6, :6]).distance[0]
