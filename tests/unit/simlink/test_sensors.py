import math
from itertools import islice
from typing import Any

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace
from numpy.testing import assert_allclose

from onboard.geometry.rotations import euler_from_quaternion
from onboard.messages import TargetPoints, Truth
from onboard.messages.base import Quaternion
from simlink.scenarios.camera import Camera
from simlink.scenarios.profiles import GaussMarkov, Interval
from simlink.scenarios.scenario import Scenario, load_scenario
from simlink.scenarios.vehicle import BarometerErrors, Gps, ImuErrors, Nav
from simlink.sensors.camera import (
    CameraSensor,
    is_exposure,
    mount_quaternion,
    project,
    registrations,
)
from simlink.sensors.navigation import barometer, readings
from simlink.simulation import simulate
from simlink.world.truth import State, states
from studies.relative_motion.flight import fly

LEVEL = (1.0, 0.0, 0.0, 0.0)


def at(
    r_FL_n: tuple[float, float, float], q_nF: Quaternion = LEVEL, q_nL: Quaternion = LEVEL, t: float = 0.0
) -> State:
    nothing = (0.0, 0.0, 0.0)
    return State(0, t, r_FL_n, nothing, nothing, q_nL, 0.0, 0.0, nothing, nothing, nothing, q_nF, nothing, nothing)


def projected(state: State, size: float = 2.0, **camera: Any) -> Any:
    c = Camera(**camera)
    return project(state, size, c, mount_quaternion(c))


def test_points_project_where_a_hand_calculation_puts_them() -> None:
    # 20 m ahead, 2 m right, 1 m below; wing points 1 m to either side
    assert projected(at((20.0, 2.0, 1.0))) == ((0.1, 0.05), (0.05, 0.05), (0.15, 0.05))


def test_a_leader_banked_right_lowers_its_right_wing_in_the_image() -> None:
    bank = math.radians(30.0)
    q_nL = (math.cos(bank / 2), math.sin(bank / 2), 0.0, 0.0)
    _, left, right = projected(at((20.0, 0.0, 0.0), q_nL=q_nL))
    assert right == pytest.approx((0.05 * math.cos(bank), 0.05 * math.sin(bank)))
    assert left == pytest.approx((-0.05 * math.cos(bank), -0.05 * math.sin(bank)))


def test_a_follower_heading_east_sees_ahead_what_lies_east() -> None:
    east = (math.cos(math.pi / 4), 0.0, 0.0, math.sin(math.pi / 4))
    center, left, right = projected(at((-2.0, 20.0, 0.0), q_nF=east, q_nL=east))
    assert center == pytest.approx((0.1, 0.0))  # south of the line east is to the right
    assert (left, right) == (pytest.approx((0.05, 0.0)), pytest.approx((0.15, 0.0)))


def test_a_camera_that_looks_up_sees_the_horizon_low_and_its_offset_counts() -> None:
    center, *_ = projected(at((20.0, 0.0, 0.0)), mount_rpy_deg=(0.0, 15.0, 0.0))
    assert center == pytest.approx((0.0, math.tan(math.radians(15.0))))
    center, *_ = projected(at((20.0, 0.0, 0.0)), mount_offset=(1.0, 0.5, -0.2))
    assert center == pytest.approx((-0.5 / 19.0, 0.2 / 19.0))


@pytest.mark.parametrize(
    "r", [(-20.0, 0.0, 0.0), (0.0, 0.0, 0.0), (20.0, 10.8, 0.0), (20.0, 0.0, 9.0), (20.0, -10.8, 0.0)]
)
def test_a_leader_behind_or_beside_the_image_is_not_registered(r: tuple[float, float, float]) -> None:
    # half the image is 320 / 554.256 = 0.577 wide and 0.433 high: at 20 m 11.5 and 8.7 m, less the wing
    assert projected(at(r)) is None


def test_registration_is_the_markov_chain_of_the_reference_seed_11() -> None:
    chain = np.array(list(islice(registrations(Camera(), 11), 200_000)))
    lost = np.mean(~chain[1:][chain[:-1]])
    regained = np.mean(chain[1:][~chain[:-1]])
    assert lost == pytest.approx(0.02, abs=0.001)
    assert regained == pytest.approx(0.38, abs=0.012)
    assert chain.mean() == pytest.approx(0.38 / 0.40, abs=0.003)


