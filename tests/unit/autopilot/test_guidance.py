"""Where an autopilot that follows the leader is led."""

import math
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from onboard.arrays import Array
from onboard.autopilot.guidance import Guidance
from onboard.autopilot.guidance.guidance import RANGE_UNSURE
from onboard.autopilot.guidance.motion import turned
from onboard.autopilot.guidance.states import Phase
from onboard.config import GuidanceConfig
from onboard.messages import Heartbeat, LeaderState
from tests.support.leader import S, T, leader_state

SLOT = np.array([-30.0, 0.0, 3.0])
TICK = S // 50
STILL = np.zeros(3)


def state(
    t_ns: int,
    r_L: Any,
    v_L: Any,
    a_L: Any = (0.0, 0.0, 0.0),
    sigma: float = 0.5,
    velocity_sigma: float = 0.2,
    **more: Any,
) -> LeaderState:
    variances = (sigma**2,) * 3 + (velocity_sigma**2,) * 3
    P = tuple(tuple(v if i == j else 0.0 for j in range(6)) for i, v in enumerate(variances))
    values = {"r_OL_n": tuple(r_L), "v_L_n": tuple(v_L), "a_L_n": tuple(a_L), "covariance": P}
    return leader_state(t_ns=t_ns, **values, r_FL_covariance=tuple(row[:3] for row in P[:3]), **more)


def slot_of(sent: LeaderState | None) -> tuple[Array, Array]:
    """Where the autopilot flies, and with what velocity."""
    assert sent is not None
    assert sent.course is not None
    return np.array(sent.r_OL_n) + turned(SLOT, sent.course), np.array(sent.v_L_n)


class Chase:
    """A follower that is where it is led, at once."""

    def __init__(self, r_F: Any = (-30.0, 0.0, 3.0), **config: Any) -> None:
        self.guidance = Guidance(GuidanceConfig(**config))
        self.t_ns, self.r_F, self.v_F = T, np.array(r_F), STILL

    def step(self, r_L: Any, v_L: Any, a_L: Any = (0.0, 0.0, 0.0), sigma: float = 0.5) -> LeaderState | None:
        self.t_ns += TICK
        sent = self.guidance.virtual_leader(state(self.t_ns, r_L, v_L, a_L, sigma), self.r_F, self.v_F)
        if sent is not None:
            self.r_F, self.v_F = slot_of(sent)
        return sent


def straight(k: int, speed: float = 10.0) -> tuple[Array, Array]:
    return np.array([speed * 0.02 * k, 0.0, 0.0]), np.array([speed, 0.0, 0.0])


def test_from_the_first_message_it_leads_along_the_bearing_of_a_leader_at_rest() -> None:
    """The leader is north-east of us; the virtual leader is the true one."""
    chase = Chase((-30.0 / math.sqrt(2), -30.0 / math.sqrt(2), 3.0))
    sent = chase.step(STILL, STILL)
    assert sent is not None
    assert sent.course == pytest.approx(math.pi / 4)
    assert_allclose(sent.r_OL_n, STILL, atol=1e-9)
    assert chase.guidance.course is None
    assert Chase(start_course="none").step(STILL, STILL) is None


def test_who_leads_nobody_learns_the_same_course_through_a_turn_and_a_drop_out() -> None:
    both = Guidance(GuidanceConfig()), Guidance(GuidanceConfig(), leads=False)
    courses: list[tuple[float | None, ...]] = []
    for k in range(500):
        angle, t_ns, r_F = 0.004 * k, T + k * TICK, np.array([0.2 * k - 30.0, 0.0, 3.0])
        v_L = 10.0 * np.array([math.cos(angle), math.sin(angle), 0.0])
        r_L = np.array([0.2 * k, 0.05 * max(k - 100, 0), 0.0])
        seen = state(t_ns, r_L, v_L, valid=not 200 <= k < 240)
        sent = [guidance.virtual_leader(seen, r_F, np.array([10.0, 0.0, 0.0])) for guidance in both]
        assert (sent[0] is not None, sent[1]) == (True, None)
        courses.append(tuple(guidance.course for guidance in both))
    assert courses[-1][0] == pytest.approx(0.004 * 499, abs=0.3)
    assert [ours for ours, _ in courses] == [alone for _, alone in courses]


def test_a_steady_leader_is_followed_without_lag() -> None:
    chase = Chase()
    for k in range(1500):
        sent = chase.step(*straight(k))
    assert sent is not None
    assert_allclose(sent.r_OL_n, straight(1499)[0], atol=0.01)
    assert_allclose(sent.v_L_n, (10.0, 0.0, 0.0), atol=0.01)
    assert chase.guidance.course == pytest.approx(0.0)


