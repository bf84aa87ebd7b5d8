"""The follow law on an ideal vehicle, and who is led when."""

import math
from typing import Any, NamedTuple

import numpy as np
import pytest

from onboard.arrays import Array
from onboard.autopilot.guidance import GUIDED, OFFBOARD, Follower, Guidance, Phase, ReferenceState, SetpointMode
from onboard.autopilot.guidance.law import _max_closing_speed
from onboard.config import GuidanceConfig
from onboard.messages import (
    Cause,
    CurrentMode,
    Heartbeat,
    LandedState,
    LeaderState,
    Lifecycle,
    Message,
    ParamValue,
    Quaternion,
)

S = 1_000_000_000
TICK = S // 25
LEVEL: Quaternion = (1.0, 0.0, 0.0, 0.0)
MODE_NUMBERS = {"GUIDED": 4, "OFFBOARD": 6 << 16}
OTHER_NUMBERS = {"GUIDED": 5, "OFFBOARD": 4 << 16 | 3 << 24}  # LOITER, Hold
DISTANCE = 30.0
HEAD: dict[str, Any] = {"t_ns": 0, "t_recv_ns": 0}


def state(t_ns: int, r_L: Any, v_L: Any, a_L: Any, r_F: Array, sigma: float = 0.5, **changed: Any) -> LeaderState:
    """A leader whose range has this standard deviation (m)."""
    toward = (np.array(r_L) - r_F) / max(float(np.linalg.norm(np.array(r_L) - r_F)), 1e-9)
    P_r = 0.04 * np.eye(3) + sigma**2 * np.outer(toward, toward)
    P = np.zeros((6, 6))
    P[:3, :3], P[3:, 3:] = P_r, 0.05 * np.eye(3)
    fields: dict[str, Any] = {
        "t_ns": t_ns,
        "t_host_ns": t_ns,
        "sequence": 0,
        "state": Lifecycle.TRACKING,
        "valid": True,
        "reason": "",
        "r_OL_n": tuple(r_L),
        "v_L_n": tuple(v_L),
        "a_L_n": tuple(a_L),
        "r_FL_n": (0.0, 0.0, 0.0),
        "age": 0.0,
        "covariance": tuple(map(tuple, P.tolist())),
        "r_FL_covariance": tuple(map(tuple, P_r.tolist())),
    }
    return LeaderState(**fields | changed)


def beat(mode: SetpointMode, *, on: bool, armed: bool = True) -> Heartbeat:
    number = (MODE_NUMBERS if on else OTHER_NUMBERS)[mode.name]
    return Heartbeat(**HEAD, vehicle_type=2, autopilot=3, armed=armed, status=4, custom_mode=number)


class Row(NamedTuple):
    """Time (s), vehicle and leader, and what was sent."""

    t: float
    r_F: Array
    r_L: Array
    sent: ReferenceState


class Chase:
    """A vehicle that flies each setpoint, after a lag of half a second. The leader begins at the origin, 20 m
    up."""

    def __init__(
        self, side: float = math.pi, mode: SetpointMode = GUIDED, distance: float = DISTANCE, **config: Any
    ) -> None:
        self.guidance = Guidance(GuidanceConfig(**config), mode=mode)
        self.mode, self.t_ns = mode, 1000 * S
        self.r_L, self.v_L, self.a_L = np.array([0.0, 0.0, -20.0]), np.zeros(3), np.zeros(3)
        self.r_F = self.r_L + np.array([distance * math.cos(side), distance * math.sin(side), 3.0])
        self.v_F = np.zeros(3)
        self.rows: list[Row] = []
        self.has_place = True

    def own(self) -> Follower:
        nowhere = np.full(3, np.nan)
        return Follower(self.r_F, self.v_F, LEVEL) if self.has_place else Follower(nowhere, nowhere, LEVEL)

    def enter(self) -> "Chase":
        """Let the pilot enter the mode."""
        for on in (False, True):
            self.step()
            self.guidance.receive(beat(self.mode, on=on))
        return self

    def step(self, seen: LeaderState | None = None) -> ReferenceState | None:
        """Go on for one tick."""
        self.t_ns += TICK
        dt = TICK / S
        self.r_L, self.v_L = self.r_L + dt * self.v_L + 0.5 * dt * dt * self.a_L, self.v_L + dt * self.a_L
        self.guidance.step(seen, self.own(), self.t_ns)
        sent = self.guidance.setpoint
        if self.guidance.is_leading and sent is not None:
            a = sent.a + 2.0 * (sent.v - self.v_F) + 1.0 * (sent.r - self.r_F)
            self.r_F, self.v_F = self.r_F + dt * self.v_F, self.v_F + dt * a
            self.rows.append(Row((self.t_ns - 1000 * S) / S, self.r_F, self.r_L, sent))
        return sent

    def see(self, seconds: float, sigma: float = 0.5, **changed: Any) -> "Chase":
        """Go on with the true leader, whose acceleration may be set before."""
        for _ in range(round(seconds * S / TICK)):
            self.step(state(self.t_ns + TICK, self.r_L, self.v_L, self.a_L, self.r_F, sigma, **changed))
        return self

    def turn(self, seconds: float, rate: float) -> "Chase":
        """Let the leader turn at a rate (rad/s)."""
        for _ in range(round(seconds * S / TICK)):
            self.a_L = rate * np.array([-self.v_L[1], self.v_L[0], 0.0])
            self.see(TICK / S)
        self.a_L = np.zeros(3)
        return self

    @property
    def distances(self) -> Array:
        return np.array([float(np.linalg.norm(row.r_F - row.r_L)) for row in self.rows])

    def aside(self) -> float:
        """The angle from the place behind the leader's course, rad."""
        out = self.r_F - self.r_L
        return abs(
            math.remainder(math.atan2(out[1], out[0]) - math.atan2(self.v_L[1], self.v_L[0]) - math.pi, math.tau)
        )

    def accelerate(self, seconds: float, a_L: Any) -> "Chase":
        self.a_L = np.array(a_L)
        self.see(seconds)
        self.a_L = np.zeros(3)
        return self


