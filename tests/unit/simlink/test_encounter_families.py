"""What each family of simlink's encounters claims of how both aircraft fly, and of what a detector makes of it."""

import json

import numpy as np
import pytest
from numpy.typing import NDArray

from onboard.messages import Encoding
from simlink.encounters.curves import Motion, follow_path
from simlink.encounters.encounter import Encounter, make_encounter
from simlink.encounters.families import FAMILIES
from simlink.world.constants import DT
from tests.unit.simlink.test_encounters import SEEDS

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


def test_a_fixed_wing_flies_through_its_air_nose_first_seeds_1_to_3() -> None:
    t: Array = 0.005 * np.arange(4001, dtype=np.float64)
    for seed in SEEDS:
        scene = FAMILIES["crab"](np.random.default_rng(seed), t, 1.0)
        through = scene.leader.v - scene.wind
        assert degrees_between(scene.nose, np.arctan2(through[:, 1], through[:, 0])).max() < 1e-6
        assert np.ptp(np.linalg.norm(through, axis=1)) < 1e-6


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
