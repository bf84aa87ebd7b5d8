"""The setpoint modes of both autopilots, on setpoints alone.

`REAL` has figures of one flight each of an ArduCopter 4.7-dev and a PX4 1.17 in their own simulators, on setpoints
at 25 Hz: `straight` with silence from 8 m/s on, and `step_east`. Their vehicles have more drag than simlink's.
"""

import math
from collections.abc import Callable, Iterable
from itertools import islice, pairwise, repeat

import pytest
from msgspec.structs import replace

from onboard.messages import CurrentMode, Heartbeat, LandedState, Message, Setpoint, Vec3
from onboard.wire.mavlink.decode import MavlinkDecoder
from onboard.wire.mavlink.encode import MavlinkEncoder
from simlink.scenarios.formation import Follow
from simlink.scenarios.profiles import GaussMarkov
from simlink.scenarios.quadrotor import Quadrotor
from simlink.scenarios.scenario import Scenario, load_scenario
from simlink.simulation import EPOCH_NS, GuidedRun
from simlink.world.guided import GuidedMode, approach_rate
from simlink.world.offboard import OffboardMode, prioritized_sum
from simlink.world.quadrotor import QuadrotorState, quadrotor_states
from simlink.world.quadrotor_control import Reference
from simlink.world.setpoint_mode import SetpointMode, Target

STEPS = 200
BEGIN = 1.0  # s, when the mode is entered
AT_REST = (0.0, 0.0, 0.0)
MODES = (GuidedMode, OffboardMode)
DRAG: dict[type[SetpointMode], float] = {GuidedMode: 0.5, OffboardMode: 0.2}  # 1/s, as the real ones have
# Seconds of silence and speeds then (m/s), farthest way in silence (m), seconds to 9 m of a step of 10 m, and the
# step's greatest speed (m/s), the most beyond a stop from 8 m/s (m)
REAL: dict[type[SetpointMode], tuple[dict[float, float], float, float, float, float]] = {
    GuidedMode: ({0.9: 8.0, 1.5: 7.5, 2.0: 6.3, 3.0: 3.9, 4.0: 1.2}, 23.5, 3.8, 3.8, 0.8),
    OffboardMode: ({0.5: 7.4, 1.0: 5.0, 1.5: 3.7, 2.0: 3.3, 3.0: 1.1, 4.0: 0.8}, 14.2, 2.1, 6.5, 0.45),
}
Course = Callable[[float], Target | None]


def fly(
    kind: type[SetpointMode], course: Course, seconds: float, drag: float = 0.1
) -> tuple[SetpointMode, list[QuadrotorState]]:
    """The mode, and the states from its entry on, from rest at O in still air; a setpoint every 40 ms, at a time
    since the entry; before, the vehicle's own place."""
    craft = Quadrotor(turbulence=GaussMarkov(), drag=drag)
    mode, states = kind(Follow(engage=BEGIN, craft=craft)), []
    hover = Reference(AT_REST, AT_REST, AT_REST, 0.0)
    flight = quadrotor_states(craft, 1, repeat(hover), 1.0 / STEPS, mode)
    for step, state in enumerate(islice(flight, round((BEGIN + seconds) * STEPS))):
        t = step / STEPS - BEGIN
        target = course(max(t, 0.0))
        if step % 8 == 0 and target is not None:
            mode.receive(target, step / STEPS)
        states += [state] if t >= 0.0 else []
    return mode, states


def straight(t: float) -> Target:
    """North: 2 m/s^2 for 4 s, 8 m/s until 10 s, and 2 m/s^2 to a stop at 14 s, 80 m away."""
    if t < 4.0:
        return Target((t * t, 0.0, 0.0), (2.0 * t, 0.0, 0.0), (2.0, 0.0, 0.0), 0.0)
    if t < 10.0:
        return Target((16.0 + 8.0 * (t - 4.0), 0.0, 0.0), (8.0, 0.0, 0.0), AT_REST, 0.0)
    if t < 14.0:
        s = 14.0 - t
        return Target((80.0 - s * s, 0.0, 0.0), (2.0 * s, 0.0, 0.0), (-2.0, 0.0, 0.0), 0.0)
    return Target((80.0, 0.0, 0.0), AT_REST, AT_REST, 0.0)


def step_east(_: float) -> Target:
    return Target((0.0, 10.0, 0.0), AT_REST, AT_REST, 0.0)


