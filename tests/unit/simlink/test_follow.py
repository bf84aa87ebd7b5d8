"""The follower's FOLLOW mode, on targets without error."""

import math
from collections.abc import Callable
from itertools import islice, pairwise

import pytest
from msgspec.structs import replace

from onboard.geometry.rotations import euler_from_quaternion
from onboard.messages import FollowTarget
from onboard.wire.mavlink.encode import MavlinkEncoder
from simlink.scenarios.profiles import GaussMarkov
from simlink.scenarios.quadrotor import Quadrotor
from simlink.scenarios.scenario import Scenario, load_scenario
from simlink.simulation import EPOCH_NS, GuidedRun, boot_ns_of
from simlink.world.follow import FollowMode, Target, _approach, following_states
from simlink.world.truth import State

SCENARIO = load_scenario("guided")
STEPS = 200


def calm(wind: tuple[float, float] = (0.0, 0.0), **limits: float) -> Scenario:
    """The scenario in still air or steady wind, with other limits of the mode."""
    assert SCENARIO.follow is not None
    craft = Quadrotor(turbulence=GaussMarkov(), wind=wind)
    return replace(SCENARIO, follow=replace(SCENARIO.follow, craft=craft, **limits))


def heading(s: State) -> float:
    return math.atan2(s.v_L_n[1], s.v_L_n[0])


def fly(
    seconds: float, scenario: Scenario = SCENARIO, sends: Callable[[float], bool] = lambda _: True
) -> tuple[list[State], list[bool]]:
    """States, and whether the mode followed; a target without error every 50 ms."""
    assert scenario.follow is not None
    mode = FollowMode(scenario.follow)
    states, follows = [], []
    for s in islice(following_states(scenario, 1, mode), round(seconds * STEPS)):
        if s.step % 10 == 0 and sends(s.t):
            mode.receive(Target(s.r_OL_n, s.v_L_n, heading(s)), s.t)
        states.append(s)
        follows.append(mode.is_following)
    return states, follows


def slot_error(s: State) -> float:
    c, n = math.cos(heading(s)), math.sin(heading(s))
    (x, y, z) = (-25.0, 0.0, 2.0)
    slot = (s.r_OL_n[0] + c * x - n * y, s.r_OL_n[1] + n * x + c * y, s.r_OL_n[2] + z)
    return math.dist(slot, s.r_OF_n)


def test_it_keeps_its_slot_on_a_straight_leg_and_lags_in_a_turn_seed_1() -> None:
    """In a turn the offset moves at 2.5 m/s, which the mode does not know: it lags by half a second of it."""
    states, follows = fly(50)
    after = [s for s in states if s.t > 12]
    assert all(follows[12 * STEPS :])
    assert max(slot_error(s) for s in after if s.t < 30) < 0.3  # turbulence
    assert 1.0 < max(slot_error(s) for s in after) < 1.8


def test_it_coasts_for_its_timeout_then_brakes_within_its_limits_and_holds_seed_1() -> None:
    """A path of 2.5 m/s^2 and 5 m/s^3, which the body follows by its lean: the nose goes up by 14 degrees."""
    states, follows = fly(28, calm(), sends=lambda t: t < 15)
    assert follows[round(17.9 * STEPS)]
    assert not any(follows[round(18.1 * STEPS) :])
    assert math.hypot(*states[round(17.9 * STEPS)].v_F_n) == pytest.approx(10.0, abs=0.1)
    assert math.hypot(*states[-1].v_F_n) < 0.1
    assert 2.3 < max(math.hypot(*s.a_F_n) for s in states[15 * STEPS :]) < 3.0
    pitch = [math.degrees(euler_from_quaternion(s.q_nF)[1]) for s in states]
    assert min(pitch[12 * STEPS : 17 * STEPS]) == pytest.approx(-5.8, abs=0.3)  # leans against its drag
    assert 10.0 < max(pitch[15 * STEPS :]) < 15.0
    assert max(abs(math.degrees(s.omega_b[1])) for s in states[15 * STEPS :]) < 45.0


def test_it_leans_into_steady_wind_and_keeps_its_slot_seed_1() -> None:
    windy = calm((0.0, 8.0))
    states, _ = fly(30, windy)
    assert slot_error(states[-1]) < 0.1
    assert math.degrees(euler_from_quaternion(states[-1].q_nF)[0]) == pytest.approx(-4.7, abs=0.3)


def test_no_command_leans_it_beyond_its_limit_seed_1() -> None:
    steep = calm(acceleration=20.0, jerk=40.0)
    states, _ = fly(25, steep, sends=lambda t: t < 15)
    lean = [math.acos(1 - 2 * (s.q_nF[1] ** 2 + s.q_nF[2] ** 2)) for s in states]
    assert 27.0 < math.degrees(max(lean)) < 36.0


def test_it_comes_back_from_a_break_off_but_not_beyond_its_greatest_distance_seed_1() -> None:
    def sends(t: float) -> bool:
        return not 12 < t < 24

    straight = replace(SCENARIO, leader=replace(SCENARIO.leader, a_lat_pulses=(), speed_pulses=()))
    states, follows = fly(50, straight, sends)
    assert max(math.dist(s.r_OL_n, s.r_OF_n) for s in states) > 60
    assert follows[-1]
    assert slot_error(states[-1]) < 1.0
    assert straight.follow is not None
    near = replace(straight, follow=replace(straight.follow, dist_max=60.0))
    states, follows = fly(36, near, sends)
    assert not follows[-1]
    assert math.hypot(*states[-1].v_F_n) < 0.2


@pytest.mark.parametrize(("system", "q", "follows"), [(200, True, True), (1, True, False), (200, False, False)])
def test_it_obeys_follow_targets_of_other_systems_that_have_an_attitude(
    system: int, q: bool, follows: bool
) -> None:
    run = GuidedRun(SCENARIO, 1)
    lat, lon, alt = SCENARIO.vehicle.origin
    target = FollowTarget(
        t_ns=boot_ns_of(SCENARIO),
        t_recv_ns=EPOCH_NS,
        lat_deg=lat,
        lon_deg=lon,
        alt_msl=alt + 100.0,
        v_n=(10.0, 0.0, 0.0),
        q_nL=(1.0, 0.0, 0.0, 0.0) if q else None,
        position_sigma=(1.0, 1.0, 1.0),
    )
    frame = MavlinkEncoder(system, 191).encode(target)
    for _ in range(10 * STEPS + 1):
        tick, _ = run.step()
        run.receive(frame, tick)
    assert run.mode.is_following is follows


@pytest.mark.parametrize("gain", [0.5, 1.0, 2.0])
def test_an_error_is_removed_at_a_rate_from_which_the_limit_can_stop(gain: float) -> None:
    """By integration: proportional near the goal, at the deceleration of the limit before; both meet smoothly."""
    limit, error, dt = 2.0, 30.0, 1e-3
    rates = []
    while error > 1e-3:
        rate, *_ = _approach((error, 0.0, 0.0), gain, limit, 100.0)
        rates.append(rate)
        error -= rate * dt
    slowing = [(a - b) / dt for a, b in pairwise(rates)]
    assert max(slowing) == pytest.approx(limit, rel=0.01)
    assert min(slowing) >= 0.0
    assert _approach((0.0, 0.1, 0.0), gain, limit, 100.0) == pytest.approx((0.0, 0.1 * gain, 0.0))
    assert math.hypot(*_approach((30.0, 40.0, 0.0), gain, limit, 5.0)) == pytest.approx(5.0)