def test_noise_of_each_message_moves_it_little() -> None:
    """Jumps of 0.1 m and 0.15 m/s from image to image, as those that made an autopilot nod."""
    rng, chase = np.random.default_rng(3), Chase()
    sent = []
    for k in range(1500):
        if k % 2 == 0:
            noise = rng.normal(0.0, 1.0, (2, 3))
        r, v = straight(k)
        sent.append(chase.step(r + 0.1 * noise[0], v + 0.15 * noise[1]))
    speeds = np.array([s.v_L_n for s in sent[500:] if s is not None])
    assert np.linalg.norm(np.diff(speeds, axis=0), axis=1).max() < 0.06
    assert speeds.std(axis=0).max() < 0.1


def test_in_a_turn_it_sends_the_slots_own_velocity_and_acceleration() -> None:
    """12 m/s at 0.2 rad/s: the slot, 30 m behind, flies a circle of its own at 13.4 m/s."""
    rate, speed = 0.2, 12.0
    chase, slots = Chase((0.0, 0.0, 3.0)), []
    chase.r_F = np.array([0.0, -60.0, 0.0]) + turned(SLOT, 0.0)
    for k in range(2000):
        angle = rate * 0.02 * k
        r = speed / rate * np.array([math.sin(angle), -math.cos(angle), 0.0])
        v = speed * np.array([math.cos(angle), math.sin(angle), 0.0])
        sent = chase.step(r, v, rate * np.array([-v[1], v[0], 0.0]))
        slots.append(slot_of(sent)[0])
    assert sent is not None
    assert math.hypot(*sent.v_L_n) == pytest.approx(math.hypot(12.0, 6.0), abs=0.15)
    assert_allclose(sent.v_L_n, (slots[-1] - slots[-2]) / 0.02, atol=0.2)
    assert np.linalg.norm(sent.a_L_n or ()) == pytest.approx(0.2 * math.hypot(12.0, 6.0), abs=0.1)
    assert np.linalg.norm(slots[-1] - (r + turned(SLOT, angle))) < 0.8


def test_a_leader_that_reverses_is_kept_at_its_distance_on_the_same_side() -> None:
    """From 10 m/s to -8 m/s at 2 m/s^2: it comes towards us, and the slot gives way. One that goes on so has
    turned: the follower goes round it, to what is behind it now."""
    chase, speed, x = Chase(), 10.0, 0.0
    for k in range(2500):
        a = -2.0 if k > 500 and speed > -8.0 else 0.0
        speed, x = speed + 0.02 * a, x + 0.02 * speed
        chase.step((x, 0.0, 0.0), (speed, 0.0, 0.0), (a, 0.0, 0.0))
        if k < 1150:
            assert x - chase.r_F[0] > 26.0
            assert abs(chase.r_F[1]) < 0.02
            assert k < 700 or chase.guidance.course == pytest.approx(0.0)
        assert math.dist((x, 0.0, 0.0), chase.r_F) > 22.0
    assert abs(chase.guidance.course or 0.0) == pytest.approx(math.pi)
    assert_allclose(chase.r_F - (x, 0.0, 0.0), (30.0, 0.0, 3.0), atol=1.0)


def test_a_follower_on_the_wrong_side_goes_round_at_its_distance() -> None:
    """A pilot flew it ahead of the leader, before FOLLOW: the way to the slot is not through the leader."""
    chase, nearest = Chase(), math.inf
    for k in range(200):
        chase.step(*straight(k, 3.0))
    chase.r_F = straight(200, 3.0)[0] + (30.0, 3.0, 3.0)
    for k in range(200, 3000):
        r, v = straight(k, 3.0)
        place, _ = slot_of(chase.step(r, v))
        nearest = min(nearest, math.hypot(*(r - place)[:2]))
    assert nearest > 23.5  # it cuts the corner by a fifth
    assert_allclose(chase.r_F - r, SLOT, atol=1.0)


@pytest.mark.parametrize("sigma", [0.5, 4.0, 8.0])
def test_what_is_sent_is_never_nearer_than_the_least_distance_from_the_near_end(sigma: float) -> None:
    chase = Chase(least_distance_m=20.0)
    for k in range(1000):
        chase.step(STILL, STILL, sigma=sigma)
        assert np.linalg.norm(chase.r_F) >= 20.0 + 2.0 * sigma - 1e-6 or k == 0
    assert np.linalg.norm(chase.r_F) < 36.1


