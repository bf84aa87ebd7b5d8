"""What a PX4 is sent to follow the leader, and where it may begin."""

import math
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from onboard.arrays import Array
from onboard.autopilot.guidance import Guidance, follower_of
from onboard.autopilot.guidance.px4 import FOLLOW_ME, MOVES, PASSES
from onboard.config import GuidanceConfig
from onboard.messages import Heartbeat, LeaderState
from onboard.messages.mavlink_enums import PX4
from simlink.scenarios.formation import Follow
from simlink.world.constants import DT
from simlink.world.follow import NOWHERE, Target
from simlink.world.follow_px4 import Px4FollowMode
from simlink.world.quadrotor_control import Reference
from tests.support.leader import S, T
from tests.unit.autopilot.test_guidance import STILL, TICK, state, straight

LOITER = 3 << 24 | 4 << 16


def mode(number: int) -> Heartbeat:
    return Heartbeat(t_ns=0, t_recv_ns=0, vehicle_type=2, autopilot=12, armed=True, status=4, custom_mode=number)


def guidance(**config: Any) -> Guidance:
    made = GuidanceConfig(**config)
    return Guidance(made, None, follower_of(PX4, made))


def lead(made: Guidance, seconds: float, behind: Array, speed: float = 8.0, **more: Any) -> Any:
    """Behind a leader that flies north; what is sent at the end, and the leader's place."""
    sent = None
    for k in range(round(50 * seconds)):
        r, v = straight(k, speed)
        sent = made.virtual_leader(state(T + k * TICK, r, v, **more), r + behind, v)
    return sent, r


@pytest.mark.parametrize("distance", [20.0, 30.0, 38.0])
def test_it_is_sent_the_leader_itself_with_its_own_velocity(distance: float) -> None:
    """Nothing is tied to our own place: that comes back to it late, and makes it swing."""
    sent, r = lead(guidance(), 15.0, np.array([-distance, 2.0, 3.0]))
    assert_allclose(sent.r_OL_n, r, atol=0.05)
    assert_allclose(sent.v_L_n, (8.0, 0.0, 0.0), atol=0.05)


def test_far_behind_the_target_is_as_near_as_it_may_close() -> None:
    """100 m behind: it is led by 12 m, which it closes at 5 m/s; the circle's radius is 30 m."""
    sent, r = lead(guidance(), 15.0, np.array([-100.0, 0.0, 3.0]))
    assert r[0] - sent.r_OL_n[0] == pytest.approx(100.0 - 12.0 - 30.0, abs=0.2)


def test_a_velocity_that_may_be_noise_sets_no_course_seeds_0_to_19() -> None:
    """1 m/s on each axis, as a hover has at most. What is smoothed begins with the first estimate, so one in ten
    may be taken for a flight."""
    turned = 0
    for seed in range(20):
        rng, made, off = np.random.default_rng(seed), guidance(), 0.0
        for k in range(250):
            at = state(T + k * TICK, STILL, rng.normal(0.0, 1.0, 3), velocity_sigma=1.0)
            sent = made.virtual_leader(at, np.array([30.0, 0.0, 3.0]), STILL)
            assert sent is not None
            assert sent.v_L_n is not None
            x, y, _ = sent.v_L_n
            if math.hypot(x, y) >= 1.0:  # it sets a course
                off = max(off, abs(math.atan2(y, -x)))  # rad, from the one away from us
        turned += off > 0.7
    assert turned <= 2


def test_before_the_mode_is_entered_the_course_is_stated_as_soon_as_the_leader_is_slow() -> None:
    """It begins on the last target. While it follows, a leader that flew may be turning round for some seconds."""
    made, r_F = guidance(), np.array([30.0, 0.0, 3.0])
    made.note_mode(mode(LOITER))
    for k in range(150):
        v = np.array([0.0, 3.0 if k < 75 else 0.0, 0.0])
        r = np.array([0.0, 0.02 * 3.0 * min(k, 75), 0.0])
        sent = made.virtual_leader(state(T + k * TICK, r, v), r + r_F, STILL)
    assert sent is not None
    assert_allclose(sent.v_L_n[:2] if sent.v_L_n else (), (-1.3, 0.0), atol=0.25)


