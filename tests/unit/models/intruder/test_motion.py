"""The motion of another aircraft, against matrix exponentials, circles and sums by hand."""

import math

import numpy as np
import pytest
from scipy.linalg import expm

from onboard.models.intruder import measurement, motion
from tests.support.intruder import MODEL, beliefs, complete_step


def test_the_transition_is_the_exponential_of_its_rates_and_the_noise_adds_up() -> None:
    A = np.zeros((15, 15))
    A[:3, 3:6] = A[3:6, 6:9] = np.eye(3)
    A[6:9, 6:9], A[9:12, 9:12], A[12:, 12:] = -np.eye(3) / 8.0, -np.eye(3) / 60.0, -np.eye(3) / 10.0
    F, Q = complete_step(0.7, MODEL)[:2]
    np.testing.assert_allclose(F, expm(0.7 * A), atol=1e-12)
    one, two = complete_step(0.3, MODEL), complete_step(0.4, MODEL)
    np.testing.assert_allclose(two.F @ one.F, F, atol=1e-12)
    np.testing.assert_allclose(two.F @ one.Q @ two.F.T + two.Q, Q, atol=1e-9)


def test_acceleration_bias_and_attitude_error_keep_their_variances() -> None:
    calm = MODEL._replace(gust=np.zeros(3), drift=0.0)
    F, Q = complete_step(0.5, calm)[:2]
    P = np.diag([0.0] * 6 + [2.5**2, 2.5**2, 1.2**2] + [1.0] * 3 + [1e-4, 1e-4, 4e-4])
    after = F @ P @ F.T + Q
    np.testing.assert_allclose(np.diag(after)[6:], np.diag(P)[6:], rtol=1e-9)
    # gusts and our own drift add to velocity and position, by the second
    more = complete_step(0.5, MODEL).Q - Q
    np.testing.assert_allclose(np.diag(more)[3:6], 0.5 * MODEL.gust**2)
    np.testing.assert_allclose(np.diag(more)[:3], 0.5 * 0.2**2 + MODEL.gust**2 * 0.5**3 / 3)


@pytest.mark.parametrize("rate", [0.1, -0.1])
def test_an_aircraft_that_keeps_its_turn_flies_a_circle(rate: float) -> None:
    speed, dt = 30.0, 0.02
    step = motion.step(dt, MODEL._replace(keeps_turn=True, acceleration_time=1e9))
    row = np.zeros((1, 15))
    row[0, 3], row[0, 7] = speed, speed * rate
    start, center = row.copy(), np.array([0.0, speed / rate])
    for _ in range(round(2 * math.pi / abs(rate) / dt)):
        row = motion.propagate(row, step)
        assert np.linalg.norm(row[0, :2] - center) == pytest.approx(speed / abs(rate), rel=0.01)
    np.testing.assert_allclose(row[0, :9], start[0, :9], atol=0.3)
    straight = motion.propagate(start, step._replace(keeps_turn=False))
    assert straight[0, 6] == 0.0  # not turned


def test_looking_back_undoes_a_steady_acceleration() -> None:
    rows, _ = beliefs(5, 1)
    lag = np.array([0.0, 0.5, 1.0, -0.2, 3.0])
    then = np.array([motion.backward_transition(dt) @ row[:9] for dt, row in zip(lag, rows, strict=True)])
    np.testing.assert_allclose(motion.earlier_position(rows, lag), then[:, :3], atol=1e-9)
    bias = np.array([[4.0, 4.0, 10.0]] * 4 + [[2.0, 2.0, 2.0]])  # reports of different kinds
    reports = measurement.report(rows, lag, bias)
    np.testing.assert_allclose(reports, then[:, :6] + np.pad(bias * rows[:, 9:12], ((0, 0), (0, 3))), atol=1e-9)


def test_the_displacement_is_from_the_earlier_position_to_this_one() -> None:
    means, covariances = beliefs(6, 4)
    lag = np.array([0.0, 0.1, 0.5, 1.0, 2.0, -0.3])
    far, spread = motion.displacement(means, covariances, lag)
    np.testing.assert_allclose(far, means[:, :3] - motion.earlier_position(means, lag), atol=1e-9)
    for b in range(6):
        moved = (np.eye(9) - motion.backward_transition(lag[b]))[:3]
        np.testing.assert_allclose(spread[b], moved @ covariances[b, :9, :9] @ moved.T, atol=1e-9)