@pytest.mark.parametrize("side_deg", [0, 90, 180, 270])
@pytest.mark.parametrize("mode", [GUIDED, OFFBOARD], ids=["ardupilot", "px4"])
def test_from_any_side_it_goes_round_into_its_slot(side_deg: float, mode: SetpointMode) -> None:
    chase = Chase(math.radians(side_deg), mode)
    chase.see(6.0)  # CURRENT_MODE never comes: the stream of PX4 begins without it
    chase.enter().see(4.0).accelerate(5.0, (1.0, 0.0, 0.0)).see(40.0)
    assert chase.distances.min() > 0.85 * DISTANCE
    assert chase.aside() < math.radians(5.0)
    assert abs(chase.distances[-1] - math.hypot(DISTANCE, 3.0)) < 1.0
    yaw = math.atan2(*(chase.r_L - chase.r_F)[1::-1])
    assert abs(math.remainder(chase.rows[-1].sent.yaw - yaw, math.tau)) < 0.02


def test_a_leader_that_stops_that_turns_back_and_that_comes_at_us_keeps_its_distance() -> None:
    nearest = {}
    for name, rate, a in (("stops", 0.0, -2.0), ("turns back", 0.5, -1.0)):
        chase = Chase().enter().see(2.0).accelerate(5.0, (1.6, 0.0, 0.0)).see(15.0)
        chase.accelerate(8.0 / abs(a) if rate == 0.0 else 4.0, (a, 0.0, 0.0))
        if rate:
            chase.turn(math.pi / rate, rate)
        nearest[name] = chase.see(25.0).distances.min()
    chase = Chase().enter().see(2.0).accelerate(4.0, (-1.0, 0.0, 0.0))
    nearest["comes"] = chase.see(30.0).distances.min()
    assert nearest["stops"] > 0.8 * DISTANCE, nearest
    assert nearest["turns back"] > 2.0 / 3.0 * DISTANCE, nearest
    assert nearest["comes"] > 0.5 * DISTANCE, nearest
    assert chase.aside() < math.radians(30.0)


@pytest.mark.parametrize("aside", [0.0, 8.0])
def test_the_path_of_a_leader_that_comes_at_us_is_left(aside: float) -> None:
    chase = Chase().enter().see(1.0)
    chase.r_L = chase.r_L + np.array([0.0, aside, 0.0])
    chase.v_L = np.array([-6.0, 0.0, 0.0])  # at once: an estimate that was late
    chase.see(6.0)
    assert chase.distances.min() > 0.5 * DISTANCE
    assert (chase.r_F[1] < 0.0) or aside == 0.0  # not across its path


