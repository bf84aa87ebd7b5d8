"""The paper's noise and first belief, by the numbers that the paper prints."""

import numpy as np

from onboard.estimators.oh_johnson.noise import ANGLES, first_belief, process_noise
from onboard.models import camera_angles
from onboard.models.relative_motion import POSITION, SIZE, STATE_SIZE

FT = 0.3048  # m, exactly, by the agreement of 1959
PRINTED_SIZE = 8.75  # ft
ORIGIN = np.zeros(3)


def test_process_noise_is_that_of_eq_53() -> None:
    in_feet = np.sqrt(np.diag(process_noise(PRINTED_SIZE * FT))) / FT
    np.testing.assert_allclose(in_feet, [5, 5, 5, 10, 10, 10, 0.0875, 2, 2], rtol=1e-12)


def test_measurement_noise_is_that_of_eq_54() -> None:
    np.testing.assert_allclose(np.degrees(np.sqrt(np.diag(ANGLES))), [5, 4, 3], rtol=1e-12)


def test_the_first_belief_is_at_the_measured_angles_and_at_rest_eqs_43_to_51() -> None:
    angles, size = np.array([0.1, -0.05, 0.09]), PRINTED_SIZE * FT
    mean, P = first_belief(angles, size, 0.02 * size, np.eye(3), ORIGIN)
    np.testing.assert_allclose(camera_angles.measure(mean[None], np.eye(3), ORIGIN)[0], angles, rtol=1e-12)
    at_rest = np.ones(STATE_SIZE, bool)
    at_rest[[0, 1, 2, SIZE]] = False
    assert not mean[at_rest].any()
    assert mean[POSITION][0] > 0
    sigmas = np.sqrt(np.diag(P)) / FT
    np.testing.assert_allclose(sigmas, [1, 1, 1, 1, 1, 1, 0.175, 10, 10], rtol=1e-12)
    np.testing.assert_array_equal(P, np.diag(np.diag(P)))
