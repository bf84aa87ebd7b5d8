"""Detections with less than three points: what they measure, and that nothing is made up of the rest."""

import math
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from onboard.estimators.leader.assumptions import CENTER_OFFSET_RATIO, OFFSET_BIAS_FACTOR
from onboard.estimators.leader.image.prepare import features_of, measure
from onboard.estimators.leader.image.shape import shape_of
from onboard.messages import ImageFeature, Lifecycle, Message, TargetDetection, TargetPoints, Verdict
from tests.support.streams import CIRCLE, FOCAL_LENGTH_PX, Run, S, Stream, advance, make_config, position_error

SIGMA = 1 / FOCAL_LENGTH_PX


def less(image: TargetPoints, *names: str, box: float | None = None, target: str = "leader") -> TargetDetection:
    """Of an image only these points, or a box whose middle is the center and whose half width is given."""
    features = tuple(ImageFeature(name=n, point=getattr(image, n), sigma=SIGMA) for n in names)
    fields = {name: getattr(image, name) for name in ("t_ns", "t_recv_ns", "system", "component", "camera")}
    if box is None:
        return TargetDetection(**fields, target=target, features=features)
    u, v = image.center
    middle = ImageFeature(name="box", point=image.center, sigma=3 * SIGMA)
    sides = (u - box, v), (u, v), (u + box, v), (u, v)  # as flat as can be
    return TargetDetection(**fields, target=target, features=(middle,), half_width=box, sides=sides)


def saw(detection: TargetPoints | TargetDetection, *, center_on_wing: bool = False) -> Any:
    return features_of(detection, SIGMA, center_on_wing=center_on_wing, half_wing=0.04)


IMAGE = CIRCLE.image(6 * S)
SPAN = math.dist(IMAGE.left, IMAGE.right)


def test_a_pair_of_wingtips_measures_the_wing_and_its_middle_with_the_doubt_of_the_center() -> None:
    shape = shape_of(make_config().estimator["leader"])
    whole, pair = measure(shape, saw(IMAGE)), measure(shape, saw(less(IMAGE, "left", "right")))
    assert pair.span == pytest.approx(whole.span, rel=1e-3)
    assert pair.rows.R[2, 2] == pytest.approx(whole.rows.R[2, 2], rel=1e-2)
    assert math.sqrt(pair.rows.R[0, 0]) == pytest.approx(OFFSET_BIAS_FACTOR * CENTER_OFFSET_RATIO * SPAN, rel=0.1)
    middle = (np.array(IMAGE.left) + np.array(IMAGE.right)) / 2
    assert pair.axes[0][1:] / pair.axes[0][0] == pytest.approx(middle)


def test_with_the_center_on_the_wing_the_middle_is_the_center_and_is_measured_once() -> None:
    shape = shape_of(make_config("estimator.leader.center_on_wing=true").estimator["leader"])
    pair = measure(shape, saw(less(IMAGE, "left", "right"), center_on_wing=True))
    assert math.sqrt(pair.rows.R[0, 0]) < 0.1 * SPAN
    assert len(pair.y) == 4
    assert len(measure(shape, saw(IMAGE, center_on_wing=True)).y) == 6


@pytest.mark.parametrize("what", ["center", "left", "box"])
def test_one_point_or_a_box_measures_a_direction_and_no_wing(what: str) -> None:
    shape = shape_of(make_config().estimator["leader"])
    detection = less(IMAGE, box=0.05) if what == "box" else less(IMAGE, what)
    m = measure(shape, saw(detection))
    expected = {
        "center": SIGMA,
        "left": math.hypot(SIGMA, OFFSET_BIAS_FACTOR * 0.04),
        "box": math.hypot(0.05 * 0.1 / math.sqrt(2.0), OFFSET_BIAS_FACTOR * 0.1 * 2 * 0.05),
    }
    assert math.hypot(math.sqrt(m.rows.R[0, 0]), m.off) == pytest.approx(expected[what], rel=0.05)
    assert m.y[2:].tolist() == pytest.approx([0.098, 0.0] if what == "box" else [], abs=1e-3)


def flown(change: Any, *overrides: str, t1: float = 10.0, after: float = 8.0) -> Run:
    """A flight whose images are changed from `after` on."""
    messages: list[Message] = []
    for message in (item.message for item in Stream(t1=t1).items()):
        changes = isinstance(message, TargetPoints) and message.t_ns >= after * S
        messages.append(change(message) if changes else message)
    return advance([m for m in messages if m is not None], make_config(*overrides))


def test_without_the_center_a_track_starts_and_stays_on_the_target_seed_1() -> None:
    run = flown(lambda m: less(m, "left", "right"), after=0.0)
    assert run.verdicts() == {Verdict.INITIALISING: 3, Verdict.FUSED: 122}
    assert run.estimates[-1].valid
    assert position_error(run.estimates[-1]) < 2.7


@pytest.mark.parametrize("kind", ["center", "box"])
def test_a_direction_keeps_the_direction_of_a_track_seed_1(kind: str) -> None:
    run = flown(lambda m: less(m, box=SPAN / 2) if kind == "box" else less(m, kind), t1=10.0, after=8.0)
    newest = run.estimates[-1]
    assert run.verdicts()[Verdict.FUSED] == 122
    assert newest.mean is not None
    truth = CIRCLE.relative(newest.t_ns / S)[0]
    off = np.cross(newest.mean[:3], truth) / np.linalg.norm(newest.mean[:3]) / np.linalg.norm(truth)
    assert np.linalg.norm(off) < 0.0135
    blind = flown(lambda _: None, t1=10.0, after=8.0).estimates[-1]
    assert np.trace(np.array(newest.covariance)[:3, :3]) < np.trace(np.array(blind.covariance)[:3, :3])


def test_directions_alone_hold_a_track_for_five_seconds_and_the_wing_brings_it_back_seed_1() -> None:
    run = flown(
        lambda m: less(m, "center") if m.t_ns < 13.5 * S else m,
        t1=14,
        after=7,
    )
    states = {t: next(e for e in run.estimates if e.t_ns >= t * S) for t in (11.9, 12.1, 13.9)}
    assert states[11.9].valid
    assert (states[12.1].valid, states[12.1].state) == (False, Lifecycle.LOST)
    assert states[12.1].reason.startswith("no image has shown the wing")
    assert states[13.9].valid
    assert position_error(states[13.9]) < 0.8


def test_a_direction_alone_starts_no_track_and_says_so_seed_1() -> None:
    run = flown(lambda m: less(m, "center"), t1=7.0, after=0.0)
    assert set(run.verdicts()) == {Verdict.DIRECTION_ONLY}
    assert run.estimates[-1].mean is None
    (refusal,) = run.pipeline.health(0).refusals
    assert refusal.reason.startswith("direction_only: it shows no wing")


def test_a_direction_far_off_is_gated_and_never_restarts_the_track_seed_1() -> None:
    def aside(m: TargetPoints) -> TargetDetection:
        return less(replace(m, center=(m.center[0] + 0.3, m.center[1])), "center")

    run = flown(aside, t1=9.5, after=8.0)  # two seconds later a leader that accelerates could be there
    assert run.verdicts()[Verdict.GATED] > 30
    assert run.estimates[-1].reset_count == 0
    assert run.estimates[-1].state is Lifecycle.COASTING