def yaw(state: QuadrotorState) -> float:
    w, x, y, z = state.q_nb
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


@pytest.mark.parametrize("kind", MODES)
def test_it_flies_setpoints_with_all_their_derivatives(kind: type[SetpointMode]) -> None:
    _, states = fly(kind, straight, 20.0)
    errors = [math.dist(s.r_n, straight(k / STEPS).r_n) for k, s in enumerate(states)]
    assert max(errors) < 0.7
    assert max(s.r_n[0] for s in states) - 80.0 < 0.5


@pytest.mark.parametrize("kind", MODES)
def test_it_flies_as_the_real_one(kind: type[SetpointMode]) -> None:
    speeds, farthest, arrived, fastest, beyond = REAL[kind]
    _, states = fly(kind, lambda t: straight(t) if t < 8.0 else None, 16.0, DRAG[kind])
    for t, speed in speeds.items():
        assert math.hypot(*states[round((8.0 + t) * STEPS)].v_n) == pytest.approx(speed, abs=0.7), t
    assert max(s.r_n[0] for s in states) - states[8 * STEPS].r_n[0] == pytest.approx(farthest, abs=1.0)
    _, states = fly(kind, step_east, 8.0, DRAG[kind])
    assert next(k for k, s in enumerate(states) if s.r_n[1] > 9.0) / STEPS == pytest.approx(arrived, abs=0.3)
    assert max(s.v_n[1] for s in states) == pytest.approx(fastest, abs=0.8)
    _, states = fly(kind, straight, 20.0, DRAG[kind])
    assert max(s.r_n[0] for s in states) - 80.0 == pytest.approx(beyond, abs=0.5)


@pytest.mark.parametrize(("kind", "rate"), [(GuidedMode, 60.0), (OffboardMode, 200.0)])
def test_the_nose_turns_at_no_more_than_its_rate(kind: type[SetpointMode], rate: float) -> None:
    _, states = fly(kind, lambda _: Target(AT_REST, AT_REST, AT_REST, 3.0), 6.0)
    fastest = max(math.degrees(abs(s.omega_b[2])) for s in states)
    assert 0.9 * rate < fastest < 1.3 * rate
    assert yaw(states[-1]) == pytest.approx(3.0, abs=0.05)


def test_in_silence_guided_flies_on_for_its_timeout_and_goes_back() -> None:
    mode, states = fly(GuidedMode, lambda t: straight(t) if t < 8.0 else None, 22.0)
    speed = [math.hypot(*s.v_n) for s in states]
    assert speed[round(8.9 * STEPS)] == pytest.approx(8.0, abs=0.3)
    assert not mode.is_following
    assert speed[-1] < 0.3
    farthest = max(s.r_n[0] for s in states)
    assert farthest - states[round(8.0 * STEPS)].r_n[0] == pytest.approx(22.8, abs=2.0)
    assert states[-1].r_n[0] == pytest.approx(16.0 + 8.0 * 5.0, abs=0.5)  # where the setpoint stood after 1 s
    assert mode.custom_mode == 4


def test_in_silence_offboard_slows_at_the_last_setpoint_and_then_holds() -> None:
    mode, states = fly(OffboardMode, lambda t: straight(t) if t < 8.0 else None, 16.0)
    speed = [math.hypot(*s.v_n) for s in states]
    assert speed[round(8.9 * STEPS)] < 6.0
    assert speed[-1] < 0.1
    assert states[-1].r_n[0] - states[round(8.0 * STEPS)].r_n[0] == pytest.approx(13.3, abs=2.0)
    assert (mode.custom_mode, mode.intended_mode) == (3 << 24 | 4 << 16, 6 << 16)
    mode.receive(straight(16.0), BEGIN + 16.0)  # and it returns by itself
    hover = Reference(AT_REST, AT_REST, AT_REST, 0.0)
    mode.command(hover, states[-1].r_n, states[-1].v_n, states[-1].q_nb, states[-1].omega_b)
    assert mode.custom_mode == 6 << 16


def test_offboard_is_not_entered_without_a_stream() -> None:
    mode, _ = fly(OffboardMode, lambda _: None, 2.0)
    assert (mode.is_entered, mode.custom_mode) == (False, 3 << 24 | 4 << 16)
    mode, _ = fly(OffboardMode, lambda t: step_east(t) if t > 1.0 else None, 2.0)
    assert mode.custom_mode == 6 << 16