def test_a_leader_that_passes_far_enough_moves_nobody_aside() -> None:
    chase = Chase().enter().see(1.0)
    law, leader = chase.guidance._law, chase.guidance._leader
    before, leader.v = law._reference, np.array([-6.0, 0.0, 0.0])
    assert before is not None
    leader.r = before.r + np.array([30.0, 24.0, 0.0])
    assert (law._evade(np.zeros(2), before, leader) == 0.0).all()
    leader.r = before.r + np.array([2.0, 1.0, 0.0])  # so near that a fifth of the speed is left for backing off
    assert law._evade(np.zeros(2), before, leader) == pytest.approx([0.0, -0.8 * law.limits.speed])


def test_a_reference_begins_as_the_vehicle_flies() -> None:
    law, v_F = Chase().guidance._law, np.array([3.0, 0.0, -1.0])
    begun = law.begin(np.zeros(3), v_F, 0.5)
    assert (begun.v == v_F).all()
    assert (begun.a.tolist(), begun.yaw, begun.yaw_rate) == ([0.0, 0.0, 0.0], 0.5, 0.0)


def test_a_yaw_on_the_spot_that_looks_as_if_the_leader_flew_off_is_not_chased() -> None:
    """Estimates of real flights: from rest to 6 m/s within 0.4 s, where the wing turned away and narrowed."""
    chase = Chase().enter().see(3.0)
    for k in range(round(0.8 * S / TICK)):
        v = np.array([min(15.0 * k * TICK / S, 6.0), 0.0, 0.0])
        chase.step(state(chase.t_ns + TICK, chase.r_L + 1.2 * v, v, np.zeros(3), chase.r_F, sigma=4.0))
    assert chase.guidance._leader.v[0] <= 3.0 * 0.8 + 0.1, "no leader changes its velocity faster"
    assert chase.distances.min() > 0.9 * DISTANCE


def test_it_is_ready_for_a_leader_that_brakes_while_it_catches_up() -> None:
    """The closing speed counts on a stop of the leader, where the range says that there is room for more."""
    for speed in (0.0, 3.0, 6.0, 9.0, 12.0):
        for gap in (0.0, 5.0, 20.0, 60.0):
            closing = _max_closing_speed(gap, speed)
            stop = 0.6 * (speed + closing) + (speed + closing) ** 2 / (2.0 * 2.2)
            assert stop <= gap + speed**2 / (2.0 * 1.6) + 0.1 or closing == 0.0
    assert _max_closing_speed(0.0, 12.0) > 0.0  # in its slot it keeps up


def test_an_open_range_stops_an_approach_and_makes_nobody_retreat() -> None:
    for distance in (60.0, 25.0, DISTANCE):
        chase = Chase(distance=distance).enter().see(20.0, sigma=0.4 * distance)
        near = chase.distances * np.exp(-2.0 * 0.4)
        assert near.min() > min(0.8 * DISTANCE, 0.99 * near[0])
        assert chase.distances.max() < distance + 1.0
    assert "range unsure" in chase.guidance.warning
    assert Chase(distance=60.0).enter().see(30.0).distances[-1] < DISTANCE + 2.0


def test_the_reference_stays_within_its_limits_seed_7() -> None:
    """Whatever the estimates are."""
    rng, chase = np.random.default_rng(7), Chase().enter()
    rows = []
    for _ in range(2000):
        r_L, v_L = 40.0 * rng.standard_normal(3) - [0, 0, 20], 8.0 * rng.standard_normal(3)
        seen = state(chase.t_ns + TICK, r_L, v_L, 5.0 * rng.standard_normal(3), chase.r_F, 10.0 * rng.random())
        sent = chase.step(seen if rng.random() < 0.8 else None)
        assert sent is not None
        rows.append(np.concatenate([sent.v, sent.a, [sent.yaw_rate, float(np.linalg.norm(sent.r - chase.r_F))]]))
    v, a, (yaw_rate, leash) = (x := np.array(rows))[:, :3], x[:, 3:6], x[:, 6:].T
    assert np.isfinite(x).all()
    assert np.linalg.norm(v[:, :2], axis=1).max() <= 12.0 + 1e-9
    assert np.linalg.norm(a[:, :2], axis=1).max() <= 3.0 + 0.5
    assert np.linalg.norm(np.diff(a, axis=0), axis=1).max() <= 6.0 * TICK / S + 1e-9
    assert np.abs(yaw_rate).max() <= 0.8
    assert leash.max() < 8.0


def test_it_stays_above_its_least_height() -> None:
    chase = Chase(min_height_m=18.0, slot_m=(-30.0, 0.0, 5.0)).enter().see(20.0)
    assert chase.rows[-1].sent.r[2] == pytest.approx(-18.0, abs=0.05)


