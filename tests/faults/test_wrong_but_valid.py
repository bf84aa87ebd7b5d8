"""Own motion that is wrong in good order: it contradicts itself, and within a second no estimate is valid."""

import math
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from onboard.geometry.rotations import matrix_from_quaternion, quaternion_from_euler, quaternion_product
from onboard.messages import Attitude, Estimate, Imu, LocalPosition, Message, TargetPoints
from onboard.messages.causes import Cause
from onboard.ownship import Ownship, StatedMotion
from tests.support.faulty_flight import ITEMS, T0, T1, assert_on_target, clean, flown
from tests.support.streams import (
    CIRCLE,
    EPOCH,
    FOCAL_LENGTH_PX,
    MS,
    Item,
    Run,
    S,
    Stream,
    encode,
    position_error,
    position_nees,
)

BEGINS = 46 * S  # boot time of the fault


def inertial() -> list[Item]:
    """The flight with an accelerometer at 50 Hz."""
    more = []
    for ms in range(round(T0 * 1000), round(T1 * 1000), 20):
        k, t_ns = CIRCLE.at(ms / 1000), ms * MS
        R_nb = matrix_from_quaternion(np.array(CIRCLE.attitude(t_ns).q_nb))
        f_b = R_nb.T @ (k.a - [0.0, 0.0, 9.80665])
        imu = Imu(t_ns=t_ns, t_recv_ns=EPOCH + t_ns, f_b=tuple(f_b.tolist()), omega_b=(0.0, 0.0, 0.0))
        more.append(Item(EPOCH + t_ns + 2 * MS, imu))
    return sorted([*ITEMS, *more], key=lambda item: item.t_recv_ns)


INERTIAL = inertial()


def changed(
    items: list[Item], kind: type[Message], change: Callable[[Any], Message], until: int = round(T1 * S)
) -> Run:
    """The flight with `change` applied to each message of that kind while the fault lasts."""
    hit = lambda m: isinstance(m, kind) and BEGINS <= m.t_ns < until  # noqa: E731
    return flown(encode(Item(i.t_recv_ns, change(i.message) if hit(i.message) else i.message) for i in items))


def beginning(run: Run) -> list[Estimate]:
    """Estimates after the fault has lasted a second, by their arrival."""
    return [e for e in run.estimates if e.t_ns > BEGINS + S]


@cache
def as_good_as_clean() -> float:
    """The greatest error of the same flight without a fault, and a tenth more, m."""
    return 1.1 * max(position_error(e) for e in beginning(clean()))


def assert_noticed(run: Run, why: str) -> None:
    late = beginning(run)
    assert late
    assert not any(e.valid for e in late)
    assert {e.reason for e in late} == {f"our own motion is in doubt: {why}"}


def test_an_attitude_that_hangs_but_for_noise_with_seed_41() -> None:
    rng, q = np.random.default_rng(41), np.array(CIRCLE.attitude(BEGINS).q_nb)
    run = changed(ITEMS, Attitude, lambda m: replace(m, q_nb=tuple((q + rng.normal(size=4) * 1e-6).tolist())))
    assert_noticed(run, "attitude contradicts the body rates")


def test_a_position_that_hangs_but_for_noise_with_seed_42() -> None:
    rng, last = np.random.default_rng(42), np.array(CIRCLE.position(BEGINS).r_OF_n)
    noisy = lambda m: replace(m, r_OF_n=tuple((last + 1e-3 * rng.normal(size=3)).tolist()))  # noqa: E731
    assert_noticed(changed(ITEMS, LocalPosition, noisy), "position contradicts the velocity")


@pytest.mark.parametrize(
    ("speed", "reason"), [(9000.0, "position_unusable"), (100.0, "velocity_leaps"), (12.0, "velocity_leaps")]
)
def test_one_velocity_that_no_aircraft_can_have(speed: float, reason: str) -> None:
    run = changed(ITEMS, LocalPosition, lambda m: replace(m, v_F_n=(speed, -speed, 0.0)), BEGINS + 20 * MS)
    assert run.rejected == {reason: 1}
    assert all(e.valid for e in beginning(run))
    assert max(position_error(e) for e in beginning(run)) < as_good_as_clean()


def faster_north(step: float, *, is_moved: bool) -> Callable[[LocalPosition], LocalPosition]:
    """A step of the velocity, and whether the position moves on by it."""

    def change(m: LocalPosition) -> LocalPosition:
        (north, *rest), moved = m.r_OF_n, step * (m.t_ns - BEGINS) / S if is_moved else 0.0
        return replace(m, r_OF_n=(north + moved, *rest), v_F_n=(m.v_F_n[0] + step, *m.v_F_n[1:]))

    return change


@pytest.mark.parametrize(("step", "until_s"), [(1.3, 9.0), (2.0, 9.0), (2.0, 0.04), (4.0, 9.0)])
def test_a_step_of_the_velocity_costs_a_second_and_an_outlier_itself(step: float, until_s: float) -> None:
    """As at a change of ArduPilot's EKF lane."""
    stepped = faster_north(step, is_moved=step == 4.0)
    run = changed(INERTIAL, LocalPosition, stepped, BEGINS + round(until_s * S))
    invalid = [e for e in run.estimates if not e.valid and e.t_ns > BEGINS]
    if until_s < 1.0:
        assert run.rejected == {"velocity_leaps": 1}
        assert invalid == []
        return
    assert run.rejected == {"velocity_leaps": 3, "velocity_has_leapt": 1}
    assert {e.reason for e in invalid} == {"our own motion is in doubt: velocity has leapt"}
    assert invalid[-1].t_ns < BEGINS + 1.4 * S
    assert all(e.valid for e in run.estimates if e.t_ns > BEGINS + 1.4 * S)
    assert run.estimates[-1].reset_count == clean().estimates[-1].reset_count


