"""The own-state estimator on messages made by hand."""

import numpy as np
import pytest
from msgspec.structs import replace
from numpy.testing import assert_allclose

from onboard.geometry.rotations import quaternion_from_vector, quaternion_product
from onboard.messages import Imu, Message
from tests.support.cases import slow_but
from tests.support.own_vehicle import (
    GRAVITY,
    MS,
    attitude,
    fix,
    heartbeat,
    hovering,
    imu,
    pipeline,
    states_of,
)

AXES = ((0, 1, 0), (1, 0, 0), (0, 0, 1), (0.6, 0.8, 0.0))


@pytest.mark.parametrize(
    ("name", "axis"),
    slow_but(
        [("csvsf-adaptive", AXES[0]), ("cubature", AXES[2]), ("csvsf-printed", AXES[-1])],
        [(name, axis) for name in ("cubature", "csvsf-adaptive", "csvsf-printed") for axis in AXES],
    ),
)
def test_through_pitch_90_degrees_and_the_wrap_of_yaw_there_is_no_jump(name: str, axis: tuple[float, ...]) -> None:
    """Three full turns at 2.5 rad/s about each axis; the specific force is that of standing still."""
    p, omega = pipeline(filter=name), 2.5 * np.array(axis)
    messages: list[Message] = [heartbeat()]
    truth = {}
    for t in range(1000, 9500, 10):
        q = quaternion_from_vector(omega * (t - 1000) * 1e-3)
        truth[t] = q
        down_b = quaternion_product(quaternion_product([q[0], *-q[1:]], [0, 0, 0, -GRAVITY]), q)[1:]
        messages += [imu(t, down_b, omega), attitude(t, q, omega)]
        messages += [fix(t)] if t % 100 == 0 else []
    states = [s for s in states_of(p, messages) if s.mean is not None]
    assert len(states) > 300
    assert np.isfinite([s.mean for s in states]).all()
    errors = [1 - abs(float(np.dot(truth[s.t_ns // MS], s.q_nb))) for s in states]
    assert max(errors) < 1e-6  # 1 - cos(half the angle): 0.003 rad
    velocity = np.array([s.mean[3:6] for s in states])
    assert np.abs(velocity).max() < 0.0125
    assert np.abs(np.diff(velocity, axis=0)).max() < 0.0092
    assert states[-1].reset_count == 0


def test_a_late_fix_gives_the_same_state_as_one_in_order_seed_1() -> None:
    rng = np.random.default_rng(1)
    prompt: list[Message] = []
    late: list[tuple[int, Message]] = []
    for t in range(1000, 6000, 10):
        q = quaternion_from_vector(0.01 * rng.normal(size=3))
        for m in (imu(t, [*0.3 * rng.normal(size=2), -GRAVITY]), attitude(t, q, 0.01 * rng.normal(size=3))):
            prompt.append(m)
            late.append((t, m))
        if t % 100 == 50 and t < 5800:
            m = fix(t, rng.normal(size=3), 0.1 * rng.normal(size=2))
            prompt.append(m)
            late.append((t + 143, m))
    in_order = states_of(pipeline(), [heartbeat(), *prompt])[-1]
    delayed = states_of(pipeline(), [heartbeat(), *[m for _, m in sorted(late, key=lambda x: x[0])]])[-1]
    assert in_order.t_ns == delayed.t_ns
    assert_allclose(delayed.mean, in_order.mean, atol=1e-9)
    assert_allclose(delayed.covariance, in_order.covariance, atol=1e-9)


def test_irregular_rates_drop_outs_and_partial_fixes_seed_3() -> None:
    rng = np.random.default_rng(3)
    messages: list[Message] = [heartbeat()]
    for t in range(1000, 15000, 5):
        messages += [imu(t)] if rng.random() < 0.3 else []
        messages += [attitude(t)] if rng.random() < 0.1 else []
        if rng.random() < 0.02:
            whole = fix(t, 0.3 * rng.normal(size=3), 0.1 * rng.normal(size=2))
            partial = replace(whole, ground_speed=None, course_rad=None, h_acc=None, v_acc=None)
            messages.append(whole if rng.random() < 0.5 else replace(partial, alt_msl=whole.alt_msl))
    states = states_of(pipeline(filter="csvsf-robust"), messages)
    assert states[-1].reset_count == 0
    assert np.isfinite([s.mean for s in states if s.mean]).all()
    position, velocity, angles, rates = np.reshape(states[-1].mean, (4, 3))
    assert_allclose(position, np.zeros(3), atol=0.6)
    assert_allclose(velocity, np.zeros(3), atol=0.2)
    assert_allclose(np.concatenate([angles, rates]), np.zeros(6), atol=1e-3)  # the attitude here has no noise


def test_with_the_thrust_only_a_sideways_push_is_estimated() -> None:
    """3 m/s^2 east from 4 s to 6 s, measured by the lateral accelerometer or not used: both follow."""
    for force, limit in (("accelerometer", 0.024), ("thrust", 0.4)):
        messages: list[Message] = [heartbeat()]
        v = r = 0.0
        error = []
        p = pipeline(force=force)
        for t in range(1000, 9000, 10):
            a = 3.0 if 4000 <= t < 6000 else 0.0
            messages = [imu(t, (0, a, -GRAVITY)), attitude(t)]
            r, v = r + 0.01 * v + 5e-5 * a, v + 0.01 * a
            messages += [fix(t, (0, r, 0), (0, v))] if t % 100 == 0 else []
            messages = [heartbeat(), *messages] if t == 1000 else messages
            error += [s.mean[4] - v for s in states_of(p, messages) if s.mean is not None]
        assert np.abs(error).max() < limit, force


@pytest.mark.parametrize("name", slow_but(["csvsf-adaptive"], ["cubature", "csvsf-adaptive"]))
def test_a_step_of_the_barometer_moves_nothing_and_becomes_the_new_datum(name: str) -> None:
    p, datum = pipeline(filter=name), 620.0
    messages: list[Message] = [heartbeat()]
    for message in hovering(1000, 25000):
        t_ms = message.t_ns // MS
        if t_ms >= 11000:
            datum = 623.0  # a door opened, or the ground was left
        messages.append(replace(message, pressure_altitude=datum) if isinstance(message, Imu) else message)
    states = [s for s in states_of(p, messages) if s.valid and s.t_ns > 10000 * MS]
    assert max(abs(s.mean[5]) for s in states) < 1.1e-5
    assert abs(states[-1].mean[5]) < 6e-6
    assert abs(states[-1].mean[2]) < 1e-5
    assert (states[-1].reset_count, states[-1].faults) == (0, ())


@pytest.mark.parametrize(
    ("vehicle_type", "is_followed"), [(2, True), (13, True), (0, True), (1, True), (12, False), (10, False)]
)
def test_only_what_flies_is_estimated(vehicle_type: int, is_followed: bool) -> None:
    """A submarine was 6.5 m/s off, and valid. A restart does not forget it."""
    p, kind = pipeline(), replace(heartbeat(), vehicle_type=vehicle_type)
    for begin in (1000, 500):  # the autopilot reboots
        last = states_of(p, [kind, *hovering(begin, begin + 3000)])[-1]
        assert last.valid is is_followed
        if not is_followed:
            assert last.cause == "other_vehicle"
            assert {12: "submarine", 10: "rover"}[vehicle_type] in last.reason
