"""The errors of our attitude that the autopilot states, in the estimate."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from onboard.estimators.leader.tracks.report import with_attitude
from onboard.filters.belief import Belief

KNOWN = np.radians([0.3, 0.3, 1.0])


def test_a_yaw_that_the_autopilot_states_widens_the_estimate_across_the_line_of_sight() -> None:
    """30 m to the north-east: 10 degrees are 5.2 m across, none along; 1 degree is known of already."""
    mean = np.array([30.0 / math.sqrt(2.0), 30.0 / math.sqrt(2.0), -3.0, 1.0, 0.0, 0.0, 2.0])
    belief = Belief(mean, np.eye(7))
    found = with_attitude(belief, (0.0, 0.0, math.radians(10.0)), KNOWN).covariance
    across, along = np.array([-1.0, 1.0, 0.0]) / math.sqrt(2.0), np.array([1.0, 1.0, 0.0]) / math.sqrt(2.0)
    assert math.sqrt(across @ found[:3, :3] @ across - 1.0) == pytest.approx(5.21, abs=0.01)
    assert along @ found[:3, :3] @ along == pytest.approx(1.0)
    assert found[4, 4] > 1.02
    assert_allclose(found[6], np.eye(7)[6])
    assert with_attitude(belief, (0.0, 0.0, math.radians(0.5)), KNOWN) is belief
    tilted = with_attitude(belief, (0.05, 0.05, 0.0), KNOWN).covariance
    assert math.sqrt(tilted[2, 2] - 1.0) == pytest.approx(30.0 * 0.05, rel=0.01)
