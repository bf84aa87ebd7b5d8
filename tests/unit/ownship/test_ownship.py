"""Our own vehicle's pose and motion between samples, against closed formulas."""

import itertools
import math

import numpy as np
import pytest
from msgspec.structs import replace

from onboard.geometry.rotations import matrix_from_euler, quaternion_from_euler
from onboard.messages import EstimatorStatus, GlobalPosition
from onboard.ownship import Ownship
from tests.support.streams import CIRCLE, EPOCH, MS, S


def circling(t0: float = 5.0, t1: float = 8.0, step_ms: int = 20) -> Ownship:
    own = Ownship(max_extrapolation=0.1)
    for ms in range(round(t0 * 1000), round(t1 * 1000) + 1, step_ms):
        own.receive(CIRCLE.attitude(ms * MS), ms * MS)
        own.receive(CIRCLE.position(ms * MS), ms * MS)
    return own


def global_position(t_ns: int, v: tuple[float, float, float] = (1.0, 2.0, 3.0)) -> GlobalPosition:
    return GlobalPosition(
        t_ns=t_ns,
        t_recv_ns=EPOCH,
        lat_deg=50.0,
        lon_deg=8.0,
        alt_msl=300.0,
        height=40.0,
        v_F_n=v,
        heading_rad=None,
    )


@pytest.mark.parametrize("t", [5.0, 6.0, 6.013, 6.999, 7.5])
def test_interpolation_follows_an_analytic_circle(t: float) -> None:
    pose = circling().pose_at(round(t * S))
    truth = CIRCLE.at(t)
    assert pose is not None
    # linear between samples 20 ms apart: the sagitta of a turn of 2.25 m/s^2 is 1/8 a dt^2
    np.testing.assert_allclose(pose.r_OF_n, truth.r, atol=1.2e-4)
    np.testing.assert_allclose(pose.v_F_n, truth.v, atol=5e-5)
    np.testing.assert_allclose(pose.R_nb, matrix_from_euler(*truth.rpy), atol=1e-6)


def test_attitude_turns_evenly_the_shorter_way_between_samples_of_either_sign() -> None:
    own = Ownship(max_extrapolation=0.1)
    for t_ns, yaw, sign in ((5 * S, 3.0, 1), (5 * S + 20 * MS, -3.0, -1)):
        q = sign * quaternion_from_euler(0, 0, yaw)
        own.receive(replace(CIRCLE.attitude(t_ns), q_nb=tuple(q.tolist())), t_ns)
        own.receive(CIRCLE.position(t_ns), t_ns)
    pose = own.pose_at(5 * S + 5 * MS)
    assert pose is not None
    quarter = 3.0 + (2 * math.pi - 6.0) / 4
    np.testing.assert_allclose(pose.R_nb, matrix_from_euler(0, 0, quarter), atol=1e-12)


def test_attitude_is_carried_on_by_its_rates_and_position_by_its_velocity() -> None:
    pose = circling().pose_at(8 * S + 60 * MS)
    truth = CIRCLE.at(8.06)
    assert pose is not None
    np.testing.assert_allclose(pose.R_nb, matrix_from_euler(*truth.rpy), atol=1e-6)
    np.testing.assert_allclose(pose.r_OF_n, truth.r, atol=1e-3)
    np.testing.assert_allclose(pose.v_F_n, truth.v, atol=3e-3)


def test_extrapolation_ends_at_its_limit_and_never_reaches_back() -> None:
    own = circling()
    assert own.pose_at(8 * S + 100 * MS) is not None
    assert own.pose_at(8 * S + 100 * MS + 1) is None
    assert own.pose_at(5 * S) is not None
    assert own.pose_at(5 * S - 1) is None
    assert own.knows(8 * S)
    assert not own.knows(8 * S + 1)


@pytest.mark.parametrize(("gap_s", "is_known"), [(1.2, True), (2.0, False)])
def test_within_a_long_gap_the_pose_is_not_known(gap_s: float, is_known: bool) -> None:
    """What was between is a guess: an image of then would be placed wrongly."""
    own, end_ns = circling(), 8 * S + round(gap_s * S)
    for m in (CIRCLE.attitude(end_ns), CIRCLE.position(end_ns)):
        own.receive(m, end_ns)
    for t_ns in (8 * S + 1, 8 * S + 300 * MS, end_ns - 1):
        assert (own.pose_at(t_ns) is not None) is is_known
    assert own.pose_at(8 * S) is not None
    assert own.pose_at(end_ns) is not None


