"""What each family of simlink's encounters claims of how both aircraft fly, and of what a detector makes of it."""

import json

import numpy as np
import pytest
from numpy.typing import NDArray

from onboard.messages import Encoding, TargetPoints
from simlink.encounters.curves import Motion, follow_path
from simlink.encounters.encounter import BOOT_NS, Encounter, make_encounter
from simlink.encounters.families import FAMILIES
from simlink.world.constants import DT
from tests.unit.simlink.test_encounters import SEEDS, of

Array = NDArray[np.float64]


def degrees_between(a: Array, b: Array) -> Array:
    """|a - b|, 0 to 180 degrees, of angles in rad."""
    return np.abs(np.degrees((a - b + np.pi) % (2 * np.pi) - np.pi))


def course(motion: Motion) -> Array:
    return np.arctan2(motion.v[:, 1], motion.v[:, 0])


def speed(motion: Motion) -> Array:
    return np.asarray(np.linalg.norm(motion.v, axis=1))


def nose(encounter: Encounter) -> Array:
    return encounter.truth.euler_L[:, 2]


def sight(encounter: Encounter) -> Array:
    """Where we look to see the leader, rad."""
    r = encounter.truth.r_FL_n
    return np.arctan2(r[:, 1], r[:, 0])


@pytest.mark.parametrize(("family", "low", "high"), [("sideways", 38.0, 142.0), ("crab", 9.0, 29.0)])
def test_the_nose_is_as_far_off_the_course_as_claimed_seeds_1_to_3(family: str, low: float, high: float) -> None:
    for seed in SEEDS:
        e = make_encounter(family, seed)
        off = np.median(degrees_between(nose(e), course(e.truth.leader)))
        assert low < off < high
        assert np.linalg.norm(e.truth.v_FL_n, axis=1).max() < 6.0  # we fly along
        assert e.leader_class == ("fixed_wing" if family == "crab" else "multirotor")


def test_a_fixed_wing_flies_through_its_air_nose_first_seeds_1_to_3() -> None:
    t: Array = 0.005 * np.arange(4001, dtype=np.float64)
    for seed in SEEDS:
        scene = FAMILIES["crab"](np.random.default_rng(seed), t, 1.0)
        through = scene.leader.v - scene.wind
        assert degrees_between(scene.nose, np.arctan2(through[:, 1], through[:, 0])).max() < 1e-6
        assert np.ptp(np.linalg.norm(through, axis=1)) < 1e-6


def test_hovering_and_circling_leaders_stay_and_we_circle_seeds_1_to_3() -> None:
    for seed in SEEDS:
        both, around = make_encounter("hover", seed), make_encounter("circling", seed)
        for e in (both, around):
            assert np.ptp(e.truth.leader.r, axis=0).max() < 1.0
        assert speed(both.truth.follower).max() < 0.8
        assert np.ptp(np.unwrap(sight(both))) < 0.2
        assert np.ptp(np.unwrap(sight(around))) > 3.0  # rad, in 45 s


def test_a_crossing_leader_crosses_our_line_of_sight_seeds_1_to_3() -> None:
    for seed in SEEDS:
        e = make_encounter("crossing", seed)
        middle = len(e.truth.t) // 2
        across = degrees_between(course(e.truth.leader), sight(e))[middle]
        assert 38.0 < across < 142.0  # drawn from 45 to 135; our own wander turns the line of sight a little
        assert np.median(degrees_between(nose(e), course(e.truth.leader))) < 3.0


def test_both_wander_slowly_and_the_nose_turns_half_of_the_time_seeds_1_to_3() -> None:
    t: Array = 0.005 * np.arange(9001, dtype=np.float64)
    turning = []
    for seed in SEEDS:
        scene = FAMILIES["wander"](np.random.default_rng(seed), t, 1.0)
        rate = np.abs(np.gradient(scene.nose, 0.005))
        assert rate.max() < 0.2001
        turning.append(np.mean(rate > 0.02))
        assert all(0.9 < speed(m).max() < 3.01 for m in (scene.leader, scene.follower))
    assert 0.35 < np.mean(turning) < 0.65


def test_a_leader_that_comes_head_on_passes_close_and_leaves_seeds_1_to_3() -> None:
    for seed in SEEDS:
        e = make_encounter("head_on", seed)
        distance = np.linalg.norm(e.truth.r_FL_n, axis=1)
        assert 88.0 < distance[0] < 145.0
        assert degrees_between(nose(e), sight(e))[0] > 160.0  # its nose is to us
        assert 4.0 < distance.min() < 17.0
        assert distance[-1] > 150.0