@pytest.mark.parametrize("sigma", [0.5, 4.0])
def test_it_is_led_away_from_a_leader_too_near_within_a_bound(sigma: float) -> None:
    """8 m: the distance grows by 5 m, which position control flies at 5 m/s, to the least distance."""
    chase = Chase(least_distance_m=20.0)
    chase.r_F = np.array([-8.0, 0.0, 0.0])
    for k in range(6):
        chase.step(STILL, STILL, sigma=sigma)
        assert np.linalg.norm(chase.r_F) <= min(13.0 + 5.0 * k, 45.3)
    assert np.linalg.norm(chase.r_F) > 27.9


@pytest.mark.parametrize("sigma", [1.0, 10.0, 17.0, 25.0, 100.0])
def test_it_never_flees_what_it_does_not_know_seed_3(sigma: float) -> None:
    """60 m behind a leader at rest whose range is uncertain, and wanders by as much: the vehicle is led nearer, or
    stays where it is. It is led no farther from the leader than half as far again as the slot."""
    rng, chase = np.random.default_rng(3), Chase((-60.0, 0.0, 3.0))
    for _ in range(300):
        before = float(np.linalg.norm(chase.r_F))
        wanders = min(0.3 * sigma, 12.0) * rng.standard_normal()
        sent = chase.guidance.virtual_leader(
            state(chase.t_ns + TICK, (wanders, 0, 0), STILL, sigma=sigma), chase.r_F, STILL
        )
        chase.t_ns += TICK
        place, v = slot_of(sent)
        assert np.linalg.norm(place - chase.r_F) <= 5.0 + 1e-9
        assert np.linalg.norm(v) <= 9.1
        chase.r_F = place
        assert np.linalg.norm(place) <= max(before, 45.3 + 36.0)
    assert chase.guidance.is_unsure is (sigma > 1.0)  # nearer, 10 m are a greater share
    assert np.linalg.norm(chase.r_F) <= 60.2


@pytest.mark.parametrize(("distance", "sigma", "comes"), [(48.0, 15.5, False), (90.0, 29.0, True)])
def test_where_the_range_is_unsure_it_comes_as_near_as_its_near_end_allows(
    distance: float, sigma: float, comes: bool
) -> None:
    """Standing shows nothing new of a range. At 48 m the near end is inside the slot, at 90 m it is not."""
    chase = Chase((-distance, 0.0, 3.0))
    for _ in range(1000):
        chase.step(STILL, STILL, sigma=sigma)
        near = np.linalg.norm(chase.r_F) - distance * -math.expm1(-2.0 * sigma / distance)
        assert near > 0.8 * 27.0 or chase.r_F[0] == -distance
    assert chase.guidance.is_unsure
    assert bool(np.linalg.norm(chase.r_F) < distance - 5.0) is comes


def test_a_leader_that_flies_off_is_gone_along_with_while_its_range_is_unsure() -> None:
    """A real one that stood and looked was left behind by 97 m: it flies as fast as the leader surely does, and
    its distance does not shrink."""
    chase = Chase()
    for k in range(1000):
        r, v = straight(k)
        chase.step(r, v, sigma=0.5 if k < 500 else 12.0)
        assert np.linalg.norm(r - chase.r_F) > 29.0
    assert chase.v_F[0] > 9.0
    assert np.linalg.norm(r - chase.r_F) < 45.3  # one and a half times the slot's


def test_nobody_is_warned_of_an_unsure_range_before_the_mode_is_entered() -> None:
    chase, beat = (
        Chase(),
        {"t_ns": 0, "t_recv_ns": 0, "vehicle_type": 2, "autopilot": 3, "armed": True, "status": 4},
    )
    warnings = []
    for number in (4, 23):
        chase.guidance.note_mode(Heartbeat(**beat, custom_mode=number))
        chase.step(STILL, STILL, sigma=12.0)
        warnings.append(chase.guidance.warning)
    assert warnings == ["", RANGE_UNSURE]


def test_it_never_closes_faster_than_its_speed_allows() -> None:
    """100 m behind: the target is 4 m ahead of us. Inside the slot's distance it does not close at all."""
    chase = Chase((-100.0, 0.0, 3.0), closing_speed_m_s=4.0)
    sent = chase.guidance.virtual_leader(state(T, STILL, STILL), chase.r_F, STILL)
    assert np.linalg.norm(slot_of(sent)[0] - chase.r_F) == pytest.approx(4.0, abs=0.01)
    chase = Chase()
    for k in range(500):
        chase.step(*straight(k))
    r = straight(500)[0] - (12.0, 0.0, 0.0)  # suddenly 12 m nearer, at half its speed
    chase.t_ns += TICK
    sent = chase.guidance.virtual_leader(state(chase.t_ns, r, (5.0, 0.0, 0.0)), chase.r_F, STILL)
    place, v = slot_of(sent)
    assert float((v - (5.0, 0.0, 0.0)) @ (r - place)) < 1e-6
    assert np.linalg.norm(place - r) == pytest.approx(np.linalg.norm(chase.r_F - r) + 5.0, abs=0.1)


