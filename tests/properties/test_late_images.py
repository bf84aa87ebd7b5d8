"""Late, shuffled and doubled images give the same belief; wrong and absurd ones do not break the filter."""

import math
from collections.abc import Iterable
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from onboard.estimators.leader.config import Config
from onboard.messages import Estimate, Message, TargetPoints, Verdict
from onboard.messages.causes import Cause
from tests.support.cases import slow_but
from tests.support.streams import (
    CIRCLE,
    EPOCH,
    FOCAL_LENGTH_PX,
    MS,
    Item,
    Run,
    S,
    Stream,
    advance,
    assert_sane,
    heartbeat,
    make_config,
    position_error,
)

T0, T1 = 5.0, 9.0
ENTANGLED = round((T0 + 1.0) * S)  # up to here images come in order, so that both tracks start from the same ones
SETTLED = round((T1 - 0.6) * S)  # images after this are left out, so that all have come at the end
OWN = tuple(i for i in Stream(t0=T0, t1=T1, images=lambda _t: False).items())
IMAGES = tuple(
    i.message
    for i in Stream(t0=T0, t1=T1, latency=0, seed=3).items()
    if isinstance(i.message, TargetPoints) and i.message.t_ns < SETTLED
)


def delivered(images: Iterable[tuple[int, TargetPoints]]) -> Run:
    """Own motion in order, with each image put in at its boot time of delivery."""
    items = [Item(EPOCH + t_ns, image) for t_ns, image in images]
    return advance(item.message for item in sorted([*OWN, *items], key=lambda i: i.t_recv_ns))


def in_order(images: Iterable[TargetPoints] = IMAGES) -> Run:
    """Each image when own motion is already known at its time."""
    return delivered((m.t_ns + 45 * MS, m) for m in images)


@cache
def reference() -> Run:
    return in_order()


def last(run: Run) -> Estimate:
    """The estimate at the last navigation sample, also where none was due."""
    pipeline = run.pipeline
    leader: Any = pipeline.estimators["leader"]
    return leader._tracks["leader"].tick(pipeline.ownship)


