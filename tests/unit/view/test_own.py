"""Our own state in the view: estimate, autopilot and truth in the same plots."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from onboard.geometry.rotations import quaternion_from_euler
from tests.support.vehicle_records import nav_state, truth

pytest.importorskip("rerun")

from onboard.view import own
from onboard.view.memory import Memory
from tests.support.view_flight import (
    Drawn,
    Kept,
)


def test_without_a_state_curves_have_gaps() -> None:
    kept, memory = Kept(), Memory()
    own.plot_state(kept, memory, nav_state(mean=None, covariance=None, q_nb=None, quality=-1))
    assert np.isnan(kept.values["plots/own/down/estimate"]).all()


@pytest.mark.parametrize("t_ms", [4998, 4990])  # of a state, and between two
@pytest.mark.parametrize("truth_first", [True, False])
def test_errors_are_those_of_a_truth_at_its_own_time(truth_first: bool, t_ms: int) -> None:
    kept, memory = Drawn(), Memory()
    q = tuple(quaternion_from_euler(0.0, 0.0, math.pi / 2 + 0.1).tolist())
    before, same = truth(4_900_000_000, v_F_n=(9, 9, 9)), truth(t_ms * 1_000_000, v_F_n=(3.5, 5, 6), q_nF=q)
    own.show_state(kept, memory, nav_state(4980), ())
    if truth_first:
        memory.truths.extend([before, same])
        own.show_state(kept, memory, nav_state(5000), ())
    else:
        own.show_state(kept, memory, nav_state(5000), ())
        for one in (before, same):
            own.plot_truth(kept, memory, one)
    assert_allclose(kept.values["plots/own/velocity_error/error"], [0.5, 0.0, 0.0])
    assert_allclose(kept.values["plots/own/attitude_error/error"], [0.0, 0.0, math.degrees(-0.1)], atol=1e-9)
    assert_allclose(kept.values["plots/own/velocity_error/band"], [3 * math.sqrt(6), -3 * math.sqrt(6)])