def test_noise_of_a_leader_at_rest_teaches_no_course_seed_3() -> None:
    rng, chase = np.random.default_rng(3), Chase(math.radians(90.0)).enter()
    for _ in range(1000):
        v = rng.normal(0.0, 0.3, 3)
        chase.step(state(chase.t_ns + TICK, chase.r_L + rng.normal(0.0, 0.3, 3), v, np.zeros(3), chase.r_F))
    assert chase.guidance.course is None
    assert np.linalg.norm(chase.r_F - chase.rows[0].r_F) < 2.0


def test_a_lost_leader_is_followed_for_a_second_and_then_let_go() -> None:
    chase = Chase().enter().accelerate(5.0, (1.0, 0.0, 0.0)).see(20.0)
    phases, speeds = [], []
    for _ in range(round(18.0 * S / TICK)):
        sent = chase.step(None)
        assert sent is not None, "silence is the autopilot's failsafe"
        phases.append(chase.guidance.phase)
        speeds.append(float(np.linalg.norm(sent.v)))
    second = S // TICK
    assert phases[second] is Phase.FOLLOW
    assert {*phases[2 * second : 16 * second]} == {Phase.STOP}
    assert phases[-1] is Phase.HOLD
    assert speeds[second] == pytest.approx(5.0, abs=0.5)
    assert max(speeds[5 * second :]) < 0.2


def test_a_leader_that_is_withheld_in_the_image_is_followed_and_another_is_not() -> None:
    for cause, phase in ((Cause.UNEXPECTED, Phase.FOLLOW), (Cause.OWN_MOTION_DOUBT, Phase.STOP)):
        chase = Chase().enter().see(4.0).see(3.0, valid=False, cause=cause)
        assert chase.guidance.phase is phase
        assert chase.guidance.smoothed is None


def test_without_our_own_position_the_vehicle_brakes_and_the_stream_goes_on() -> None:
    chase = Chase().enter().accelerate(5.0, (1.0, 0.0, 0.0)).see(10.0)
    chase.has_place = False
    place = chase.see(5.0).rows[-1].sent
    assert np.linalg.norm(place.v) < 0.1
    assert np.isfinite(place.r).all()


def test_a_reset_of_the_origin_moves_setpoint_and_leader_alike() -> None:
    chase = Chase().enter().accelerate(5.0, (1.0, 0.0, 0.0)).see(10.0)
    before, step = chase.rows[-1].sent, np.array([80.0, -30.0, 4.0])
    chase.r_F, chase.r_L = chase.r_F + step, chase.r_L + step
    after = chase.see(TICK / S).rows[-1].sent
    assert np.linalg.norm(after.r - before.r - step) < 0.5
    assert np.linalg.norm(after.v - before.v) < 0.3
    leader = chase.guidance._leader
    was = leader.r
    leader.shift(step)
    assert (leader.r == was + step).all()


def test_an_ardupilot_is_led_once_guided_is_entered_in_the_air_until_it_is_left() -> None:
    chase = Chase()
    guidance = chase.guidance
    guidance.receive(beat(GUIDED, on=True))  # it took off in GUIDED
    chase.see(1.0)
    assert (guidance.is_leading, guidance.setpoint) == (False, None)
    assert "enter GUIDED again" in guidance.warning
    guidance.receive(beat(GUIDED, on=False))
    guidance.receive(LandedState(**HEAD, on_ground=True))
    guidance.receive(beat(GUIDED, on=True))
    chase.see(1.0)
    assert guidance.setpoint is None
    guidance.receive(LandedState(**HEAD, on_ground=False))
    chase.enter().see(1.0)
    assert guidance.is_leading
    assert guidance.setpoint is not None
    for end in (beat(GUIDED, on=False), beat(GUIDED, on=True, armed=False)):
        guidance.receive(end)
        chase.see(0.1)
        assert (guidance.is_leading, guidance.setpoint) == (False, None)
        chase.enter()


def test_a_px4_hears_its_own_place_before_it_is_led() -> None:
    chase = Chase(mode=OFFBOARD)
    guidance = chase.guidance
    guidance.receive(current_mode(OFFBOARD, intends=False))
    guidance.receive(beat(OFFBOARD, on=False))
    chase.v_F = np.array([3.0, 1.0, 0.0])
    for _ in range(10):
        sent = chase.step(state(chase.t_ns + TICK, chase.r_L, chase.v_L, chase.a_L, chase.r_F))
        assert sent is not None
        assert (sent.r.tolist(), sent.v.tolist()) == (chase.r_F.tolist(), chase.v_F.tolist())
    guidance.receive(current_mode(OFFBOARD, intends=True))
    guidance.receive(beat(OFFBOARD, on=True))
    assert guidance.is_leading
    chase.see(3.0)
    guidance.receive(beat(OFFBOARD, on=False))  # this program stood still: PX4 returns at the next setpoint
    assert chase.step() is not None
    guidance.receive(beat(OFFBOARD, on=True))
    assert guidance.is_leading