def test_the_target_comes_nearer_to_us_where_the_leader_may_be_too_near() -> None:
    made = guidance()
    sent, r = lead(made, 20.0, np.array([-30.0, 0.0, 3.0]), sigma=7.5)
    assert r[0] - sent.r_OL_n[0] == pytest.approx(0.0, abs=1.0)
    sent, r = lead(guidance(least_distance_m=28.0), 20.0, np.array([-30.0, 0.0, 3.0]), sigma=6.0)
    assert 9.0 < r[0] - sent.r_OL_n[0] < 15.2  # no more than half the slot's distance


def test_once_the_leader_is_lost_the_last_target_keeps_it_where_it_stops() -> None:
    """8 m/s: it is followed for a second, and then braked for 1.6 s. A small velocity turns the course from us to
    the target, so that it does not circle it."""
    made = guidance()
    _, r = lead(made, 15.0, np.array([-30.0, 0.0, 3.0]))
    sent = []
    for k in range(151):
        r_F = r + np.array([-30.0 + 8.0 * min(k / 50.0, 2.0), 0.0, 3.0])
        lost = state(T + 15 * S + k * TICK, STILL, STILL, valid=False)
        sent.append(made.virtual_leader(lost, r_F, np.array([8.0, 0.0, 0.0])))
    during, last = sent[130], sent[148]
    assert during is not None
    assert last is not None
    assert last.r_OL_n is not None
    assert_allclose(np.array(last.r_OL_n)[:2], (r[0] + 8.0 + 6.4, r[1]), atol=0.7)
    for one in (during, last):  # PX4 carries a velocity that ends on as one that turns round
        assert_allclose(one.v_L_n, (1.3, 0.0, 0.0), atol=0.3)
    assert made.virtual_leader(state(T + 19 * S, STILL, STILL, valid=False), r_F, STILL) is None


def test_what_is_sent_is_one_trajectory_whatever_becomes_of_the_range_and_of_us() -> None:
    """A real one orbited a leader at rest; where the range became unsure, the target leapt, which was a course."""
    rng, made, before = np.random.default_rng(5), guidance(), None
    made.note_mode(mode(LOITER))
    for k in range(1500):
        angle = 5.0 / 30.0 * k / 50.0
        r_F = 30.0 * np.array([math.cos(angle), math.sin(angle), 0.0]) + np.array([0.0, 0.0, 3.0])
        v_F = 5.0 * np.array([-math.sin(angle), math.cos(angle), 0.0])
        r = -r_F * rng.normal(0.0, 0.05)
        sigma = 12.0 if 500 < k < 600 or 900 < k < 905 else 4.0
        sent = made.virtual_leader(state(T + k * TICK, r, rng.normal(0.0, 0.5, 3), sigma=sigma), r_F, v_F)
        assert sent is not None
        assert sent.r_OL_n is not None
        assert sent.v_L_n is not None
        if before is not None and k > 1:
            moved = 50.0 * np.subtract(sent.r_OL_n[:2], before)
            away = np.array([-1.0, 0.0])  # from where it began: its course, so no other
            assert np.linalg.norm(moved - max(float(moved @ away), 0.0) * away) < MOVES  # too slow to be one
        before = sent.r_OL_n[:2]
        made.note_mode(mode(FOLLOW_ME))


def test_a_leader_that_flies_off_is_led_after_though_its_velocity_is_not_sure() -> None:
    """5 m/s with a deviation of 1.6, and a range that is unsure: a real one was left 130 m behind. It falls back
    until the near end leaves it room, and then is as fast."""
    made, r_F = guidance(), np.array([-30.0, 0.0, 3.0])
    for k in range(1000):
        r, v = straight(k, 5.0)
        sent = made.virtual_leader(state(T + k * TICK, r, v, sigma=12.0, velocity_sigma=1.6), r_F, v)
        assert sent is not None
        place = np.array(sent.r_OL_n) - np.array([30.0, 0.0, 0.0])
        r_F = r_F + 0.02 * (np.array(sent.v_L_n) + (place - r_F) / 2.4) * [1.0, 1.0, 0.0]
        assert 29.0 < r[0] - r_F[0] < 45.0
    assert sent.v_L_n[0] == pytest.approx(5.0, abs=0.5)


