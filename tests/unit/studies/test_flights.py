"""Many flights at once are the flights that `fly` makes one by one; a leader that stops and yaws."""

import math

import msgspec
import numpy as np
import pytest
from numpy.testing import assert_allclose

from onboard.arrays import Array
from onboard.geometry.rotations import euler_from_quaternion, matrix_from_quaternion
from simlink.scenarios.camera import Camera
from simlink.scenarios.profiles import Pulse
from simlink.scenarios.scenario import Scenario, ScenarioError, load_scenario, parse_scenario
from simlink.world.motion import pulses
from studies.relative_motion.flight import fly
from studies.relative_motion.flights import fly_many


def difference(one: Array, other: Array) -> float:
    assert one.shape == other.shape
    assert np.array_equal(np.isnan(one), np.isnan(other))
    return float(np.nanmax(np.abs(one - other)))


@pytest.mark.parametrize(
    ("name", "tolerance"),
    [
        ("formation-speed-change", 1e-9),
        ("formation-nav-error", 1e-9),
        ("formation-wrong-blobs", 1e-9),
        ("formation-from-the-side", 1e-9),
        ("formation-hover", 1e-9),
        # the slot's acceleration jumps where its pulse begins: `fly` integrates over the corner
        ("formation-out-of-view", 1e-3),
    ],
)
def test_many_flights_are_those_of_fly_seeds_3_and_5(name: str, tolerance: float) -> None:
    scenario, courses = load_scenario(name), [20.0, -130.0]
    seconds = 34.0 if tolerance > 1e-9 else 12.0
    many = fly_many(scenario, [3, 5], courses, seconds)
    leader = msgspec.structs.replace(scenario.leader, course_deg=courses[1])
    one, same = fly(msgspec.structs.replace(scenario, leader=leader), 5, seconds), many.one(1)
    assert many.seeds == (3, 5)
    assert same.size == one.size
    for field in ("nav_t", "nav_v_F_n", "nav_a_F_n", "nav_q_nb", "image_t", "image_t_delivered", "image_points"):
        assert difference(getattr(same, field), getattr(one, field)) < tolerance, field
    for truth, other in ((same.nav_truth, one.nav_truth), (same.image_truth, one.image_truth)):
        for field in one.nav_truth._fields:
            assert difference(getattr(truth, field), getattr(other, field)) < tolerance, field


def test_what_only_fly_can_do_is_refused() -> None:
    with pytest.raises(ValueError, match="use fly"):
        fly_many(load_scenario("quadrotor"), [1])
    with pytest.raises(ValueError, match="60 Hz are exposed between"):
        fly_many(Scenario(camera=Camera(rate=60.0)), [1], duration=1.0)


def test_a_pulse_may_stay_out_for_a_while() -> None:
    at = pulses([Pulse(start=10.0, end=42.0, change=-8.0, hold=12.0)], 60.0)
    t = np.arange(0.0, 60.0, 0.005)
    value, first, second = (np.array(column) for column in zip(*(at(float(x)) for x in t), strict=True))
    assert_allclose(value[(t > 20.0) & (t < 32.0)], -8.0, atol=1e-12)
    assert value[t < 10.0].tolist() == [0.0] * 2000
    assert_allclose(value[t == 15.0], -4.0)
    assert_allclose((value[2:] - value[:-2]) / 0.01, first[1:-1], atol=1e-3)
    corner = np.min(np.abs(t[1:-1, None] - np.array([10.0, 20.0, 32.0, 42.0])), axis=1) < 0.02
    assert_allclose(((first[2:] - first[:-2]) / 0.01)[~corner], second[1:-1][~corner], atol=1e-3)
    assert_allclose(
        pulses([Pulse(start=10.0, end=42.0, change=-8.0, hold=12.0)], 60.0, np)(t), [value, first, second]
    )


def test_the_hovering_leader_stands_and_yaws_seed_2() -> None:
    flight = fly_many(load_scenario("formation-hover"), [2]).one(0)
    t, truth = flight.nav_t, flight.nav_truth
    v_L = truth.v_F_n + truth.v_FL_n
    assert_allclose(v_L[(t >= 20.0) & (t <= 40.0)], 0.0, atol=1e-9)
    assert_allclose(v_L[0], [10.0, 0.0, 0.0], atol=1e-9)
    yaw = math.degrees(euler_from_quaternion(truth.q_nL[np.searchsorted(t, 33.0)])[2])
    assert yaw == pytest.approx(60.0, abs=8.0)  # wobbling by 2 degrees
    # the thrust is along the craft's own axis: what an accelerometer feels across it is nothing
    f_b = np.einsum("nji,nj->ni", matrix_from_quaternion(truth.q_nF), truth.a_F_n - [0.0, 0.0, 9.80665])
    assert_allclose(f_b[:, :2], 0.0, atol=1e-12)
    assert np.isfinite(flight.image_points).all(axis=(1, 2)).mean() > 0.9


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "[leader]\nspeed = 5\na_lat = { mean = 0.0 }\nspeed_pulses = [{ start = 1, end = 9, change = -5 }]",
            "hover",
        ),
        (
            "[leader]\nspeed_pulses = [{ start = 1.0, end = 9.0, change = 1.0, hold = 8.0 }]",
            "hold must be shorter than end - start",
        ),
        (
            "[leader]\na_lat = { mean = 0.0 }\nspeed_pulses = [{ start = 1.0, end = 9.0, change = -30.0 }]",
            "keep 0 m/s or more",
        ),
    ],
)
def test_flights_that_cannot_be_flown_are_refused(text: str, message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        parse_scenario(text, "mine")