@pytest.mark.parametrize(("t0", "t1"), [(5.0, 8.0), (5.003, 5.017), (5.5, 7.513), (5.99, 6.01), (7.0, 8.05)])
def test_steps_are_cut_at_samples_and_integrate_exactly_to_the_velocity(t0: float, t1: float) -> None:
    own = circling()
    steps = list(own.steps(round(t0 * S), round(t1 * S)))
    assert math.isclose(sum(s.dt for s in steps), t1 - t0, abs_tol=1e-9)
    assert max(s.dt for s in steps) <= (0.02 if t1 <= 8.0 else 0.05) + 1e-12
    start, end = own.pose_at(round(t0 * S)), own.pose_at(round(t1 * S))
    assert start is not None
    assert end is not None
    gained = sum(s.dt * s.a for s in steps)
    np.testing.assert_allclose(start.v_F_n + gained, end.v_F_n, atol=1e-12)
    for before, after in itertools.pairwise(steps):
        np.testing.assert_allclose(before.v1, after.v0, atol=1e-12)
    for s in steps:
        np.testing.assert_allclose(s.v1, s.v0 + s.dt * s.a, atol=1e-12)


# ------------------------------------------------------------------------------------ fallback


def test_global_position_stands_back_while_local_comes_and_steps_in_when_it_stops() -> None:
    own = circling()
    assert not own.receive(global_position(8 * S + 10 * MS), 8 * S + 10 * MS)
    assert not own.receive(global_position(9 * S), 9 * S)
    v = tuple(CIRCLE.at(9.0).v.tolist())
    assert own.receive(global_position(9 * S + 1, v), 9 * S + 1)
    assert own.nav_times[-1] == 9 * S + 1
    assert own.receive(CIRCLE.position(9 * S + 20 * MS), 9 * S + 20 * MS)
    assert not own.receive(global_position(9 * S + 30 * MS), 9 * S + 30 * MS)


# ----------------------------------------------------------------------------------- bad samples

NAN, INF = math.nan, math.inf


@pytest.mark.parametrize(
    "bad",
    [
        {"q_nb": (NAN, 0.0, 0.0, 0.0)},
        {"q_nb": (INF, 0.0, 0.0, 0.0)},
        {"q_nb": (0.0, 0.0, 0.0, 0.0)},
        {"q_nb": (3e38, 0.0, 0.0, 0.0)},
        {"omega_b": (0.0, NAN, 0.0)},
        {"omega_b": (0.0, 0.0, -INF)},
        {"omega_b": (0.0, 3e38, 0.0)},
    ],
    ids=str,
)
def test_unusable_attitudes_are_counted_and_leave_no_trace(bad: dict[str, tuple[float, ...]]) -> None:
    own = circling()
    before = own.pose_at(8 * S + 30 * MS)
    own.receive(replace(CIRCLE.attitude(8 * S + 20 * MS), **bad), 8 * S + 20 * MS)
    after = own.pose_at(8 * S + 30 * MS)
    assert own.rejected == {"attitude_unusable": 1}
    assert before is not None
    assert after is not None
    np.testing.assert_array_equal(before.R_nb, after.R_nb)
    assert own.now_ns == 8 * S


def test_a_quaternion_of_single_precision_is_made_of_unit_length() -> None:
    own = Ownship(max_extrapolation=0.1)
    q = tuple((1.01 * quaternion_from_euler(0.1, 0.2, 0.3)).tolist())
    own.receive(replace(CIRCLE.attitude(5 * S), q_nb=q), 5 * S)
    own.receive(CIRCLE.position(5 * S), 5 * S)
    pose = own.pose_at(5 * S)
    assert pose is not None
    assert np.linalg.norm(pose.q_nb) == pytest.approx(1, abs=1e-12)


def test_a_global_position_of_the_same_stamp_does_not_keep_the_local_one_out() -> None:
    """ArduPilot sends both with one stamp, the global one first, in whole centimetres per second."""
    own = Ownship(max_extrapolation=0.1)
    for i in range(5):
        t_ns = 5 * S + i * 20 * MS
        own.receive(CIRCLE.attitude(t_ns), t_ns)
        own.receive(global_position(t_ns, tuple(CIRCLE.at(t_ns / S).v.tolist())), t_ns)
        own.receive(CIRCLE.position(t_ns), t_ns)
    pose = own.pose_at(own.now_ns)
    assert pose is not None
    np.testing.assert_allclose(pose.v_F_n, CIRCLE.at(5.08).v)
    np.testing.assert_allclose(pose.r_OF_n, CIRCLE.at(5.08).r)
    assert own.rejected == {"position_out_of_order": 1}


def test_a_reset_that_the_autopilot_counts_costs_a_second_and_no_velocity() -> None:
    own = circling()
    status = EstimatorStatus(t_ns=8 * S, t_recv_ns=EPOCH, horizontal_velocity=None, horizontal_position=None)
    for resets, doubt in ((7, ""), (7, ""), (8, "the autopilot has reset its filter")):
        own.receive_status(replace(status, resets=resets))
        assert own.doubt == doubt
    stepped = replace(CIRCLE.position(8 * S + 20 * MS), v_F_n=(30.0, 0.0, 0.0))
    assert own.receive(stepped, 8 * S + 20 * MS)
    assert not own.has_misled
