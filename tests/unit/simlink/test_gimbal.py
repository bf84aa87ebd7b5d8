"""The simulated gimbal: what it says is where its camera points."""

import math
from itertools import islice

import numpy as np
import pytest
from numpy.testing import assert_allclose

from onboard.geometry.rotations import matrix_from_quaternion
from onboard.messages import Datagram, GimbalAttitude
from onboard.ownship import head_attitude
from simlink.scenarios.camera import Camera, Gimbal
from simlink.scenarios.describe import daemon_config
from simlink.scenarios.scenario import load_scenario
from simlink.sensors.gimbal import make_gimbal
from simlink.simulation import datagrams, simulate
from simlink.world.truth import states


def test_with_our_own_attitude_it_says_where_the_camera_points_seed_1() -> None:
    camera = Camera(gimbal=Gimbal(error_deg=0.0), mount_rpy_deg=(0.0, 10.0, 0.0))
    gimbal = make_gimbal(camera, 1)
    assert gimbal is not None
    yaws = []
    for state in islice(states(load_scenario("formation"), 1), 0, 1200, 100):
        sent = gimbal.attitude(state, state.step, 1)
        R_nb = matrix_from_quaternion(state.q_nF)
        R_hc = matrix_from_quaternion((math.cos(math.radians(5)), 0.0, math.sin(math.radians(5)), 0.0))
        expected = head_attitude(sent.mount, R_nb) @ R_hc
        assert_allclose(R_nb @ matrix_from_quaternion(gimbal.mount(state)), expected, atol=1e-9)
        yaws.append(math.degrees(2 * math.atan2(sent.mount.q[3], sent.mount.q[0])))
    assert max(yaws) > 10.0
    assert min(yaws) < -10.0


def test_a_constant_error_is_in_its_word_alone() -> None:
    state = next(states(load_scenario("formation"), 1))
    exact, wrong = (make_gimbal(Camera(gimbal=Gimbal(error_deg=e)), 1) for e in (0.0, 2.0))
    assert exact is not None
    assert wrong is not None
    assert exact.mount(state) == wrong.mount(state)
    off = np.abs(np.array(wrong.attitude(state, 0, 1).mount.q) - exact.attitude(state, 0, 1).mount.q)
    assert off.max() > 0.002


def test_its_yaw_may_be_worse_known_than_its_tilt() -> None:
    state = next(states(load_scenario("formation"), 1))
    level = make_gimbal(Camera(gimbal=Gimbal(error_deg=0.0, yaw_error_deg=2.0)), 1)
    assert level is not None
    w, x, y, z = level.attitude(state, 0, 1).mount.q
    assert abs(z) > 0.001
    assert (x, y) == pytest.approx((0.0, 0.0), abs=1e-12)
    assert w == pytest.approx(math.sqrt(1.0 - z * z))


def test_its_sweeps_begin_where_their_phases_say() -> None:
    gimbal = make_gimbal(Camera(gimbal=Gimbal(phase_deg=(90.0, -90.0))), 1)
    assert gimbal is not None
    R_hg = matrix_from_quaternion(gimbal.head(0.0))
    yaw, pitch = np.degrees([np.arctan2(R_hg[1, 0], R_hg[0, 0]), -np.arcsin(R_hg[2, 0])])
    assert (yaw, pitch) == pytest.approx((12.0, -5.0))


def test_it_is_sent_by_a_component_of_its_own_at_its_rate_seed_1() -> None:
    scenario = load_scenario("formation-gimbal")
    sent = [e for e in simulate(scenario, 1, 1.0) if isinstance(e.message, GimbalAttitude)]
    assert [e.sender for e in sent] == [(1, 154)] * 21
    assert any(b"\x1d\x01\x00" in d.data[7:10] for d in datagrams(scenario, 1, 0.2) if isinstance(d, Datagram))
    assert "gimbal = 154" in daemon_config(scenario)
