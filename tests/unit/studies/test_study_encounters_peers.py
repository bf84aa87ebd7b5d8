"""The bearing-angle filter beside ours: what it finds without noise, and what is claimed of both."""

import numpy as np
import pytest

from onboard.arrays import Array
from simlink.encounters.conditions import NOMINAL_SIZE
from simlink.encounters.encounter import make_encounter
from simlink.encounters.truth import at
from studies.encounters import study
from studies.encounters.bearing_angle import Box, boxes, predicted, started, updated
from studies.encounters.flights import Case, Flight
from studies.encounters.peers import APPARENT_WIDTH_RATIO, BESIDE, Pair

STEPS = 200
SIGMA = 1e-3  # rad


def box(p: Array, o: Array, size: float, t: float) -> Box:
    r = float(np.linalg.norm(p - o))
    return Box(t, (p - o) / r, size / r, SIGMA, SIGMA, o, o)


@pytest.mark.parametrize("pseudo_linear", [False, True])
def test_a_size_that_is_half_wrong_becomes_known_as_we_sway(*, pseudo_linear: bool) -> None:
    """Without noise, in the paper's form and about the prediction."""
    place, size = np.array([25.0, 5.0, -2.0]), 2.0
    x, P = started(box(place, np.zeros(3), size, 0.0), 1.5 * size, 0.5 * size)
    assert np.linalg.norm(x[:3]) == pytest.approx(1.5 * np.linalg.norm(place))
    for k in range(400):
        o = np.array([0.0, 3.0 * np.sin(0.03 * k), 0.0])
        x, P = predicted(x, P, 0.05, 0.01)
        x, P = updated(x, P, box(place, o, size, 0.05 * k), pseudo_linear=pseudo_linear)
    assert x[6] == pytest.approx(size, rel=0.02)
    assert np.linalg.norm(x[:3] - place) < 0.5
    assert np.sqrt(P[6, 6]) < 0.05 * size


def test_without_motion_the_size_stays_as_uncertain_as_it_was() -> None:
    place, size = np.array([25.0, 5.0, -2.0]), 2.0
    x, P = started(box(place, np.zeros(3), size, 0.0), size, 0.5)
    for k in range(100):
        x, P = updated(*predicted(x, P, 0.05, 0.01), box(place, np.zeros(3), size, 0.05 * k))
    assert np.sqrt(P[6, 6]) == pytest.approx(0.5, rel=0.1)


def test_boxes_have_bearing_and_angle_by_our_own_pose_seed_3() -> None:
    encounter = make_encounter("circling", 3, 4.0, "rotor_box")
    truth, found = encounter.truth, boxes(encounter)
    t = np.array([b.t for b in found])
    r_FL, ours = at(truth.t, truth.r_FL_n, t), at(truth.t, truth.follower.r, t)
    for b, r, o in zip(found, r_FL, ours, strict=True):
        assert np.linalg.norm(b.r_OF - o) < 0.2
        direction = r - (b.o - b.r_OF)
        assert b.g @ direction / np.linalg.norm(direction) > np.cos(np.radians(4.0))
    angles = np.array([b.theta for b in found]) * np.linalg.norm(r_FL, axis=1)
    assert 0.75 < np.mean(angles) / (APPARENT_WIDTH_RATIO * NOMINAL_SIZE) < 1.3


def test_ours_may_be_worse_by_a_tenth() -> None:
    def made(off: float, nees: float = 3.0) -> Flight:
        ones = np.ones(STEPS)
        return Flight(np.linspace(5.0, 45.0, STEPS), 20.0 * ones, (20.0 + off) * ones, ones, nees * ones)

    def verdicts(ours: Flight) -> list[str]:
        paired = {name: [Pair(made(0.5), made(0.5))] * 2 for name in BESIDE}
        paired["we circle, size known"] = [Pair(ours, made(1.0))] * 2
        found = study.findings({Case("hover"): [made(0.0)] * 2}, 1, paired=paired)
        assert [len(row) for row in found.tables[-1].rows] == [len(found.tables[-1].header)] * len(BESIDE)
        return [str(claim.verdict) for claim in found.claims[-2:]]

    assert verdicts(made(1.09)) == ["holds", "holds"]
    assert verdicts(made(1.11)) == ["does not hold", "holds"]
    assert verdicts(made(1.0, nees=9.0)) == ["holds", "does not hold"]