def test_a_velocity_that_may_be_its_error_is_no_flight() -> None:
    """A real one was led round a leader at rest that was estimated at 3.8 m/s, with a deviation of 2.3."""
    made = guidance()
    for k in range(150):
        at = state(T + k * TICK, np.array([0.0, 0.02 * k, 0.0]), (0.0, 3.8, 0.0), velocity_sigma=2.3)
        sent = made.virtual_leader(at, np.array([-30.0, 0.0, 3.0]), STILL)
        assert sent is not None
        assert sent.v_L_n is not None
        assert math.hypot(*sent.v_L_n[:2]) < 1.0


def test_a_stop_is_heard_whatever_was_led_to_before() -> None:
    """A real one was begun east of a leader at rest: one moment of "PX4 will pass" left its target in the south,
    and its nose turned away from the leader."""
    follower = follower_of(PX4, GuidanceConfig())
    slot = guidance()._slot_at(0.0)._replace(arm=np.array([-30.0, 0.0, 3.0]))
    targets = []
    for yaw in (math.pi, -math.pi / 2):
        sent = follower.stop(STILL, STILL, yaw, brakes=True)
        targets.append(follower.target(sent, slot, 0.02))
    assert_allclose(targets[0].r, (-30.0, 0.0, 0.0), atol=1e-9)
    assert_allclose(targets[1].r, (0.0, -30.0, 0.0), atol=1e-9)
    assert_allclose(targets[1].v, (0.0, -1.3, 0.0), atol=1e-9)


@pytest.mark.parametrize("made", [guidance(), Guidance(GuidanceConfig())], ids=["px4", "ardupilot"])
def test_nobody_waits_for_a_leader_that_comes_whatever_its_range(made: Guidance) -> None:
    """3 m/s: a real one came within 17 m of a PX4 that stood, as its range was unsure."""
    made.restart()
    r_F = np.array([0.0, 0.0, 3.0])
    for k in range(300):
        r = np.array([28.0 - 0.06 * k, 0.0, 0.0])
        at = state(T + k * TICK, r, (-3.0, 0.0, 0.0), sigma=12.0, velocity_sigma=0.8)
        sent = made.virtual_leader(at, r_F, np.array([-3.0, 0.0, 0.0]))
        assert sent is not None
        assert sent.r_OL_n is not None
        r_F = np.array([sent.r_OL_n[0] - 30.0, 0.0, 3.0])  # a follower that is where it is led, at once
        assert r[0] - r_F[0] > 22.0
    assert made.is_unsure


def test_a_range_that_is_found_anew_is_no_motion() -> None:
    """40 m, then 65 m: a real PX4 was sent 13 m/s of a leader at 4 m/s, and flew past it when that stopped."""
    made = guidance()
    for k in range(500):
        r, v = straight(k, 4.0)
        found, r_F = r + np.array([0.0 if k < 250 else 25.0, 0.0, 0.0]), r - np.array([40.0, 0.0, -3.0])
        sent = made.virtual_leader(state(T + k * TICK, found, v), r_F, v)
        assert sent is not None
        assert sent.v_L_n is not None
        assert math.hypot(*sent.v_L_n[:2]) < 4.0 * (1.0 + 0.4) + 4.2


@pytest.mark.parametrize(
    ("place", "v_L", "is_bad"),
    [
        ((-30.0, 0.0, 3.0), (0.0, 0.0), True),  # south of a leader at rest: its orbit begins in the north
        ((-30.0, 0.0, -8.5), (0.0, 0.0), False),  # above it
        ((30.0, 0.0, 3.0), (0.0, 0.0), False),
        ((-3.0, 30.0, 3.0), (0.0, 0.0), False),
        ((-30.0, 8.0, 3.0), (0.0, 0.0), True),
        ((30.0, 0.0, 3.0), (-8.0, 0.0), False),  # behind a leader that flies south
        ((-30.0, 0.0, 3.0), (8.0, 0.0), True),  # behind one that flies north
        ((-10.0, 0.0, 3.0), (0.0, 0.0), True),  # too near already, and its way leads through the leader
        ((10.0, 0.0, 3.0), (0.0, 0.0), False),  # too near, and its way leads away
    ],
)
def test_where_its_own_way_passes_the_leader_it_is_named_before_and_led_to_stay(
    place: tuple[float, float, float], v_L: tuple[float, float], is_bad: bool
) -> None:
    made, v = guidance(), np.array([*v_L, 0.0])
    made.note_mode(mode(LOITER))
    for k in range(20):
        r = v * (k / 50)
        sent = made.virtual_leader(state(T + k * TICK, r, v), r + np.array(place), v)
        assert stays(sent, r + np.array(place), v) if is_bad else leads(sent, r)
    assert made.warning == (PASSES if is_bad else "")
    made.note_mode(mode(FOLLOW_ME))  # entered all the same
    sent = made.virtual_leader(state(T + 20 * TICK, r, v), r + np.array(place), v)
    assert stays(sent, r + np.array(place), v) if is_bad else leads(sent, r)
    for where in ((30.0, 0.0, 3.0), (-30.0, 0.0, 3.0)) if is_bad else ((-30.0, 0.0, 3.0),):
        # round it; once it is led, its way is the one that it is led
        sent = made.virtual_leader(state(T + 21 * TICK, r, v), r + np.array(where), v)
        assert leads(sent, r)
        assert made.warning == ""


