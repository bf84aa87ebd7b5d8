"""Motion of the leader relative to the follower, compared with circles by hand and an accurate integrator."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from onboard.arrays import Array
from onboard.models.relative_motion import FollowerMotion, leader_acceleration, process


def a_L(v: list[float], a_lat: float, a_long: float, eps: float = 0.0) -> list[float]:
    row = leader_acceleration(np.array([v]), np.array([a_lat]), np.array([a_long]), eps)[0]
    return [float(x) for x in row]


def test_a_lat_is_to_the_right() -> None:
    assert a_L([20.0, 0.0, 0.0], 3.0, 0.0) == pytest.approx([0.0, 3.0, 0.0], abs=1e-15)  # north: right is east
    assert a_L([0.0, 20.0, 0.0], 3.0, 0.0) == pytest.approx([-3.0, 0.0, 0.0], abs=1e-15)  # east: right is south


def test_a_long_is_up_and_normal_to_the_velocity() -> None:
    assert a_L([20.0, 0.0, 0.0], 0.0, 3.0) == pytest.approx([0.0, 0.0, -3.0], abs=1e-15)
    # climbing at 45 degrees north: up and backwards
    assert a_L([10.0, 0.0, -10.0], 0.0, 2.0) == pytest.approx([-(2**0.5), 0.0, -(2**0.5)], abs=1e-14)


def test_neither_acceleration_changes_the_speed_seed_1() -> None:
    rng = np.random.default_rng(1)
    v = rng.normal(0.0, 20.0, (200, 3))
    lat, long = rng.normal(0.0, 5.0, (2, 200))
    a = leader_acceleration(v, lat, long, 0.0)
    assert np.sum(a * v, axis=1) == pytest.approx(np.zeros(200), abs=1e-11)
    assert np.linalg.norm(a, axis=1) == pytest.approx(np.hypot(lat, long), rel=1e-12)


def test_eps_keeps_a_hovering_leader_finite_and_hardly_touches_a_fast_one() -> None:
    assert a_L([0.0, 0.0, 0.0], 2.0, 2.0, eps=1.0) == [0.0, 0.0, 0.0]
    with np.errstate(invalid="ignore", divide="ignore"):
        assert np.isnan(a_L([0.0, 0.0, 0.0], 2.0, 2.0, eps=0.0)).all()  # the paper's own form
    assert a_L([20.0, 0.0, 0.0], 2.0, 0.0, eps=1.0)[1] == pytest.approx(2.0 / (1 + 1 / 400) ** 0.5, rel=1e-14)


def accurate(row: Array, dt: float, follower: FollowerMotion, eps: float) -> Array:
    """The same equations by an eighth-order integrator, the follower's motion linear over the step."""

    def derivative(t: float, x: Array) -> Array:
        v_F = follower.v0 + (follower.v1 - follower.v0) * t / dt
        a_F = follower.a0 + (follower.a1 - follower.a0) * t / dt
        v_L = (x[3:6] + v_F)[None]
        a = leader_acceleration(v_L, x[7:8], x[8:9], eps)[0] - a_F
        return np.concatenate([x[3:6], a, np.zeros(3)])

    solution = solve_ivp(derivative, (0.0, dt), row, method="DOP853", rtol=1e-13, atol=1e-13)
    return np.asarray(solution.y[:, -1])


@pytest.mark.parametrize("seed", range(5))
def test_one_step_equals_an_accurate_integration_seed(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows = np.column_stack(
        [rng.normal(0, 30, (6, 3)), rng.normal(0, 3, (6, 3)), np.full(6, 2.0), rng.normal(0, 3, (6, 2))]
    )
    v0 = np.array([18.0, 6.0, -1.0]) + rng.normal(0, 1, 3)
    a0 = rng.normal(0, 2, 3)
    follower = FollowerMotion(v0, v0 + 0.02 * a0, a0, a0 + rng.normal(0, 0.2, 3))
    ours = process(rows, 0.02, follower, 1.0)
    for row, after in zip(rows, ours, strict=True):
        # RK4 leaves h^5: (0.02 * turn rate)^5 of some 20 m/s
        assert after == pytest.approx(accurate(row, 0.02, follower, 1.0), abs=2e-9)


def test_the_step_is_of_fourth_order_seed_7() -> None:
    rng = np.random.default_rng(7)
    row = np.concatenate([rng.normal(0, 30, 3), rng.normal(0, 2, 3), [2.0, 6.0, 2.0]])
    v, a, jerk = np.array([8.0, 0.0, 0.0]), np.array([0.0, 2.0, 0.0]), np.array([0.0, 10.0, -5.0])
    errors = []
    for dt in (0.2, 0.1):
        follower = FollowerMotion(v, v + dt * a, a, a + dt * jerk)
        ours = process(row[None], dt, follower, 1.0)[0]
        errors.append(float(np.max(np.abs(ours - accurate(row, dt, follower, 1.0)))))
    assert 2**4 < errors[0] / errors[1] < 2**6.5  # the local error is of fifth order


def test_a_formation_at_rest_stays() -> None:
    """Leader and follower side by side in one turn: the relative velocity turns with them."""
    v, a = np.array([20.0, 0.0, 0.0]), np.array([0.0, 2.0, 0.0])
    row = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 2.0, 2.0, 0.0]])
    rate = 2.0 / 20.0
    dt, steps = 0.02, 250
    for k in range(steps):
        turn = [
            np.array([[np.cos(w), -np.sin(w), 0], [np.sin(w), np.cos(w), 0], [0, 0, 1]])
            for w in (rate * dt * k, rate * dt * (k + 1))
        ]
        row = process(row, dt, FollowerMotion(turn[0] @ v, turn[1] @ v, turn[0] @ a, turn[1] @ a), 0.0)
    assert row[0, :6] == pytest.approx(np.zeros(6), abs=2e-5)