def assert_same_belief(run: Run, expected: Run | None = None) -> None:
    a, b = last(run), last(expected or reference())
    assert a.t_ns == b.t_ns
    assert a.mean is not None
    assert b.mean is not None
    np.testing.assert_allclose(a.mean, b.mean, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(a.covariance, b.covariance, rtol=1e-11, atol=1e-12)
    assert a.age == b.age


def test_the_reference_is_a_track_that_holds() -> None:
    assert last(reference()).valid
    assert position_error(last(reference())) < 2.9
    assert set(reference().verdicts()) == {Verdict.INITIALISING, Verdict.FUSED}


def late_by(delays: list[int]) -> Run:
    return delivered(
        (m.t_ns + (45 * MS if m.t_ns < ENTANGLED else delay * MS), m)
        for m, delay in zip(IMAGES, delays, strict=True)
    )


@settings(max_examples=3, deadline=None, derandomize=True)
@given(st.lists(st.integers(0, 440), min_size=len(IMAGES), max_size=len(IMAGES)))
def test_late_and_shuffled_images_give_the_belief_of_those_in_order(delays: list[int]) -> None:
    assert_same_belief(late_by(delays))


def test_the_noise_of_a_detector_is_learnt_from_late_images_as_from_those_in_order_seeds_5_to_8() -> None:
    """While the track lives: its first seconds, before the noise is learnt, may end it, as nothing fits."""
    lived = 0
    for seed in range(5, 9):
        rng = np.random.default_rng(seed)
        noisy = []
        for m in IMAGES:
            points = np.array([m.center, m.left, m.right]) + 2.5 * rng.normal(size=(3, 2)) / FOCAL_LENGTH_PX
            center, left, right = (tuple(p) for p in points.tolist())
            noisy.append(replace(m, center=center, left=left, right=right))
        delays = [
            45 if m.t_ns < ENTANGLED else d for m, d in zip(noisy, rng.integers(0, 440, len(noisy)), strict=True)
        ]
        run = delivered((m.t_ns + int(d) * MS, m) for m, d in zip(noisy, delays, strict=True))
        found = "the images fit worse than the configured noise explains" in last(run).reason
        if last(run).reset_count or not found:  # the track has begun anew, or every image is gated
            assert last(run).cause in (Cause.PREDICTED, Cause.UNEXPECTED)
            continue
        assert 1.4 < run.reports[-1].noise_scale < 3.5
        assert_same_belief(run, in_order(noisy))
        lived += 1
    assert lived >= 3


@settings(max_examples=3, deadline=None, derandomize=True)
@given(st.data())
def test_duplicates_have_no_effect(data: st.DataObject) -> None:
    again = data.draw(st.lists(st.tuples(st.integers(0, len(IMAGES) - 1), st.integers(46, 900)), max_size=30))
    run = delivered(
        [(m.t_ns + 45 * MS, m) for m in IMAGES] + [(IMAGES[i].t_ns + delay * MS, IMAGES[i]) for i, delay in again]
    )
    assert_same_belief(run)
    assert run.verdicts().get(Verdict.DUPLICATE, 0) == len(again)


def test_an_image_older_than_the_horizon_is_rejected_and_has_no_effect() -> None:
    missed = IMAGES[60]
    without = in_order(m for m in IMAGES if m is not missed)
    late = delivered(
        [(m.t_ns + 45 * MS, m) for m in IMAGES if m is not missed] + [(missed.t_ns + 700 * MS, missed)]
    )
    assert late.verdicts()[Verdict.TOO_OLD] == 1
    assert_same_belief(late, without)


@pytest.mark.parametrize("seed", [4, 5])
def test_gated_wrong_blobs_have_no_effect_with_seed(seed: int) -> None:
    rng = np.random.default_rng(seed)
    chosen = set(rng.choice(np.arange(40, len(IMAGES)), 8, replace=False).tolist())
    wrong = []
    for i in sorted(chosen):
        at = rng.uniform(-0.4, 0.4, 2)
        points = [tuple(p) for p in (np.array([[0, 0], [-0.05, 0.0], [0.05, 0.01]]) + at).tolist()]
        m = replace(IMAGES[i], t_ns=IMAGES[i].t_ns + 7 * MS, center=points[0], left=points[1], right=points[2])
        wrong.append((m.t_ns + 45 * MS, m))
    run = delivered([(m.t_ns + 45 * MS, m) for m in IMAGES] + wrong)
    assert run.verdicts()[Verdict.GATED] == len(wrong)
    # one more prediction boundary at each wrong image's time: the same belief up to how steps are cut
    assert last(run).valid
    np.testing.assert_allclose(last(run).mean, last(reference()).mean, rtol=1e-3, atol=1e-3)


# ------------------------------------------------------------------------------------------ fuzzing

ABSURD = (0.0, -0.0, 1e-300, 1e-9, 1e-3, 1.0, 57.0, 1e4, 1e15, 1e154, 1e300, -1e300, math.inf, -math.inf, math.nan)


def absurd_image(rng: np.random.Generator, image: TargetPoints) -> TargetPoints:
    """The image with something made extreme, or nothing."""
    kind = rng.integers(0, 9)
    if kind == 0:
        return replace(image, center=(rng.choice(ABSURD), rng.choice(ABSURD)))
    if kind == 1:
        return replace(image, left=(rng.choice(ABSURD), rng.choice(ABSURD)), right=(rng.choice(ABSURD), 0.1))
    if kind == 2:
        return replace(image, sigma=tuple(rng.choice([*ABSURD, -1.0, 1e-3, 1e-3], 3).tolist()))
    if kind == 3:
        return replace(
            image, t_ns=image.t_ns + int(rng.choice([-(10**10), -(10**8), 10**7, 10**9, 10**18, -(10**18)]))
        )
    if kind == 4:
        return replace(image, right=image.left)
    if kind == 5:
        return replace(image, left=image.right, right=image.left)
    if kind == 6:
        scale = float(10 ** rng.uniform(-3, 3))
        points = [tuple((scale * np.array(p)).tolist()) for p in (image.center, image.left, image.right)]
        return replace(image, center=points[0], left=points[1], right=points[2])
    return image


def absurd_own(rng: np.random.Generator, message: Message) -> Message:
    """Own motion with something made extreme, seldom."""
    if rng.random() > 0.05:
        return message
    if hasattr(message, "omega_b"):
        if rng.random() < 0.5:
            return replace(message, omega_b=tuple(rng.choice(ABSURD, 3).tolist()))
        return replace(message, q_nb=tuple(rng.choice(ABSURD, 4).tolist()))
    if hasattr(message, "v_F_n"):
        if rng.random() < 0.5:
            return replace(message, r_OF_n=tuple(rng.choice(ABSURD, 3).tolist()))
        return replace(message, v_F_n=tuple(rng.choice(ABSURD, 3).tolist()))
    return message


@pytest.mark.parametrize(
    ("seed", "initialise", "sequences"), slow_but([(11, 3, 40)], [(11, 3, 40), (11, 3, 125), (12, 1, 125)])
)
def test_fuzzed_sequences_never_raise_nor_emit_a_broken_belief(
    monkeypatch: pytest.MonkeyPatch, seed: int, initialise: int, sequences: int
) -> None:
    rng = np.random.default_rng(seed)
    monkeypatch.setattr(Config, "initialise_images", initialise)
    config = make_config()
    valid = 0
    for _ in range(sequences):
        start = rng.uniform(5, 50)
        messages: list[Message] = [heartbeat(round(start * S))]
        t_ns = round(start * S)
        for _ in range(24):
            t_ns += int(rng.choice([4 * MS, 20 * MS, 60 * MS, 400 * MS, 3 * S], p=[0.2, 0.5, 0.2, 0.07, 0.03]))
            messages.append(absurd_own(rng, CIRCLE.attitude(t_ns)))
            messages.append(absurd_own(rng, CIRCLE.position(t_ns)))
            image = CIRCLE.image(t_ns - int(rng.integers(0, 300)) * MS, rng)
            messages.append(absurd_image(rng, image))
            if rng.random() < 0.2:
                messages.append(messages[-1])
        if rng.random() < 0.3:
            i = rng.permutation(len(messages) - 1) + 1
            messages = [messages[0], *(messages[k] for k in i)]
        run = advance(messages, config)
        assert_sane(run.estimates)
        valid += sum(e.valid for e in run.estimates)
    assert valid > 4 * sequences, "the fuzz must leave the filter something to fly on"