def leads(sent: LeaderState | None, r_L: Array) -> bool:
    """Whether what was sent is the leader, but for half the slot's distance where the vehicle is too near."""
    assert sent is not None
    assert sent.r_OL_n is not None
    return math.dist(sent.r_OL_n[:2], r_L[:2]) < 16.0


def stays(sent: LeaderState | None, r_F: Array, v_F: Array) -> bool:
    """Whether a PX4 that begins to follow what was sent would stay near the place where it comes to rest."""
    assert sent is not None
    assert sent.r_OL_n is not None
    assert sent.v_L_n is not None
    course = math.atan2(sent.v_L_n[1], sent.v_L_n[0]) if math.hypot(*sent.v_L_n[:2]) > 1.0 else 0.0
    north = np.array(sent.r_OL_n)[:2] + np.array([30.0, 0.0])  # where its circle begins
    rests = (r_F + v_F * (np.linalg.norm(v_F) / 10.0))[:2]
    return math.dist(north, rests) < 1.0 and abs(math.remainder(course - math.pi, 2.0 * math.pi)) < 0.1


@pytest.mark.parametrize("lost", [(), (1.5, 3.0)])  # s
@pytest.mark.parametrize("angle", [math.pi, 2.5, -2.0])
def test_a_px4_that_is_led_to_stay_begins_and_ends_its_circle_there(angle: float, lost: tuple[float, ...]) -> None:
    """Flown by simlink's Follow-Me, which begins on the last target, however old: one of the leader, from before
    the vehicle came south of it, would lead through it. So would one that leads to a stop where it was lost."""
    made = guidance(slot_m=(30.0 * math.cos(angle), 30.0 * math.sin(angle), 3.0))
    made.note_mode(mode(LOITER))
    follow = Px4FollowMode(Follow(offset=(30.0 * math.cos(angle), 30.0 * math.sin(angle), 3.0), engage=4.0))
    r_F, v_F, reference = np.array([30.0, 0.0, 3.0]), STILL, Reference((30.0, 0.0, 3.0), NOWHERE, NOWHERE, 0.0)
    for k in range(500):
        t = k / 50.0
        if t < 4.0:  # it is flown to the other side of the leader
            r_F = np.array([30.0 - 15.0 * t, 0.0, 3.0])
            reference = reference._replace(r_n=tuple(r_F.tolist()))
        elif t == 4.0:
            made.note_mode(mode(FOLLOW_ME))
        is_lost = bool(lost) and lost[0] <= t < lost[1]
        sent = made.virtual_leader(state(T + k * TICK, STILL, STILL, valid=not is_lost), r_F, v_F)
        reference = flown(follow, sent, t, reference) if t >= 4.0 else received(follow, sent, t, reference)
        if t >= 4.0:
            assert math.dist(reference.r_n[:2], (-30.0, 0.0)) < 4.0
            r_F = np.array(reference.r_n)


