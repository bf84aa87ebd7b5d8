"""ODOMETRY as an independent parser reads it, against numbers worked out by hand."""

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pymavlink.dialects.v20 import ardupilotmega as dialect

from onboard.autopilot.odometry import OdometryStream
from onboard.config import ConfigError, parse_config
from onboard.geometry.rotations import (
    matrix_from_quaternion,
    quaternion_from_euler,
    quaternion_from_vector,
    quaternion_product,
)
from onboard.wire.odometry import odometry_of
from tests.support.vehicle_records import EAST, nav_state


def parsed(frames: list[bytes]) -> list[Any]:
    parser = dialect.MAVLink(None)
    return [m for data in frames for m in parser.parse_buffer(data) or []]


def test_what_a_parser_reads_is_the_state_in_local_ned_and_in_the_body() -> None:
    (m,) = parsed(OdometryStream(7, 191, rate_hz=30.0).frames(nav_state()))
    assert m.get_type() == "ODOMETRY"
    assert (m.get_srcSystem(), m.get_srcComponent()) == (7, 191)
    assert (m.time_usec, m.frame_id, m.child_frame_id) == (5_000_000, 1, 12)  # LOCAL_NED, BODY_FRD
    assert (m.x, m.y, m.z) == (1.0, 2.0, -3.0)
    assert_allclose(m.q, EAST, atol=1e-7)
    assert_allclose((m.vx, m.vy, m.vz), (5.0, -4.0, 6.0), atol=1e-6)  # nose east: forward is east, right is south
    assert_allclose((m.rollspeed, m.pitchspeed, m.yawspeed), (0.1, 0.2, 0.3), atol=1e-7)
    assert (m.reset_counter, m.quality, m.estimator_type) == (2, 87, 5)
    pose = np.zeros((6, 6))
    pose[np.triu_indices(6)] = m.pose_covariance
    assert_allclose(np.diag(pose), [1, 2, 3, 7, 8, 9])
    speed = np.zeros((6, 6))
    speed[np.triu_indices(6)] = m.velocity_covariance
    # east's variance 5 forward, north's 4 right; and v x of the attitude's 7, 8, 9 with v = (5, -4, 6) in b
    expected = [5 + 36 * 8 + 16 * 9, 4 + 36 * 7 + 25 * 9, 6 + 16 * 7 + 25 * 8, 10, 11, 12]
    assert_allclose(np.diag(speed), expected, rtol=1e-6)


def test_the_bodys_velocity_and_the_attitude_err_together_as_the_covariance_says_seed_3() -> None:
    """Of a full covariance, by drawing states from it: an error of the attitude turns the velocity, too."""
    rng = np.random.default_rng(3)
    root = rng.normal(size=(12, 12)) * np.repeat([1.0, 0.5, 0.02, 0.1], 3)[:, None]
    P, q, v_n = root @ root.T, quaternion_from_euler(0.3, -0.2, 1.1), np.array([4.0, 5.0, 6.0])
    mean = (1.0, 2.0, -3.0, *v_n, 0.3, -0.2, 1.1, 0.1, 0.2, 0.3)
    state = nav_state(mean=mean, q_nb=tuple(q.tolist()), covariance=tuple(map(tuple, P.tolist())))
    draws = rng.multivariate_normal(np.zeros(12), P, 20_000)
    v_b = [
        matrix_from_quaternion(quaternion_product(q, quaternion_from_vector(d[6:9]))).T @ (v_n + d[3:6])
        for d in draws
    ]
    expected = np.cov(np.column_stack([v_b, draws[:, 9:]]).T)
    odometry = odometry_of(state)
    assert odometry is not None
    speed = np.zeros((6, 6))
    speed[np.triu_indices(6)] = odometry.velocity_covariance
    sigma = np.sqrt(np.diag(expected))
    assert_allclose(np.diag(speed), np.diag(expected), rtol=0.05)
    assert_allclose(speed / np.outer(sigma, sigma), np.triu(expected) / np.outer(sigma, sigma), atol=0.03)


def test_a_state_that_is_not_valid_says_so_and_one_that_is_not_there_is_not_sent() -> None:
    lost = odometry_of(nav_state(valid=False))
    assert lost is not None
    assert lost.quality == -1
    assert odometry_of(nav_state(mean=None, covariance=None, q_nb=None)) is None


def test_no_more_are_sent_than_asked_and_a_reboot_does_not_end_them() -> None:
    stream = OdometryStream(1, 191, rate_hz=25.0)
    assert sum(len(stream.frames(nav_state(t))) for t in range(1000, 3000, 10)) == pytest.approx(50, abs=1)
    assert len(stream.frames(nav_state(100))) == 1


def test_a_link_that_does_not_exist_is_a_mistake_of_the_configuration() -> None:
    with pytest.raises(ConfigError, match=r"odometry\.link: no link has the name 'gcs'"):
        parse_config({"odometry": {"link": "gcs"}})
    assert parse_config({"odometry": {"link": "camera"}}).odometry.rate_hz == 30.0