def test_once_the_leader_is_lost_we_stop_with_the_nose_on_it_and_are_silent_after_a_while() -> None:
    chase = Chase(clear_height_m=0.0)
    for k in range(500):
        chase.step(*straight(k))
    v_F, r_F = np.array([10.0, 0.0, 0.0]), chase.r_F
    guidance = chase.guidance
    sent = []
    for k in range(1, 160):
        moment = chase.t_ns + k * TICK
        lost = state(moment, STILL, STILL, valid=False)
        sent.append(guidance.virtual_leader(lost, r_F + np.array([0.0, 0.1 * k, 0.0]), v_F))
    first, braking, last = sent[0], sent[60], sent[148]
    assert first is not None
    assert braking is not None
    assert last is not None
    assert_allclose(first.v_L_n, (10.0, 0.0, 0.0), atol=0.01)  # most drop-outs are short
    place, v = slot_of(braking)
    assert_allclose(v, STILL)
    assert place[0] - r_F[0] == pytest.approx(10.0, rel=0.01)  # at its own limit, and 1.5 m/s^2 beyond
    assert_allclose(braking.a_L_n, (-1.5, 0.0, 0.0))
    assert_allclose(last.a_L_n, STILL)  # an autopilot would carry it on
    assert_allclose(slot_of(last)[0], place, atol=1e-6)
    assert last.course == pytest.approx(math.atan2(-14.9, 30.0 + 29.8), abs=0.01)  # where it should be by now
    assert [s is None for s in sent] == [k > 150 for k in range(1, 160)]
    assert guidance.course is None


@pytest.mark.parametrize(
    ("leader_m", "own_m", "goes_to_m"),
    [(40.0, 37.0, 30.0), (15.0, 12.0, 25.0), (40.0, 43.0, 50.0), (40.0, 60.0, None), (40.0, 25.0, None)],
    ids=["below", "no room below", "above", "far above", "far below"],
)
def test_before_it_falls_silent_it_leaves_the_leaders_height(
    leader_m: float, own_m: float, goes_to_m: float | None
) -> None:
    """Who stands on the leader's own circle meets it there again: real ones at 5 and 10.5 m. Heights, m."""
    chase = Chase((-30.0, 0.0, -own_m))
    for k in range(300):
        r, v = straight(k)
        chase.step(r - (0.0, 0.0, leader_m), v)
    chase.r_F[2], sent_for = -own_m, 0
    for k in range(1000):
        chase.t_ns += TICK
        sent = chase.guidance.virtual_leader(state(chase.t_ns, STILL, STILL, valid=False), chase.r_F, STILL)
        if sent is None:
            break
        place, _ = slot_of(sent)
        sent_for += 1
        if k > 60:  # it climbs, or sinks, with 2 m/s
            chase.r_F = np.array([*place[:2], chase.r_F[2] + max(-0.04, min(0.04, place[2] - chase.r_F[2]))])
    assert sent is None
    assert chase.guidance.phase is Phase.SILENT
    if goes_to_m is None:
        assert sent_for * TICK < 3.1 * S
    else:
        assert -chase.r_F[2] == pytest.approx(goes_to_m, abs=1.1)
        assert sent_for * TICK < 10.0 * S


@pytest.mark.parametrize("in_follow", [True, False], ids=["in FOLLOW", "mode not known"])
@pytest.mark.parametrize(("age_s", "ticks"), [(2.0, 151), (6.0, 101), (11.0, 0)])
def test_what_an_earlier_run_knew_turns_the_nose_to_where_the_leader_should_be(
    age_s: float, ticks: int, in_follow: bool
) -> None:
    """It flew north at 10 m/s and turned to the right at 0.2 rad/s; nobody has seen it since. After 3 s of silence
    we brake already."""
    guidance, t_ns = Guidance(GuidanceConfig(clear_height_m=0.0)), T + round(age_s * S)
    guidance.resume(state(T, STILL, (10.0, 0.0, 0.0), (0.0, 2.0, 0.0)), 0.0)
    if in_follow:
        guidance.note_mode(
            Heartbeat(t_ns=T, t_recv_ns=T, vehicle_type=2, autopilot=3, armed=True, status=4, custom_mode=23)
        )
    r_F = np.array([0.0, 0.0, 3.0])
    unknown = guidance.virtual_leader(state(t_ns, STILL, STILL, valid=False), np.full(3, np.nan), STILL)
    assert unknown is None  # our own position comes later
    lost = [state(t_ns + k * TICK, STILL, STILL, valid=False) for k in range(160)]
    sent = [guidance.virtual_leader(one, r_F, np.array([10.0, 0.0, 0.0])) for one in lost]
    assert [s is not None for s in sent] == [k < ticks for k in range(160)]
    if sent[0] is not None:
        assert (np.linalg.norm(sent[0].v_L_n) > 5.0) == (age_s < 3.0)
        angle = 0.2 * age_s
        north, east = 50.0 * math.sin(angle), 50.0 * (1.0 - math.cos(angle))
        assert sent[0].course == pytest.approx(math.atan2(east, north), abs=0.02)