@pytest.mark.parametrize(
    ("first", "second", "sum_of"),
    [
        ((3.0, 0.0, 0.0), (5.0, 0.0, 0.0), (8.0, 0.0, 0.0)),
        ((3.0, 0.0, 0.0), (20.0, 0.0, 0.0), (12.0, 0.0, 0.0)),
        ((0.0, 12.0, 0.0), (20.0, 0.0, 0.0), (0.0, 12.0, 0.0)),
        ((0.0, 6.0, 0.0), (20.0, 0.0, 0.0), (math.sqrt(144.0 - 36.0), 6.0, 0.0)),
        ((0.0, 20.0, 0.0), (0.0, 0.0, 0.0), (0.0, 12.0, 0.0)),
    ],
)
def test_px4_gives_corrections_the_right_of_way(first: Vec3, second: Vec3, sum_of: Vec3) -> None:
    assert prioritized_sum(first, second, 12.0) == pytest.approx(sum_of)


@pytest.mark.parametrize("gain", [0.5, 1.0, 2.0])
def test_an_error_is_removed_at_a_rate_from_which_the_limit_can_stop(gain: float) -> None:
    """By integration: proportional near the goal, at the deceleration of the limit before; both meet smoothly."""
    limit, error, dt = 2.0, 30.0, 1e-3
    rates = []
    while error > 1e-3:
        rate, *_ = approach_rate((error, 0.0, 0.0), gain, limit, 100.0)
        rates.append(rate)
        error -= rate * dt
    slowing = [(a - b) / dt for a, b in pairwise(rates)]
    assert max(slowing) == pytest.approx(limit, rel=0.01)
    assert min(slowing) >= 0.0
    assert approach_rate((0.0, 0.1, 0.0), gain, limit, 100.0) == pytest.approx((0.0, 0.1 * gain, 0.0))
    assert math.hypot(*approach_rate((30.0, 40.0, 0.0), gain, limit, 5.0)) == pytest.approx(5.0)
    assert approach_rate(AT_REST, gain, limit, 5.0) == AT_REST


def of(autopilot: str) -> Scenario:
    whole = load_scenario("guided")
    return replace(whole, vehicle=replace(whole.vehicle, autopilot=autopilot))


def decoded(datagrams: Iterable[bytes]) -> list[Message]:
    decoder = MavlinkDecoder(stream=False)
    return [m for data in datagrams for m in decoder.decode(data, EPOCH_NS)]


@pytest.mark.parametrize(
    ("autopilot", "before", "after"), [("px4", 3 << 24 | 4 << 16, 6 << 16), ("ardupilot", 5, 4)]
)
def test_autopilots_report_their_mode_and_take_setpoints_that_are_for_them(
    autopilot: str, before: int, after: int
) -> None:
    scenario = of(autopilot)
    run, reports = GuidedRun(scenario, 1), []
    vehicle = scenario.vehicle
    for _ in range(12 * STEPS):
        tick, datagrams = run.step()
        reports += decoded(d.data for d in datagrams if d.channel == "autopilot")
        state = tick.state
        for system, r_n in ((vehicle.system, state.r_OF_n), (vehicle.system + 1, (0.0, 0.0, 0.0))):
            setpoint = Setpoint(
                t_ns=tick.t_ns,
                t_recv_ns=tick.t_ns,
                target_system=system,
                target_component=vehicle.component,
                r_OF_n=r_n,
                v_F_n=state.v_F_n,
                a_F_n=AT_REST,
                yaw=0.0,
                yaw_rate=0.0,
            )
            run.receive(MavlinkEncoder(vehicle.system, 191).encode(setpoint), tick)
        assert run.mode.target is None or run.mode.target.r_n[2] < -50.0
    modes = [m.custom_mode for m in reports if isinstance(m, Heartbeat)]
    assert (modes[0], modes[-1]) == (before, after)
    assert run.mode.is_following
    intended = [m.intended_mode for m in reports if isinstance(m, CurrentMode)]
    assert intended[-1:] == ([after] if autopilot == "px4" else [])
    landed = [m for m in reports if isinstance(m, LandedState)]
    assert bool(landed) is (autopilot == "px4")  # an ArduPilot on request
    assert not any(m.on_ground for m in landed)