def test_pixel_noise_is_one_pixel_on_each_coordinate_seed_12() -> None:
    sensor = CameraSensor(Scenario(camera=Camera(p_lose=0.0)), 12, 2.0)
    state = at((20.0, 2.0, 1.0))
    images = np.array([sensor.expose(state) for _ in range(4000)])
    pixels = (images - np.array(projected(state))) * 554.256
    assert_allclose(pixels.mean(axis=0), 0.0, atol=0.06)
    assert_allclose(pixels.std(axis=0), 1.0, atol=0.04)


def test_wrong_blobs_are_as_frequent_and_as_wide_as_configured_seed_13() -> None:
    sensor = CameraSensor(Scenario(camera=Camera(p_lose=0.0, sigma_px=0.0, wrong_blob=0.02)), 13, 2.0)
    state = at((20.0, 2.0, 1.0))
    images = np.array([sensor.expose(state) for _ in range(20_000)])
    wrong = images[np.any(images != np.array(projected(state)), axis=(1, 2))] * 554.256
    assert len(wrong) / len(images) == pytest.approx(0.02, abs=0.003)
    span = wrong[:, 2, 0] - wrong[:, 1, 0]
    assert span.min() > 10.0
    assert span.max() < 150.0
    assert np.ptp(wrong[:, 0, 0]) > 600.0
    assert np.ptp(wrong[:, 0, 1]) > 440.0


def test_nothing_is_seen_in_a_blackout_and_it_comes_again() -> None:
    scenario = Scenario(camera=Camera(p_lose=0.0, blackouts=(Interval(start=30.0, end=35.0),)))
    sensor = CameraSensor(scenario, 1, 2.0)
    found = [sensor.expose(at((20.0, 0.0, 0.0), t=t)) is not None for t in (29.9, 30.0, 34.9, 35.0, 91.0)]
    assert found == [True, False, False, True, False]


def test_the_nav_errors_have_the_sizes_of_the_scenario_seeds_0_to_39() -> None:
    scenario = load_scenario("formation-nav-error")
    velocity, roll, acceleration, bias = [], [], [], []
    for seed in range(40):
        flight = fly(scenario, seed, 1.0)
        velocity.append(flight.nav_v_F_n[-1] - flight.nav_truth.v_F_n[-1])
        angles = (euler_from_quaternion(q) for q in (flight.nav_q_nb[-1], flight.nav_truth.q_nF[-1]))
        roll.append(np.subtract(*angles))
        error = flight.nav_a_F_n - flight.nav_truth.a_F_n
        acceleration.append(error.std(axis=0))
        bias.append(error.mean(axis=0))
    assert np.std(velocity) == pytest.approx(0.1006, rel=0.2)
    assert np.degrees(np.std(roll)) == pytest.approx(0.5, rel=0.2)
    assert np.mean(acceleration) == pytest.approx(0.1524, rel=0.05)
    assert np.std(bias) == pytest.approx(math.hypot(0.03048, 0.1524 / math.sqrt(51)), rel=0.2)


def test_a_barometer_gives_heights_above_sea_level_with_a_scale_error_seeds_1_to_400() -> None:
    scenario = load_scenario("formation")
    quiet = replace(scenario, barometer=BarometerErrors(white=0.0, drift=GaussMarkov(), stretch=0.0))
    rows = list(islice(readings(quiet, 1, states(quiet, 1)), 9))
    assert [r.pressure_altitude is None for _, r in rows] == [k % 4 > 0 for k in range(9)]
    for state, reading in rows[::4]:
        assert reading.pressure_altitude == pytest.approx(scenario.vehicle.origin[2] - state.r_OF_n[2])
    state = rows[0][0]._replace(r_OF_n=(0.0, 0.0, -100.0), step=0)
    high = [barometer(scenario, seed)(state) - scenario.vehicle.origin[2] for seed in range(1, 401)]
    assert np.mean(high) == pytest.approx(100.0, abs=0.4)
    assert np.std(high) == pytest.approx(math.sqrt(2.0**2 + 0.5**2 + 0.15**2), rel=0.1)


