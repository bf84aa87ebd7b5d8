"""What images show of a wrong set-up, though they can be used."""

import numpy as np
import pytest
from msgspec.structs import replace

from onboard.config import Config, parse_config
from onboard.geometry.lens import Lens
from onboard.health.cameras import Hints
from onboard.health.words import WORDS
from onboard.messages import DOUBT_PREFIX, Message, Reason, Severity, TargetPoints
from onboard.sinks.console import ConsoleLines
from onboard.wire.documents.points import doubt_of
from tests.support.streams import CIRCLE, EPOCH, SIZE, Run, S, Stream, advance

SECONDS = 65.0


def config(**ranges: bool) -> Config:
    return parse_config({"estimator": {"leader": {"size_prior_m": SIZE, "range": ranges}}})


def sent(shift: float) -> list[Message]:
    """A flight whose images are halved and moved so far to the left and up, in focal lengths."""

    def changed(m: Message) -> Message:
        if not isinstance(m, TargetPoints):
            return m
        points = 0.5 * np.array([m.center, m.left, m.right]) - shift
        center, left, right = (tuple(p) for p in points.tolist())
        return replace(m, center=center, left=left, right=right)

    return [changed(i.message) for i in Stream(t0=5.0, t1=5.0 + SECONDS, flight=CIRCLE).items()]


def reasons(run: Run) -> list[str]:
    return [refusal.reason for refusal in run.pipeline.health(0).refusals]


def test_pixels_of_an_image_of_half_the_size_are_noticed() -> None:
    run = advance(sent(0.25), config())
    assert [r for r in reasons(run) if "upper left quarter" in r]
    assert any(e.valid for e in run.estimates)
    lines: list[str] = []
    ConsoleLines(lines.append, pilot=lambda _: None).show_health(run.pipeline.health(EPOCH + 71 * S))
    (line,) = [line for line in lines if "quarter" in line]
    assert line.startswith(f"camera landing_target: {DOUBT_PREFIX}")


@pytest.mark.parametrize("shift", [0.0, 0.25])
def test_pixels_about_the_middle_are_not(shift: float) -> None:
    found: list[tuple[str, Reason, int]] = []
    hints = Hints(lambda *one: found.append(one), takes_ranges=True)
    for image in sent(shift):
        if isinstance(image, TargetPoints):
            hints.see(image)
    assert bool([why for _, why, _ in found if "quarter" in why.words]) is (shift > 0)


@pytest.mark.parametrize("used", [False, True])
def test_a_range_that_nothing_uses_is_named(used: bool) -> None:
    images = [
        replace(i.message, range=28.0) for i in Stream(t1=7.0).items() if isinstance(i.message, TargetPoints)
    ]
    others = [i.message for i in Stream(t1=7.0).items() if not isinstance(i.message, TargetPoints)]
    run = advance(sorted([*others, *images], key=lambda m: m.t_recv_ns), config(detections=used))
    assert bool([r for r in reasons(run) if "`range_m` of its detections is not used" in r]) is not used


def test_doubtful_intrinsics_are_named_as_long_as_images_come() -> None:
    lens = Lens(
        fx_px=500.0, fy_px=500.0, cx_px=100.0, cy_px=240.0, width_px=640.0, height_px=480.0
    ).of_whole_image()
    images = [replace(CIRCLE.image(k * S), doubt=doubt_of(lens)) for k in (6, 7)]
    found: list[tuple[str, Reason, int]] = []
    hints = Hints(lambda *one: found.append(one), takes_ranges=True)
    for image in images:
        hints.see(image)
    assert [t for _, _, t in found] == [image.t_recv_ns for image in images]
    _, why, _ = found[0]
    assert why.words.startswith(f"{DOUBT_PREFIX}the principal point (100, 240) is far from the middle")
    remedy = WORDS[why.cause].refusal
    assert (remedy.advice, remedy.severity) == ("pixels", Severity.WARNING)
