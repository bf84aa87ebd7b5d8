"""Named points that fit no heading: left out, named, and no harm to the others."""

import math
from typing import Any

import numpy as np
from msgspec.structs import replace

from onboard.messages import Estimate, ImageFeature, Message, TargetPoints
from onboard.pipeline import Pipeline
from simlink.encounters.encounter import BOOT_NS, make_encounter
from studies.encounters.flights import FIVE_POINTS, known
from tests.support.images import detections, exposed
from tests.support.streams import make_config

SECONDS, MOVED_S = 9.0, 4


def flown(
    moved: dict[str, tuple[float, float]], after: float = MOVED_S
) -> tuple[list[Estimate], dict[str, int], Any]:
    """A hover seen with nose and tail, of which some are found elsewhere by so much, in focal lengths, later."""
    encounter = make_encounter("hover", 4, SECONDS, "points")
    pipeline = Pipeline(make_config(*known(encounter), *FIVE_POINTS))

    def seen(m: Message) -> Message:
        if not isinstance(m, TargetPoints) or m.t_ns < BOOT_NS + after * 1e9:
            return m
        return replace(m, others=tuple(elsewhere(f) for f in m.others))

    def elsewhere(f: ImageFeature) -> ImageFeature:
        (u, v), (du, dv) = f.point, moved.get(f.name, (0.0, 0.0))
        return replace(f, point=(u + du, v + dv))

    outputs = (
        o
        for d in encounter.datagrams()
        for o in pipeline.advance(exposed(map(seen, detections(pipeline.decode(d)))))
    )
    estimates = [o for o in outputs if isinstance(o, Estimate) and o.name == "leader"]
    verdicts = pipeline.health(0).verdicts
    counts = {k.removeprefix("leader.misfit_"): n for k, n in verdicts.items() if "misfit" in k}
    return estimates, counts, encounter.truth


def range_off(estimate: Estimate, truth: Any) -> float:
    assert estimate.mean is not None
    at = np.searchsorted(truth.t, (estimate.t_ns - BOOT_NS) * 1e-9) - 1
    return abs(math.hypot(*estimate.mean[:3]) / float(np.linalg.norm(truth.r_FL_n[at])) - 1.0)


def test_a_point_found_elsewhere_is_named_and_the_others_still_show_the_nose_seed_4() -> None:
    estimates, counts, truth = flown({"nose": (0.0, 0.03)})
    assert counts["nose"] > 10
    assert counts.get("tail", 0) < 0.1 * counts["nose"]
    named = [e.measurement.misfits for e in estimates if e.measurement is not None and e.measurement.misfits]
    moved_ns = BOOT_NS + MOVED_S * 10**9  # until then all fit, and none is a misfit
    assert all(e.t_ns >= moved_ns for e in estimates if e.measurement is not None and e.measurement.misfits)
    assert len(named) == counts["nose"] or ("nose",) in named
    assert "not resolved" not in estimates[-1].reason
    assert range_off(estimates[-1], truth) < 0.1