def test_delayed_streams_are_older_than_their_stamp_seed_1() -> None:
    scenario = Scenario(
        nav=Nav(position_delay=0.02), gps=Gps(position=GaussMarkov(), velocity_white=0.0, delay=0.1)
    )
    rows = list(islice(readings(scenario, 1, states(scenario, 1)), 100))
    assert rows[50][1].position_r_OF_n == rows[46][0].r_OF_n
    assert rows[50][1].position_v_F_n == rows[46][0].v_F_n
    assert rows[50][1].gps_r_OF_n == rows[30][0].r_OF_n
    assert rows[2][1].gps_r_OF_n == rows[0][0].r_OF_n


def test_imu_noise_and_bias_seed_14() -> None:
    scenario = Scenario(imu=ImuErrors(accel_white=0.02, gyro_white=0.002, accel_bias=0.05, gyro_bias=0.01))
    rows = list(islice(readings(scenario, 14, states(scenario, 14)), 4000))
    accel = np.array([np.subtract(r.imu_f_b, s.f_b) for s, r in rows])
    gyro = np.array([np.subtract(r.imu_omega_b, s.omega_b) for s, r in rows])
    assert 0.01 < np.abs(accel.mean(axis=0)).max() < 0.15  # one draw of three
    assert_allclose(accel.std(axis=0), 0.02, rtol=0.05)
    assert_allclose(gyro.std(axis=0), 0.002, rtol=0.05)
    assert np.abs(gyro.mean(axis=0)).max() > 1e-3


def test_a_flight_has_the_reference_rates_and_shapes_seed_1() -> None:
    flight = fly(load_scenario("formation-late-image"), 1, 4.0)
    assert_allclose(flight.nav_t, np.arange(201) / 50)
    assert_allclose(flight.image_t, np.arange(101) / 25)
    assert_allclose(flight.image_t_delivered - flight.image_t, 0.08)
    assert flight.image_points.shape == (101, 3, 2)
    assert flight.image_truth.r_FL_n.shape == (101, 3)
    center = flight.image_points[:, 0]
    span = np.linalg.norm(flight.image_points[:, 2] - flight.image_points[:, 1], axis=1)
    distance = np.linalg.norm(flight.image_truth.r_FL_n, axis=1)
    assert np.nanmedian(span * distance) == pytest.approx(flight.size, rel=0.03)
    assert np.nanmax(np.abs(center)) < 0.3


def test_late_stamps_are_all_that_differs_seed_1() -> None:
    late = load_scenario("formation-late-stamp")
    camera = msgspec.structs.replace(late.camera, stamp_late=0.0)
    right = msgspec.structs.replace(late, camera=camera)
    one, other = (
        [e for e in simulate(s, 1, 3.0, "mavlink") if isinstance(e.message, TargetPoints)] for s in (right, late)
    )
    assert len(one) == len(other) > 50
    for a, b in zip(one, other, strict=True):
        assert isinstance(a.message, TargetPoints)
        assert isinstance(b.message, TargetPoints)
        assert a.t_ns == b.t_ns == a.message.t_ns + 100_000_000
        assert b.message.t_ns == a.message.t_ns + 80_000_000
        assert b.message.center == a.message.center


@pytest.mark.parametrize(("rate", "steps"), [(25.0, [0, 8, 16, 24]), (60.0, [0, 4, 7, 10, 14, 17, 20, 24, 27])])
def test_an_exposure_is_the_first_step_at_or_after_its_time(rate: float, steps: list[int]) -> None:
    assert [k for k in range(28) if is_exposure(k, rate)] == steps
    assert sum(is_exposure(k, rate) for k in range(1_000_000)) == rate * 5000


def test_a_study_and_a_link_get_the_same_run_seed_3() -> None:
    scenario = load_scenario("formation-out-of-view")
    flight = fly(scenario, 3, 24.0)
    found = ~np.isnan(flight.image_points[:, 0, 0])
    images = [e.message for e in simulate(scenario, 3, 24.0, "mavlink") if isinstance(e.message, TargetPoints)]
    images_t = np.array([m.t_ns * 1e-9 - 40.0 for m in images])
    assert 300 < len(images) <= found.sum()
    assert_allclose(images_t, flight.image_t[found][: len(images)], atol=1e-9)
    sent = np.array([(m.center, m.left, m.right) for m in images])
    assert_allclose(sent, flight.image_points[found][: len(images)])
    truth = [e.message for e in simulate(scenario, 3, 24.0) if isinstance(e.message, Truth)]
    assert_allclose([m.r_FL_n for m in truth], flight.image_truth.r_FL_n)
    assert {m.size for m in truth} == {flight.size}
