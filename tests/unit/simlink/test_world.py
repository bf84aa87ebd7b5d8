import math
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose

from onboard.geometry import rotations
from simlink.scenarios.formation import Leader
from simlink.scenarios.profiles import Wave
from simlink.scenarios.scenario import Scenario, load_scenario
from simlink.world import attitude
from simlink.world.truth import State, coordinated_attitude, true_size
from tests.support.simlink_truth import GRAVITY, HZ, dead_reckoned, flight


def column(rows: list[State], name: str) -> np.ndarray:
    return np.array([getattr(row, name) for row in rows])


CLIMBING = Scenario(
    leader=Leader(climb_deg=2.0, a_long=Wave(amplitude=1.5, period=12.0, phase_deg=90.0), course_deg=-70.0)
)


@cache
def one_flight(name: str) -> list[State]:
    return flight(CLIMBING if name == "climbing" else load_scenario(name), 3, 50.0)


@pytest.mark.parametrize("who", ["L", "F"])
@pytest.mark.parametrize("name", ["formation-s-turn", "formation-speed-change", "climbing"])
def test_velocity_and_acceleration_are_the_derivatives_seed_3(name: str, who: str) -> None:
    rows = one_flight(name)
    r, v, a = (column(rows, key) for key in (f"r_O{who}_n", f"v_{who}_n", f"a_{who}_n"))
    assert_allclose((r[2:] - r[:-2]) * HZ / 2, v[1:-1], atol=2e-5)
    assert_allclose((v[2:] - v[:-2]) * HZ / 2, a[1:-1], atol=4e-3)  # the pulses' curvature jumps at their ends


@pytest.mark.parametrize(
    ("name", "seconds", "atol"),
    [("formation-s-turn", 20.0, 1e-3), ("quadrotor-gust", 15.0, 0.05)],  # the gust begins and ends within a step
)
def test_the_imu_integrates_to_velocity_and_attitude_seed_4(name: str, seconds: float, atol: float) -> None:
    rows = flight(load_scenario(name), 4, seconds)
    v, q = dead_reckoned(rows)
    assert_allclose(v, rows[-1].v_F_n, atol=atol)
    assert_allclose(q, rows[-1].q_nF, atol=1e-9)


def test_a_steady_right_turn_by_hand_seed_1() -> None:
    rows = flight(load_scenario("formation"), 1, 20.0)
    # 21.336 m/s and 2.4384 m/s^2: radius 186.69 m, 0.114286 rad/s; the centre lies east of a northbound leader
    centre = np.array([0.0, 186.69])
    radius = np.linalg.norm(column(rows, "r_OL_n")[:, :2] - centre, axis=1)
    assert_allclose(radius, 186.69, atol=1e-6)
    angle = 0.1142857142857 * 20.0
    assert_allclose(rows[-1].v_L_n, [21.336 * math.cos(angle), 21.336 * math.sin(angle), 0.0], atol=1e-9)
    assert rows[0].a_L_n == pytest.approx((0.0, 2.4384, 0.0))
    assert {row.a_lat for row in rows} == {2.4384}
    assert {row.a_long for row in rows} == {0.0}


def test_a_lat_and_a_long_are_oh_and_johnsons_components_seed_2() -> None:
    for row in flight(CLIMBING, 2, 12.0)[::100]:
        U, V, W = row.v_L_n
        horizontal, total = math.hypot(U, V), math.sqrt(U * U + V * V + W * W)
        lateral = np.array([-V, U, 0.0]) / horizontal  # the two columns of their equation 2
        normal = np.array([U * W, V * W, -horizontal * horizontal]) / (horizontal * total)
        assert_allclose(row.a_L_n, row.a_lat * lateral + row.a_long * normal, atol=1e-12)
        assert normal[2] < 0  # up


def test_the_follower_keeps_its_slot_seed_5() -> None:
    rows = flight(load_scenario("formation-s-turn"), 5, 60.0)
    offsets = []
    for row in rows:
        course = math.atan2(row.v_L_n[1], row.v_L_n[0])
        north, east, down = np.subtract(row.r_OF_n, row.r_OL_n)
        c, s = math.cos(course), math.sin(course)
        offsets.append((c * north + s * east, c * east - s * north, down))
    middle, spread = np.mean(offsets, axis=0), np.ptp(offsets, axis=0) / 2
    assert_allclose(middle, [-27.432, 3.048, 1.524], atol=0.12)
    assert_allclose(spread, [0.9144, 0.9144, 0.3048], atol=1e-3)
    distance = np.linalg.norm(column(rows, "r_OL_n") - column(rows, "r_OF_n"), axis=1)
    assert distance.mean() == pytest.approx(27.64, abs=0.15)  # 90.69 ft


def test_the_leader_wobbles_about_coordinated_flight_seed_6() -> None:
    rows = flight(load_scenario("formation"), 6, 100.0)[::20]
    errors = []
    for row in rows:
        roll, pitch, yaw = rotations.euler_from_quaternion(row.q_nL)
        course = math.atan2(row.v_L_n[1], row.v_L_n[0])
        errors.append((roll - math.atan(2.4384 / GRAVITY), pitch, float(rotations.wrap_angle(yaw - course))))
    mean, sigma = np.degrees(np.mean(errors, axis=0)), np.degrees(np.std(errors, axis=0))
    assert_allclose(mean, 0.0, atol=0.6)
    assert_allclose(sigma, [2.0, 0.0, 2.0], atol=0.3)


def test_a_coordinated_right_turn_has_the_right_wing_down() -> None:
    roll, pitch, yaw = rotations.euler_from_quaternion(coordinated_attitude((0.0, 20.0, -2.0), (-3.0, 0.0, 0.0)))
    # flying east, turning south: right; climbing 2 in 20
    assert (roll, pitch, yaw) == pytest.approx((math.atan(3.0 / GRAVITY), math.atan(0.1), math.pi / 2))


def test_the_size_is_the_nominal_with_two_percent_seeds_0_to_999() -> None:
    scenario = load_scenario("formation")
    sizes = np.array([true_size(scenario, seed) for seed in range(1000)]) / 2.667
    assert sizes.mean() == pytest.approx(1.0, abs=0.002)
    assert sizes.std() == pytest.approx(0.02, abs=0.0015)


def test_plain_float_rotations_agree_with_the_array_ones_seed_7() -> None:
    rng = np.random.default_rng(7)
    for _ in range(50):
        roll, pitch, yaw = rng.uniform(-1.5, 1.5, 3)
        q = attitude.from_euler(roll, pitch, yaw)
        p = attitude.from_vector(*rng.normal(size=3))
        v = tuple(rng.normal(size=3))
        assert_allclose(q, rotations.quaternion_from_euler(roll, pitch, yaw), atol=1e-15)
        assert_allclose(attitude.product(p, q), rotations.quaternion_product(p, q), atol=1e-15)
        assert_allclose(attitude.to_n(q, v), rotations.matrix_from_quaternion(q) @ v, atol=1e-14)
        assert_allclose(attitude.to_b(q, v), rotations.matrix_from_quaternion(q).T @ v, atol=1e-14)
        assert_allclose(attitude.from_vector(*attitude.to_vector(p)), p if p[0] >= 0 else np.negative(p))