def test_a_px4_that_would_return_by_itself_is_sent_nothing_until_the_pilot_has_chosen() -> None:
    chase = Chase(mode=OFFBOARD)
    guidance = chase.guidance
    for message in (beat(OFFBOARD, on=False), current_mode(OFFBOARD, intends=True)):
        guidance.receive(message)
    chase.see(10.0)
    assert guidance.setpoint is None
    assert "choose Hold" in guidance.warning
    guidance.receive(current_mode(OFFBOARD, intends=False))
    chase.see(0.1)
    assert guidance.setpoint is not None
    assert not guidance.is_leading


def current_mode(mode: SetpointMode, *, intends: bool) -> CurrentMode:
    off = OTHER_NUMBERS[mode.name]
    return CurrentMode(**HEAD, custom_mode=off, intended_mode=MODE_NUMBERS[mode.name] if intends else off)


@pytest.mark.parametrize("mode", [GUIDED, OFFBOARD], ids=["ardupilot", "px4"])
@pytest.mark.parametrize("has_led", [False, True])
def test_a_run_that_led_goes_on_after_a_restart(mode: SetpointMode, has_led: bool) -> None:
    chase = Chase(mode=mode)
    known = state(chase.t_ns - 4 * S, (0.0, 0.0, -20.0), (5.0, 0.0, 0.0), np.zeros(3), chase.r_F)
    chase.guidance.resume(known, 0.0, has_led=has_led)
    chase.guidance.receive(beat(mode, on=True))  # it may be heard before our own place is
    chase.has_place = False
    chase.step()
    chase.has_place = True
    chase.see(1.0)
    assert chase.guidance.is_leading is has_led
    assert chase.guidance.course == 0.0


def test_a_run_that_led_a_px4_leads_it_back_from_its_failsafe() -> None:
    """The heartbeat in Hold may come before CURRENT_MODE."""
    chase = Chase(mode=OFFBOARD)
    known = state(chase.t_ns - 4 * S, (0.0, 0.0, -20.0), (5.0, 0.0, 0.0), np.zeros(3), chase.r_F)
    chase.guidance.resume(known, 0.0, has_led=True)
    for message in (beat(OFFBOARD, on=False), current_mode(OFFBOARD, intends=True)):
        chase.guidance.receive(message)
    chase.see(0.1)
    assert chase.guidance.setpoint is not None
    chase.guidance.receive(beat(OFFBOARD, on=True))
    assert chase.guidance.is_leading


@pytest.mark.parametrize("value", [math.nan, math.inf, -5.0, 0.0, 1e9])
def test_an_implausible_limit_changes_nothing_and_is_named(value: float) -> None:
    for mode in (GUIDED, OFFBOARD):
        guidance = Guidance(GuidanceConfig(), mode=mode)
        before = guidance._law.limits
        for name in mode.limits:
            guidance.receive(parameter(name, value))
        assert guidance._law.limits == before
        assert len(guidance.parameter_texts) == len(mode.limits)


def test_limits_and_advice_are_those_of_the_vehicle() -> None:
    guidance = Guidance(GuidanceConfig(), mode=GUIDED)
    for name, value in (
        ("WPNAV_SPEED", 800.0),
        ("WPNAV_ACCEL", 250.0),
        ("ATC_SLEW_YAW", 3000.0),
        ("GUID_TIMEOUT", 3.0),
    ):
        guidance.receive(parameter(name, value))
    limits = guidance._law.limits
    assert (limits.speed, limits.acceleration, limits.yaw_rate) == pytest.approx((8.0, 2.5, math.radians(30.0)))
    assert [text.split()[0] for text in guidance.parameter_texts] == ["GUID_TIMEOUT"]
    guidance.receive(parameter("WPNAV_SPEED", 2000.0))
    assert guidance._law.limits.speed == 8.0, "never above the configuration's"


def parameter(name: str, value: float) -> Message:
    return ParamValue(**HEAD, extended=False, name=name, value=value)