@pytest.mark.parametrize("angle", [0.0, 1.5, -1.0])
def test_beside_a_leader_at_rest_it_stays_on_the_side_where_it_begins(angle: float) -> None:
    """Flown by simlink's Follow-Me. Its own course of a leader at rest is north, so its place is in the south: a
    leader that flew off to the south came at it, within 16 m of 30."""
    made = guidance()
    made.note_mode(mode(LOITER))
    follow = Px4FollowMode(Follow(offset=(-30.0, 0.0, 3.0), engage=1.0))
    place = (30.0 * math.cos(angle), 30.0 * math.sin(angle), 3.0)
    reference = Reference(place, NOWHERE, NOWHERE, 0.0)
    for k in range(1000):
        t = k / 50.0
        if t == 1.0:
            made.note_mode(mode(FOLLOW_ME))
        sent = made.virtual_leader(state(T + k * TICK, STILL, STILL), np.array(reference.r_n), STILL)
        reference = flown(follow, sent, t, reference) if t >= 1.0 else received(follow, sent, t, reference)
        assert math.hypot(*reference.r_n[:2]) > 24.0
    x, y, _ = reference.r_n
    turned = math.remainder(math.atan2(y, x) - angle, 2.0 * math.pi)
    assert abs(turned) < 1.1  # rad: its circle begins north of the leader


def received(follow: Px4FollowMode, sent: LeaderState | None, t: float, reference: Reference) -> Reference:
    """The set point as it was, once the mode has received what was sent."""
    if sent is not None:
        assert sent.r_OL_n is not None
        assert sent.v_L_n is not None
        follow.receive(Target(sent.r_OL_n, sent.v_L_n, 0.0), t)
    return reference


def flown(follow: Px4FollowMode, sent: LeaderState | None, t: float, reference: Reference) -> Reference:
    """The set point of the mode 20 ms after it has received what was sent."""
    received(follow, sent, t, reference)
    for j in range(round(0.02 / DT)):
        reference = follow.advanced(reference, t + j * DT, reference.r_n)
    return reference


def test_a_px4_that_flies_elsewhere_while_the_leader_is_lost_begins_where_it_is() -> None:
    """Its last target would be one of where the leader was seen: to begin on that may lead through the leader."""
    made = guidance()
    made.note_mode(mode(LOITER))
    assert made.virtual_leader(state(T, STILL, STILL), np.array([30.0, 0.0, 3.0]), STILL) is not None
    made.note_mode(mode(FOLLOW_ME))
    for k in range(1, 75):  # it follows, and is led to a stop
        r_F = np.array([20.0, 20.0, 3.0])
        sent = made.virtual_leader(state(T + k * TICK, STILL, STILL, valid=False), r_F, STILL)
        assert sent is not None
    made.note_mode(mode(LOITER))
    for k in range(75, 1000):
        r_F = np.array([30.0 - min((k - 75) / 10.0, 60.0), 20.0, 3.0])
        sent = made.virtual_leader(state(T + k * TICK, STILL, STILL, valid=False), r_F, STILL)
        assert stays(sent, r_F, STILL)
    made.note_mode(mode(FOLLOW_ME))
    assert made.virtual_leader(state(T + 1000 * TICK, STILL, STILL, valid=False), r_F, STILL) is None
    made.restart()  # the autopilot has forgotten, too
    made.note_mode(mode(LOITER))
    assert made.virtual_leader(state(T + 1001 * TICK, STILL, STILL, valid=False), r_F, STILL) is None


def test_an_ardupilot_may_begin_anywhere() -> None:
    made = Guidance(GuidanceConfig())
    made.note_mode(mode(4))
    assert made.virtual_leader(state(T, STILL, STILL), np.array([-30.0, 0.0, 3.0]), STILL) is not None
    assert made.warning == ""


@pytest.mark.parametrize(
    ("autopilot", "name", "value"), [(PX4, "FLW_TGT_MAX_VEL", 5.0), (3, "WPNAV_SPEED", 900.0)]
)
def test_the_slot_turns_no_faster_than_the_autopilots_own_parameter_allows(
    autopilot: int, name: str, value: float
) -> None:
    """What another one calls its limit, or what is none, changes nothing."""
    config = GuidanceConfig()
    guidance = Guidance(config, follower=follower_of(autopilot, config))
    v, arm = np.array([7.0, 0.0, 0.0]), np.array([-30.0, 0.0, 3.0])
    before = guidance.follower.turn_limits(v, arm)
    for other, number in ((name, math.nan), (name, 0.0), ("WP_YAW_BEHAVIOR", 1.0)):
        guidance.note_parameter(other, number)
        assert guidance.follower.turn_limits(v, arm) == before
    guidance.note_parameter(name, value)
    limits = guidance.follower.turn_limits(v, arm)
    flown = 5.0 if autopilot == PX4 else math.sqrt(9.0**2 - 7.0**2)
    assert_allclose(limits, (-flown / 30.0, flown / 30.0))
    assert limits[1] < before[1]