def test_a_leader_that_is_seen_takes_the_place_of_what_was_known() -> None:
    chase = Chase()
    chase.guidance.resume(state(T - S, (500.0, 0.0, 0.0), STILL), 0.0)
    sent = chase.step(STILL, STILL)
    assert sent is not None
    assert_allclose(sent.r_OL_n, STILL, atol=1e-9)
    lost = chase.guidance.virtual_leader(state(chase.t_ns + TICK, STILL, STILL, valid=False), chase.r_F, STILL)
    assert lost is not None
    assert_allclose(lost.r_OL_n, STILL, atol=0.1)


def test_a_slot_does_not_close_on_a_leader_that_brakes() -> None:
    """The smoothed leader is faster than the true one for a second; the slot is not, by more than noise."""
    chase, r, v = Chase(), STILL, 10.0
    for k in range(500):
        chase.step(*straight(k))
    r, closing = straight(499)[0], []
    for _ in range(60):
        v -= 3.0 * 0.02
        r = r + np.array([v * 0.02, 0.0, 0.0])
        sent = chase.step(r, (v, 0.0, 0.0))
        closing.append(slot_of(sent)[1][0] - v)
    assert max(closing) < 1.6


def test_follow_that_is_entered_beside_the_slot_closes_up_slowly() -> None:
    """4.4 m behind it: in GUIDED the target is where we are; from FOLLOW on it moves off at 2 m/s^2."""
    chase, behind = Chase(), np.array([-34.4, 0.0, 3.0])
    beat = {"t_ns": 0, "t_recv_ns": 0, "vehicle_type": 2, "autopilot": 3, "armed": True, "status": 4}
    off = []
    for k in range(250):
        chase.guidance.note_mode(Heartbeat(**beat, custom_mode=23 if k >= 50 else 4))
        sent = chase.guidance.virtual_leader(state(T + k * TICK, STILL, STILL), behind, STILL)
        off.append(float(np.linalg.norm(slot_of(sent)[0] - behind)))
    assert max(off[:50]) == 0.0
    assert off[99] == pytest.approx(2.0, abs=0.1)
    assert off[-1] > 3.5
    chase.guidance.note_mode(Heartbeat(**beat | {"vehicle_type": 10}, custom_mode=4))  # a rover's number
    sent = chase.guidance.virtual_leader(state(T + 251 * TICK, STILL, STILL), behind, STILL)
    assert np.linalg.norm(slot_of(sent)[0] - behind) > 3.5


def test_a_vehicle_far_behind_its_slot_flies_as_fast_as_a_leader_whose_speed_is_unsure() -> None:
    """A real one was bounded as if in its slot: led by 2 m/s behind a leader with 6, it never came back."""
    guidance = Guidance(GuidanceConfig())
    for k in range(500):
        r, v = straight(k, 6.0)
        known = state(T + k * TICK, r, v, sigma=9.0, velocity_sigma=2.2)
        sent = guidance.virtual_leader(known, r - (80.0, 0.0, 0.0), v)
    _, v_sent = slot_of(sent)
    assert v_sent[0] == pytest.approx(6.0, abs=0.3)


def test_a_leader_that_seems_to_be_farther_off_each_moment_is_not_chased_faster_than_it_flies() -> None:
    """Seen edge-on in a turn, a leader with 3 m/s was, moment by moment, estimated 2 m/s faster away."""
    guidance, v = Guidance(GuidanceConfig()), np.array([3.0, 0.0, 0.0])
    fastest = 0.0
    for k in range(450):
        r = 0.02 * k * v + (0.04 * max(k - 300, 0), 0.0, 0.0)
        sent = guidance.virtual_leader(state(T + k * TICK, r, v), 0.02 * k * v - (36.0, 0.0, -3.0), v)
        fastest = max(fastest, slot_of(sent)[1][0])
    assert 3.0 < fastest < 3.6