def test_a_leader_starts_stops_turns_its_nose_and_leaves_along_it_seeds_1_to_3() -> None:
    for seed in SEEDS:
        e = make_encounter("stop_turn_leave", seed)
        v = speed(e.truth.leader)
        moving = np.flatnonzero(v > 2.0)
        stopped = np.flatnonzero(np.diff(moving) > 200)  # longer than a second
        assert v[0] < 0.1
        assert len(stopped) == 1
        away = course(e.truth.leader)[-1]
        assert degrees_between(nose(e)[-200:], away).max() < 12.0
        first = course(e.truth.leader)[moving[0]]
        assert degrees_between(first, away) < 116.0


def test_a_straight_leader_flies_sideways_and_we_keep_our_distance_seeds_1_to_6() -> None:
    swayed = []
    for seed in range(1, 7):
        e = make_encounter("straight_sideways", seed, 20.0)
        assert np.degrees(np.ptp(course(e.truth.leader))) < 10.0
        assert 38.0 < np.median(degrees_between(nose(e), course(e.truth.leader))) < 142.0
        distance = np.linalg.norm(e.truth.r_FL_n, axis=1)
        assert 10.0 < distance.min() < distance.max() < 37.0
        swayed.append(np.ptp(e.truth.r_FL_n, axis=0).max())
    assert min(swayed) < 1.0
    assert max(swayed) > 2.0


def test_a_steep_leader_is_seen_from_above_or_below_and_stays_in_the_image_seeds_1_to_3() -> None:
    signs, fast = set(), set()
    for seed in SEEDS:
        e = make_encounter("steep", seed, 12.0)
        r = e.truth.r_FL_n
        up = np.degrees(np.arcsin(-r[:, 2] / np.linalg.norm(r, axis=1)))
        assert 42.0 < np.abs(up).min() < np.abs(up).max() < 68.0
        signs.add(np.sign(up[0]))
        fast.add(bool(speed(e.truth.leader).max() > 3.0))
        assert len(of(e, TargetPoints)) > 0.6 * 12.0 * e.scenario.camera.rate
    assert signs == {-1.0, 1.0}
    assert fast == {False, True}


def test_a_fixed_wing_loiters_around_us_at_one_airspeed_seeds_1_to_3() -> None:
    for seed in SEEDS:
        t: Array = 0.005 * np.arange(9001, dtype=np.float64)
        scene = FAMILIES["loiter"](np.random.default_rng(seed), t, 1.0)
        through = scene.leader.v[2:-2] - scene.wind
        assert np.ptp(np.linalg.norm(through, axis=1)) < 1e-2
        assert degrees_between(scene.nose[2:-2], np.arctan2(through[:, 1], through[:, 0])).max() < 0.1
        away = (scene.leader.r - scene.follower.r)[:, :2]
        assert np.ptp(np.unwrap(np.arctan2(away[:, 1], away[:, 0]))) > 2.0 * np.pi
        assert np.ptp(np.linalg.norm(scene.leader.r, axis=1)) < 1e-6


@pytest.mark.parametrize(
    ("family", "before", "after"),
    [
        ("leaves_hover", (0.0, 0.5), (4.5, 12.5)),
        ("stops", (3.5, 10.5), (0.0, 0.5)),
        ("reverses", (3.5, 10.5), (1.5, 8.5)),
        ("climbs", (0.0, 8.5), (0.8, 8.8)),
    ],
)
def test_a_leader_begins_its_manoeuvre_when_it_says_and_we_are_late_seeds_1_to_3(
    family: str, before: tuple[float, float], after: tuple[float, float]
) -> None:
    for seed in SEEDS:
        e = make_encounter(family, seed)
        t, leader = e.truth.t, e.truth.leader
        assert e.manoeuvre is not None
        assert 12.0 < e.manoeuvre < 22.0
        early, late = t < e.manoeuvre - 0.2, t > e.manoeuvre + 13.0
        for when, (low, high) in ((early, before), (late, after)):
            assert low <= np.median(speed(leader)[when]) <= high
        changed = np.median(leader.v[late], axis=0) - np.median(leader.v[early], axis=0)
        done = (leader.v - np.median(leader.v[early], axis=0)) @ changed / (changed @ changed)
        assert np.abs(done[early]).max() < 0.3
        assert t[np.argmax(done > 0.5)] - e.manoeuvre < 7.0
        ours = e.truth.follower
        behind = (ours.v - np.median(ours.v[early], axis=0)) @ changed / (changed @ changed)
        assert t[np.argmax((behind > 0.5) & (t > e.manoeuvre))] > t[np.argmax(done > 0.5)]
        assert np.linalg.norm(e.truth.r_FL_n, axis=1).min() > 6.0
        if family == "reverses":
            assert np.median(leader.v[early], axis=0) @ np.median(leader.v[late], axis=0) < -4.0
        if family == "climbs":
            assert abs(changed[2]) > 0.8


