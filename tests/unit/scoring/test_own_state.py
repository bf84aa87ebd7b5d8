"""Scores of our own state, against errors made by hand."""

import math

import msgspec
import pytest

from onboard.messages import Fault, FaultKind, NavState, Truth
from onboard.scoring.own_state import score_own_state
from tests.support.vehicle_records import nav_state, truth

TURN = math.radians(4.0)


def flight(off: float) -> tuple[list[NavState], list[Truth]]:
    """40 s at 10 Hz, the velocity off by `off` to the north (sigma 2 m/s), the attitude by 4 degrees."""
    fault = Fault(kind=FaultKind.MOTOR, part="motor 2", t_onset_ns=30_250_000_000, magnitude=0.3, unit="lost")
    q = (math.cos(TURN / 2), 0.0, math.sin(TURN / 2), 0.0)
    states, truths = [], []
    for t in range(1000, 41000, 100):
        mean = (0.0, 0.0, 0.0, 1.0, 2.0, 3.0, 0.0, TURN, 0.0, 0.0, 0.0, 0.0)
        states.append(nav_state(t, mean=mean, q_nb=q, faults=(fault,) if t > 30000 else ()))
        truths.append(truth(t * 1_000_000 + 500_000, v_F_n=(1.0 + off, 2.0, 3.0)))
    return states, truths


def test_errors_are_those_put_in() -> None:
    score = score_own_state(*flight(0.5))
    assert score is not None
    assert score.velocity_rmse_m_s == pytest.approx(0.5)
    assert score.attitude_rmse_deg == pytest.approx(4.0)
    assert score.inside_3_sigma_percent == 100.0
    # variances 4 of the north velocity, and 8 rad^2 about b's y axis, about which the attitude is off
    assert score.nees_mean == pytest.approx(0.5**2 / 4 + TURN**2 / 8)
    assert score.nees_dof == 6
    assert score.nees_bounds == pytest.approx((1.237, 14.449), abs=0.001)
    assert (score.states, score.valid, score.resets) == (400, 400, 258)
    assert score.faults == ("motor 2 at 30.25 s",)


def test_three_sigmas_are_three_of_the_states_own() -> None:
    outside = score_own_state(*flight(6.1))  # the variance of the north velocity is 4
    assert outside is not None
    assert outside.inside_3_sigma_percent == pytest.approx(200 / 3)


def test_states_that_are_not_valid_are_not_judged() -> None:
    """Those of the first half are off by 50 m/s and turned over, and say that they are not to be believed."""
    states, truths = flight(0.5)
    lost = [
        msgspec.structs.replace(s, valid=False, mean=(*s.mean[:3], 51.0, *s.mean[4:]), q_nb=(0.0, 1.0, 0.0, 0.0))
        for s in states[:200]
    ]
    score = score_own_state([*lost, *states[200:]], truths)
    assert score is not None
    assert (score.states, score.valid) == (400, 200)
    assert score.velocity_rmse_m_s == pytest.approx(0.5)
    assert score.attitude_rmse_deg == pytest.approx(4.0)
    assert score.inside_3_sigma_percent == 100.0


def test_the_first_seconds_are_not_judged_and_no_state_far_from_a_truth() -> None:
    states, truths = flight(0.5)
    early = [truth(t.t_ns, v_F_n=(99.0, 0.0, 0.0)) for t in truths[:95]]  # the first ten seconds begin at 1 s
    score = score_own_state(states, [*early, *truths[105:]])
    assert score is not None
    assert score.velocity_rmse_m_s == pytest.approx(0.5)
    between = [truth(t.t_ns + 50_000_000, v_F_n=(99.0, 0.0, 0.0)) for t in truths]
    alone = score_own_state(states, between)
    assert alone is not None
    assert alone.velocity_rmse_m_s is None


def test_without_truth_or_states_there_is_less_to_say() -> None:
    states, _ = flight(0.0)
    score = score_own_state(states, [])
    assert score is not None
    assert (score.velocity_rmse_m_s, score.inside_3_sigma_percent, score.nis_ratio) == (None, None, 1.0)
    assert (score.nees_mean, score.nees_dof, score.nees_bounds) == (None, 0, None)
    assert score_own_state([], []) is None


def test_time_without_a_valid_state_stands_beside_the_errors() -> None:
    """40 s at 10 Hz, settled from 11 s on; from 26 s to the end at 41 s not valid."""
    states, truths = flight(0.5)
    lost = [msgspec.structs.replace(s, valid=s.t_ns < 26_000_000_000) for s in states]
    score = score_own_state(lost, truths)
    assert score is not None
    assert score.valid_percent == pytest.approx(50.0, abs=0.5)
    silent = score_own_state([s for s in lost if s.valid], truths)
    assert silent is not None
    assert silent.valid_percent == pytest.approx(100 * 15.5 / 30.0, abs=0.5)
