"""Boxes, and points for nose and tail, flown: encounters through the pipeline as it ships."""

import math

import numpy as np

from onboard.messages import Estimate, Lifecycle
from onboard.pipeline import Pipeline
from simlink.encounters.encounter import BOOT_NS, Encounter, make_encounter
from simlink.scenarios.camera import Sees
from studies.encounters.flights import FIVE_POINTS, WINGED, Case, fly, known
from studies.encounters.scores import score
from tests.support.streams import make_config


def flown(family: str, seed: int, seconds: float, sees: Sees, *settings: str) -> tuple[Encounter, list[Estimate]]:
    """An encounter, and the leader's estimates."""
    encounter = make_encounter(family, seed, seconds, sees)
    pipeline = Pipeline(make_config(*known(encounter), *settings))
    outputs = (output for datagram in encounter.datagrams() for output in pipeline.feed(datagram))
    return encounter, [o for o in outputs if isinstance(o, Estimate) and o.name == "leader"]


def range_sigma_of_one_that_holds_the_truth(encounter: Encounter, estimate: Estimate) -> float:
    """The standard deviation of an estimate's range, as a share of it. The truth must be in the 95 % ellipsoid."""
    assert estimate.mean is not None
    assert estimate.covariance is not None
    truth = encounter.truth.r_FL_n[np.searchsorted(encounter.truth.t, (estimate.t_ns - BOOT_NS) * 1e-9) - 1]
    off, P = np.array(estimate.mean[:3]) - truth, np.array(estimate.covariance)[:3, :3]
    assert off @ np.linalg.solve(P, off) < 7.8
    return math.sqrt(truth @ P @ truth) / float(truth @ truth)


def test_boxes_alone_start_a_track_and_hold_it_seed_5() -> None:
    encounter, estimates = flown("hover", 5, 8.0, "box", *WINGED)
    assert estimates[-1].state is Lifecycle.TRACKING
    sigma = range_sigma_of_one_that_holds_the_truth(encounter, estimates[-1])
    assert 0.17 < sigma < 0.32  # the bias of boxes, and no more than half the range


def test_nose_and_tail_resolve_the_heading_of_a_leader_that_hovers_seed_3() -> None:
    encounter, with_points = flown("hover", 3, 4.0, "points", *FIVE_POINTS)
    _, without = flown("hover", 3, 4.0, "wing")

    def heading(estimates: list[Estimate]) -> tuple[float, float]:
        newest = estimates[-1]
        assert newest.mean is not None
        assert newest.covariance is not None
        at = newest.components.index("heading")
        off = newest.mean[at] - encounter.truth.euler_L[-1, 2]
        return math.degrees((off + math.pi) % (2 * math.pi) - math.pi), math.degrees(
            newest.covariance[at][at] ** 0.5
        )

    off, sigma = heading(with_points)
    assert abs(off) < 4.0
    assert sigma < 2.7
    assert "not resolved" not in with_points[-1].reason
    assert heading(without)[1] > 25.0


def test_points_that_a_detector_always_misplaces_make_no_range_confidently_wrong_seed_701() -> None:
    found = score([fly(Case("hover", FIVE_POINTS, "points"), 701)])
    assert found.wrong.percent == 0.0
    assert found.inside.percent > 80.0
    assert found.sigma < 7.0
