"""The source of our own motion: the surer one, without a jump, and for a counted reason."""

import math

import numpy as np
import pytest

from onboard.messages import Attitude, LocalPosition, Quaternion, Vec3
from onboard.ownship import Ownship, StatedMotion
from onboard.ownship.source import Wanted

MS, S = 1_000_000, 1_000_000_000
STILL: Vec3 = (0.0, 0.0, 0.0)


def about_down(yaw: float) -> Quaternion:
    return math.cos(0.5 * yaw), 0.0, 0.0, math.sin(0.5 * yaw)


def stated(sigma: float, *, yaw: float = 0.0, v: Vec3 = STILL) -> StatedMotion:
    return StatedMotion(about_down(yaw), STILL, (sigma,) * 3, (5.0, 6.0, 7.0), v, (0.05,) * 3)


def yaws(own: Ownship, noise: float, stated_at: dict[float, StatedMotion | None], until: float) -> list[float]:
    """Our yaw at each attitude of a hovering vehicle whose yaw has white noise, seed 71. `stated_at`: what the
    estimator states from a time on."""
    rng, made, own_motion = np.random.default_rng(71), [], None
    for k in range(round(until * 100)):
        t_ns = 5 * S + k * 10 * MS
        own_motion = stated_at.get(k / 100, own_motion)
        q = about_down(noise * rng.normal())
        own.receive(Attitude(t_ns=t_ns, t_recv_ns=t_ns, q_nb=q, omega_b=STILL), t_ns, own_motion)
        own.receive(LocalPosition(t_ns=t_ns, t_recv_ns=t_ns, r_OF_n=STILL, v_F_n=STILL), t_ns, own_motion)
        pose = own.pose_at(t_ns)
        assert pose is not None
        made.append(2 * math.atan2(pose.q_nb[3], pose.q_nb[0]))
    return made


@pytest.mark.parametrize(
    ("source", "sigma", "is_own"),
    [
        ("auto", 0.001, True),
        ("auto", 0.009, False),
        ("own_state", 0.009, True),
        ("autopilot", 0.001, False),
    ],
)
def test_the_surer_ones_attitude_counts(source: Wanted, sigma: float, is_own: bool) -> None:
    own = Ownship(max_extrapolation=0.1, source=source)
    made = yaws(own, 0.01, {0.0: stated(sigma)}, 6.0)
    assert (np.std(made[400:]) < 0.001) == is_own
    pose = own.pose_at(own.now_ns)
    assert pose is not None
    assert pose.attitude_noise[2] == pytest.approx(sigma if is_own else 0.01, rel=0.3)


def test_both_are_taken_where_they_are_wanted() -> None:
    own = Ownship(max_extrapolation=0.1, source="own_state")
    yaws(own, 0.01, {0.0: stated(0.001, v=(0.3, 0.0, 0.0))}, 6.0)
    pose = own.pose_at(own.now_ns)
    assert pose is not None
    np.testing.assert_allclose(pose.v_F_n, [0.3, 0.0, 0.0])
    np.testing.assert_allclose(pose.r_OF_n, [5.0, 6.0, 7.0])


def test_a_change_of_source_and_a_loss_are_no_jumps() -> None:
    own = Ownship(max_extrapolation=0.1, source="own_state")
    made = yaws(own, 0.0, {2.0: stated(0.001, yaw=0.03), 6.0: None}, 10.0)
    assert max(np.abs(np.diff(made))) < 0.03 / 100 * 1.1  # within a second, at 100 Hz
    assert made[150] == 0.0
    assert made[550] == pytest.approx(0.03, rel=1e-4)
    assert made[-1] == pytest.approx(0.0, abs=1e-9)
    assert own.source_changes["attitude_from_autopilot.own_state_is_not_valid"] == 1


def test_an_estimator_that_contradicts_the_autopilot_does_not_count() -> None:
    own = Ownship(max_extrapolation=0.1, source="own_state")
    made = yaws(own, 0.001, {0.0: stated(0.001), 4.0: stated(0.001, yaw=0.2)}, 8.0)
    assert own.source_changes["attitude_from_autopilot.own_state_contradicts_it"] == 1
    assert abs(made[-1]) < 0.01


@pytest.mark.parametrize(
    ("source", "off", "used"), [("auto", 0.3, "the autopilot's"), ("own_state", 0.3, "ours"), ("auto", 0.18, None)]
)
def test_a_velocity_that_is_off_by_less_than_a_fault_is_said(source: Wanted, off: float, used: str | None) -> None:
    """In strong vibration an autopilot's velocity was off by 0.3 m/s for two minutes, beside the slope of its own
    positions: a bias is no white noise, so that `auto` keeps it, and too small for a contradiction."""
    own, estimated = Ownship(max_extrapolation=0.1, source=source), stated(0.001, v=(off, 0.0, 0.0))
    for k in range(1500):
        t_ns, r = 5 * S + k * 10 * MS, (0.01 * off * k, 0.0, 0.0)
        now = estimated._replace(r_OF_n=r)
        own.receive(Attitude(t_ns=t_ns, t_recv_ns=t_ns, q_nb=about_down(0.0), omega_b=STILL), t_ns, now)
        own.receive(LocalPosition(t_ns=t_ns, t_recv_ns=t_ns, r_OF_n=r, v_F_n=STILL), t_ns, now)
        if k == 900:
            assert own.velocity_bias is None
    pose, reported = own.pose_at(own.now_ns), own.velocity_bias
    assert pose is not None
    assert (pose.v_F_n[0], own.doubt) == (off if source == "own_state" else 0.0, "")
    assert (reported is not None) is (used is not None)
    assert reported is None or f"differed by 0.30 m/s for 10 s; {used} is used" in reported.words