def test_a_velocity_that_contradicts_the_position_costs_as_long_as_it_lasts_and_a_second() -> None:
    run = changed(INERTIAL, LocalPosition, faster_north(8.0, is_moved=False), BEGINS + 2 * S)
    assert run.rejected == {"velocity_leaps": 6, "velocity_has_leapt": 1}
    invalid = [e.t_ns for e in run.estimates if not e.valid and e.t_ns > BEGINS]
    assert {e.reason for e in run.estimates if BEGINS + 0.5 * S < e.t_ns < BEGINS + 2 * S} == {
        "our own motion is in doubt: position contradicts the velocity"
    }
    assert BEGINS <= invalid[0] < BEGINS + 0.2 * S
    assert BEGINS + 3.0 * S < invalid[-1] < BEGINS + 3.4 * S  # then images have agreed again


def test_a_yaw_that_is_30_degrees_off_contradicts_the_accelerometer() -> None:
    turned = quaternion_from_euler(0.0, 0.0, math.radians(30.0))
    run = changed(
        INERTIAL,
        Attitude,
        lambda m: replace(m, q_nb=tuple(quaternion_product(turned, np.array(m.q_nb)).tolist())),
    )
    assert {e.reason for e in run.estimates if e.t_ns > BEGINS + 1.5 * S} == {
        "our own motion is in doubt: velocity contradicts the accelerometer"
    }
    assert not any(e.valid for e in run.estimates if e.t_ns > BEGINS + 1.5 * S)


def test_what_was_estimated_from_doubtful_motion_is_forgotten() -> None:
    last = CIRCLE.attitude(BEGINS)
    run = changed(ITEMS, Attitude, lambda m: replace(m, q_nb=last.q_nb), BEGINS + 2 * S)
    assert_on_target(run, 1.5)
    after = [e for e in run.estimates if e.valid and e.t_ns > BEGINS + S]
    assert after[0].t_ns > BEGINS + 2.9 * S
    assert max(position_nees(e) for e in after if e.t_ns > BEGINS + 4 * S) < 4.0  # the track is new, and says so
    assert position_error(run.estimates[-1]) < 1.5
    assert run.estimates[-1].reset_count > clean().estimates[-1].reset_count


def shown(points: np.ndarray) -> dict[str, tuple[float, float]]:
    return {name: (float(u), float(v)) for name, (u, v) in zip(("center", "left", "right"), points, strict=True)}


def beside(m: TargetPoints) -> TargetPoints:
    """An object of half the size, three metres to the right of the leader."""
    center, half = np.array(m.center) + np.array((3 / 28, 0.0)), (np.array(m.right) - np.array(m.left)) / 4
    return replace(m, **shown(np.array([center, center - half, center + half])))


def test_a_leader_that_another_object_has_replaced_for_three_seconds_stays_in_doubt() -> None:
    run = changed(ITEMS, TargetPoints, beside, BEGINS + 3 * S)
    later = [e for e in run.estimates if e.t_ns > BEGINS + 1.3 * S]
    assert not any(e.valid for e in later)
    assert later[-1].cause is Cause.LEAPT
    assert position_error(later[-1]) < 3.0  # it is new: not sharp yet


def test_a_detector_that_is_4_times_as_noisy_is_taken_so_and_told_with_seed_44() -> None:
    """Twelve seconds of it: the filter's innovations say so."""
    rng = np.random.default_rng(44)

    def noisy(m: TargetPoints) -> TargetPoints:
        points = np.array([m.center, m.left, m.right])
        return replace(m, **shown(points + 4.0 / FOCAL_LENGTH_PX * rng.normal(size=(3, 2))))

    items = Stream(t0=T0, t1=T0 + 12.0, seed=None).items()
    run = flown(
        encode(
            Item(i.t_recv_ns, noisy(i.message) if isinstance(i.message, TargetPoints) else i.message)
            for i in items
        )
    )
    last = run.estimates[-1]
    assert last.valid
    assert "the images fit worse than the configured noise explains" in last.reason
    assert 3.0 < run.reports[-1].noise_scale < 5.5
    late = [e for e in run.estimates if e.valid and e.t_ns > (T0 + 6.0) * S]
    assert np.mean([position_nees(e) for e in late]) < 3.0


@pytest.mark.parametrize("late_ms", [0, 25])
def test_datagrams_that_come_twice_count_once(late_ms: int) -> None:
    """A router and a bridge forward one link."""
    once = encode(INERTIAL)
    again = [replace(d, t_recv_ns=d.t_recv_ns + late_ms * MS) for d in once]
    twice = sorted([*once, *again], key=lambda d: d.t_recv_ns)
    run = flown(twice)
    assert run.rejected == {"repeated": flown(once).pipeline._decoder.frames.total()}
    assert [e.mean for e in run.estimates] == [e.mean for e in clean().estimates]


def test_our_own_state_is_no_second_source_beside_what_comes_again() -> None:
    """With other frames than before: as by another link of the autopilot."""
    own = Ownship(max_extrapolation=0.1, source="own_state")
    for ms in range(0, 4000, 20):
        a, p = CIRCLE.attitude(ms * MS), CIRCLE.position(ms * MS)
        tilted = quaternion_product(np.array(a.q_nb), quaternion_from_euler(0.0, 0.0, math.radians(4.0)))
        state = StatedMotion(tuple(tilted.tolist()), a.omega_b, (0.02,) * 3, p.r_OF_n, p.v_F_n, (0.1,) * 3)
        for message in (a, p, a, p):
            own.receive(message, ms * MS, state)
    assert own.source_changes["attitude_from_own_state.own_state_is_surer"] == 1
    assert own.doubt == ""