def test_one_who_follows_is_in_step_until_the_path_changes_and_brakes_in_time() -> None:
    """A path at 8 m/s that stops at once after 10 s: whoever may brake by 2 m/s^2 passes its end by little."""
    t = DT * np.arange(6001)
    path = np.minimum(8.0 * t, 80.0)[:, None] * np.array([[0.6, 0.8, 0.0]])
    along = follow_path(path, 1.0, 2.0) @ np.array([0.6, 0.8, 0.0])
    assert np.abs(along - 8.0 * t)[t < 10.9].max() < 1e-6
    v = np.gradient(along, DT)
    assert np.abs(np.gradient(v, DT)).max() < 2.01
    assert 88.0 < along.max() < 106.0  # 8 m late, 16 m to brake
    assert along[-1] == pytest.approx(88.0, abs=0.2)


def test_the_edge_cuts_boxes_for_part_of_the_time_seeds_1_to_3() -> None:
    for seed in (1, 2, 3):
        e = make_encounter("cut", seed, 30.0, "rotor_box")
        c, whole = e.scenario.camera, 0
        edges = np.array([c.width_px, c.height_px]) / 2 - c.edge_gap_px
        cut, images = 0, [json.loads(d.data) for d in e.datagrams() if d.encoding == Encoding.DETECTIONS]
        for image in images:
            box = image["detections"][0]["box"]
            middle = np.array([box["u_px"] - c.width_px / 2, box["v_px"] - c.height_px / 2])
            ends = np.abs(middle) + 0.5 * np.array([box["width_px"], box["height_px"]])
            touches = np.abs(ends - edges).min() < 1e-3
            cut, whole = cut + touches, whole + (ends < edges).all()
            assert (ends <= edges + c.edge_gap_px + 1e-3).all()
        assert cut > 0.01 * len(images)
        assert whole > 0.4 * len(images)
        distance = np.linalg.norm(e.truth.r_FL_n, axis=1)
        assert 6.0 < distance.min() < distance.max() < 18.0


def test_a_class_flickers_as_the_family_says_seeds_1_to_8() -> None:
    first = []
    for seed in range(1, 9):
        e = make_encounter("class_flickers", seed, 8.0)
        wrong = e.scenario.camera.mistaken
        names = {round((m.t_ns - BOOT_NS) * 1e-9, 3): m.class_name for m in of(e, TargetPoints)}
        assert set(names.values()) <= {"drone", "airplane"}
        for t, name in names.items():
            assert (name == "airplane") == any(span.start <= t < span.end for span in wrong)
        first.append(names[min(names)])
        assert all(span.end - span.start < 0.41 for span in wrong if span.start > 0.0)
    assert set(first) == {"drone", "airplane"}


def test_another_aircraft_crosses_without_ids_seeds_1_and_2() -> None:
    for seed in (1, 2):
        e = make_encounter("two_cross", seed, 45.0, "rotor_box")
        truth, other = e.truth, e.truth.other
        assert other is not None
        away = other.r - truth.follower.r
        far = np.linalg.norm(away, axis=1)
        cosine = np.sum(away * truth.r_FL_n, axis=1) / far / np.linalg.norm(truth.r_FL_n, axis=1)
        apart = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
        k = int(np.argmin(apart))
        assert apart[k] < 4.0  # both hover, and are blown about
        assert 20.0 < truth.t[k] < 25.0
        assert min(apart[0], apart[-1]) > 45.0
        assert not 0.87 < far[k] / np.linalg.norm(truth.r_FL_n[k]) < 1.15
        images = [json.loads(d.data) for d in e.datagrams() if d.encoding == Encoding.DETECTIONS]
        assert {len(image["detections"]) for image in images} == {1, 2}
        assert all(not d.get("target") for image in images for d in image["detections"])
