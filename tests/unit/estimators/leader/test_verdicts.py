"""What becomes of one image: just inside the gate and just outside it, out of order, and after a reset."""

from copy import deepcopy

import numpy as np
from msgspec.structs import replace

from onboard.estimators.leader.estimator import Estimator
from onboard.messages import Cause, Exposure, MeasurementReport, Reason, TargetPoints, Verdict
from onboard.ownship import Ownship
from tests.support.streams import FOCAL_LENGTH_PX, MS, Flight, S, Stream, advance, feed, heartbeat, make_config


def tracking() -> tuple[Estimator, Ownship, list[TargetPoints]]:
    """An estimator after 2 s of images, our own motion, and the images that were not shown to it yet."""
    messages = [item.message for item in Stream(t1=7.0, sparse=True).items()]
    last_ns = 6800 * MS
    shown = [m for m in messages if not (isinstance(m, TargetPoints) and m.t_ns >= last_ns)]
    pipeline = advance([heartbeat(5 * S), *shown], make_config()).pipeline
    estimator = pipeline.estimators["leader"]
    assert isinstance(estimator, Estimator)
    left = [m for m in messages if isinstance(m, TargetPoints) and m.t_ns >= last_ns]
    return estimator, pipeline.ownship, left


def judged(estimator: Estimator, ownship: Ownship, image: TargetPoints) -> MeasurementReport:
    (estimate,) = estimator.observe(Exposure.of(image), ownship)
    assert estimate.measurement is not None
    return estimate.measurement


def moved(image: TargetPoints, px: float) -> TargetPoints:
    """All three points to the right."""
    center, left, right = ((u + px / FOCAL_LENGTH_PX, v) for u, v in (image.center, image.left, image.right))
    return replace(image, center=center, left=left, right=right)


def test_an_image_is_fused_up_to_the_gate_and_no_farther_seed_1() -> None:
    estimator, ownship, (image, *_) = tracking()
    reports = [judged(deepcopy(estimator), ownship, moved(image, 0.25 * k)) for k in range(48)]
    ratios = [m.nis / m.gate for m in reports if m.nis is not None and m.gate is not None]
    assert [m.verdict for m in reports] == [Verdict.FUSED if ratio <= 1.0 else Verdict.GATED for ratio in ratios]
    assert any(0.8 < ratio <= 1.0 for ratio in ratios)
    assert any(1.0 < ratio < 1.2 for ratio in ratios)


def test_an_image_older_than_the_newest_is_fused_late_and_says_so_seed_1() -> None:
    estimator, ownship, (first, second, *_) = tracking()
    assert judged(estimator, ownship, second).verdict is Verdict.FUSED
    assert judged(estimator, ownship, first).verdict is Verdict.FUSED_LATE
    assert judged(estimator, ownship, first).verdict is Verdict.DUPLICATE


def test_after_a_reset_the_same_stamps_are_new_seed_1() -> None:
    estimator, ownship, (first, *_) = tracking()
    assert judged(estimator, ownship, first).verdict is Verdict.FUSED
    estimator.reset(Reason(Cause.REBOOTED, "the autopilot has rebooted"))
    assert judged(estimator, ownship, first).verdict is Verdict.INITIALISING


def test_small_spans_are_fused_and_start_nothing_seed_1() -> None:
    """Were they refused, those would be left that noise has made larger: who flies away would stay near."""
    far = Flight(radius=None, gap=400.0)  # 2.8 px, which are two sigmas
    run = Stream(flight=far, t1=25.0, sparse=True).datagrams()
    verdicts = feed(run).verdicts()
    assert Verdict.DEGENERATE not in verdicts
    assert verdicts[Verdict.FUSED] > 0.9 * sum(verdicts.values())
    estimator, ownship, (image, *_) = tracking()
    center, left, right = (np.array(p) for p in (image.center, image.left, image.right))
    for share, alone in ((0.05, Verdict.DIRECTION_ONLY), (0.0, Verdict.DEGENERATE)):
        tips = (tuple((center + share * (tip - center)).tolist()) for tip in (left, right))
        small = replace(image, **dict(zip(("left", "right"), tips, strict=True)))
        startup_evidence = deepcopy(estimator)
        startup_evidence.reset(Reason(Cause.REBOOTED, "the autopilot has rebooted"))
        assert judged(startup_evidence, ownship, small).verdict is alone
