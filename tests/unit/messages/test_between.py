"""Our own state at a time between its records."""

import math

import numpy as np
import pytest

from onboard.geometry.rotations import quaternion_from_vector
from onboard.messages import NavState
from onboard.messages.between import nav_state_at
from tests.support.vehicle_records import nav_state

MS = 1_000_000


def turning(t_ms: int) -> NavState:
    """At 3 m/s north and turning at 2 rad/s, faster and faster downwards."""
    q = quaternion_from_vector(np.array([0.0, 0.0, 2e-3 * t_ms]))
    sign = -1.0 if t_ms % 40 else 1.0  # the same attitude with the other sign
    mean = (3e-3 * t_ms, 0.0, 0.0, 3.0, 0.0, 1e-3 * t_ms, *(0.0,) * 6)
    return nav_state(t_ms, mean=mean, q_nb=tuple((sign * q).tolist()))


STATES = [turning(t) for t in range(0, 200, 20)]


@pytest.mark.parametrize("t_ms", [50, 53, 47])
def test_between_two_records_position_velocity_and_attitude_are_interpolated(t_ms: int) -> None:
    state = nav_state_at(STATES, t_ms * MS)
    assert state is not None
    assert state.mean is not None
    assert state.q_nb is not None
    assert state.t_ns in {t_ms * MS, *(s.t_ns for s in STATES)}
    t = state.t_ns / MS
    assert state.mean[:6] == pytest.approx((3e-3 * t, 0.0, 0.0, 3.0, 0.0, 1e-3 * t))
    assert 2 * math.atan2(state.q_nb[3], state.q_nb[0]) % (2 * math.pi) == pytest.approx(2e-3 * t, abs=1e-6)


def test_a_record_of_nearly_the_same_time_is_taken_as_it_is() -> None:
    assert nav_state_at(STATES, 64 * MS) is STATES[3]
    assert nav_state_at(STATES, 60 * MS) is STATES[3]


def test_nothing_is_known_outside_or_in_a_gap() -> None:
    assert nav_state_at([], 0) is None
    assert nav_state_at(STATES, 190 * MS) is None
    assert nav_state_at([STATES[0], STATES[3]], 30 * MS) is None
    silent = nav_state(20, mean=None, covariance=None, q_nb=None)
    assert nav_state_at([STATES[0], silent, STATES[2]], 11 * MS) is None
