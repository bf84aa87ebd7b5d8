"""How noisy the detector is, by the filter's own evidence."""

import math

import numpy as np
import pytest
from msgspec.structs import replace

from onboard.estimators.leader.assumptions import MAX_NOISE_SCALE, NOISE_WINDOW
from onboard.estimators.leader.image.detector import NoiseScale, Shown
from onboard.messages import TargetPoints
from tests.support.streams import FOCAL_LENGTH_PX, Item, S, Stream, encode, feed, position_error


def learnt_from(noise: float, windows: int, seed: int = 1) -> NoiseScale:
    """After images that are so many times as noisy as configured."""
    rng, learnt = np.random.default_rng(seed), NoiseScale()
    for _ in range(windows * NOISE_WINDOW):
        learnt = learnt.after(noise * rng.normal(size=4), learnt.scale**2 * np.eye(4))
    return learnt


@pytest.mark.parametrize("noise", [2.0, 3.7, 5.0])
def test_the_noise_is_learnt_and_reported(noise: float) -> None:
    learnt = learnt_from(noise, 6)
    assert learnt.scale == pytest.approx(noise, rel=0.2)
    assert learnt.finding == "the images fit worse than the configured noise explains"
    assert not learnt.contradiction


@pytest.mark.parametrize("seed", range(1, 9))
def test_noise_as_configured_changes_nothing_with_seeds_1_to_8(seed: int) -> None:
    learnt = learnt_from(1.0, 20, seed)
    assert learnt.scale == 1.0
    assert not learnt.finding


def follow(seed: int, noise: float, *, off: float = 0.0, cameras: tuple[str, ...] = ("front",)) -> float:
    """The mean scale by images at 10 Hz, of a belief that follows them. Each is off by `off` in turns, a second to
    one side and a second to the other, or as long as its camera is another one than the one before."""
    rng, learnt, x, P, scales = np.random.default_rng(seed), NoiseScale(), np.zeros(2), 1.0, []
    for k in range(20 * NOISE_WINDOW):
        camera, R, P = cameras[k % len(cameras)], learnt.scale**2, P + 0.02
        side = (-1.0) ** (k if len(cameras) > 1 else k // 10)
        e = noise * rng.normal(size=2) + side * off - x
        learnt = learnt.after(e, (P + R) * np.eye(2), shown=Shown(k * S // 10, camera, R))
        x, P = x + P / (P + R) * e, P * R / (P + R)
        scales.append(learnt.scale)
    return float(np.mean(scales[5 * NOISE_WINDOW :]))


@pytest.mark.parametrize("noise", [0.7, 1.0, 1.2, 1.4, 1.8])
def test_a_little_more_noise_is_learnt_from_the_differences_of_images_seeds_1_to_4(noise: float) -> None:
    found = [follow(seed, noise) for seed in range(1, 5)]
    assert np.mean(found) == pytest.approx(max(noise, 1.05), rel=0.1)


def test_a_misfit_that_lasts_from_image_to_image_is_no_noise_seeds_1_to_4() -> None:
    found = [follow(seed, 1.0, off=1.0) for seed in range(1, 5)]
    assert np.mean(found) == pytest.approx(1.1, abs=0.1)


def test_cameras_that_see_the_leader_in_two_places_are_not_noisy_seeds_1_to_4() -> None:
    found = [follow(seed, 1.0, off=0.7, cameras=("front", "side")) for seed in range(1, 5)]
    assert np.mean(found) < 1.15


def test_outliers_and_a_short_manoeuvre_change_nothing() -> None:
    learnt = NoiseScale()
    for k in range(20 * NOISE_WINDOW):
        learnt = learnt.after(np.full(2, 30.0 if k % 4 == 0 or 300 < k < 310 else 0.8), np.eye(2))
    assert learnt.scale == 1.0


def test_what_no_noise_explains_ends_valid_until_it_fits_again() -> None:
    learnt = learnt_from(14.0, 5)
    assert learnt.scale == MAX_NOISE_SCALE
    assert learnt.contradiction is not None
    assert learnt.contradiction.words.startswith("the images do not fit: NIS ")
    for _ in range(2 * NOISE_WINDOW):
        learnt = learnt.after(np.ones(2), MAX_NOISE_SCALE**2 * np.eye(2))
    assert not learnt.contradiction


def test_the_scale_falls_again_and_a_new_track_keeps_it() -> None:
    learnt = learnt_from(4.0, 6)
    learnt = learnt.restarted()
    assert learnt.scale > 3.0
    rng = np.random.default_rng(2)
    for _ in range(20 * NOISE_WINDOW):
        learnt = learnt.after(rng.normal(size=2), learnt.scale**2 * np.eye(2))
    assert learnt.scale < 1.3


def test_images_of_short_tracks_count_together() -> None:
    rng, learnt = np.random.default_rng(8), NoiseScale()
    for _ in range(4):
        for _ in range(NOISE_WINDOW // 2):
            learnt = learnt.after(3.0 * rng.normal(size=2), learnt.scale**2 * np.eye(2))
        learnt = learnt.restarted()
    assert learnt.scale > 2.0


def noisier(times: float, seed: int) -> list[Item]:
    """A flight whose images are so many times as noisy as configured."""
    rng, extra = np.random.default_rng(seed), math.sqrt(times**2 - 1.0) / FOCAL_LENGTH_PX
    items = []
    for item in Stream(t1=15.0).items():
        m = item.message
        if isinstance(m, TargetPoints):
            center, left, right = (
                tuple(np.array(p) + extra * rng.normal(size=2)) for p in (m.center, m.left, m.right)
            )
            m = replace(m, center=center, left=left, right=right)
        items.append(Item(item.t_recv_ns, m))
    return items


@pytest.mark.parametrize(("times", "is_again"), [(1.0, False), (4.0, True)])
def test_what_was_believed_with_too_little_noise_is_believed_no_more_seed_1(times: float, is_again: bool) -> None:
    """The hypotheses that died of it do not come back by a larger noise from then on."""
    run = feed(encode(noisier(times, 1)))
    late = [e for e in run.estimates if e.t_ns > 7 * S and e.covariance is not None]
    of_range = np.array([np.trace(np.array(e.covariance)[:3, :3]) for e in late])
    assert (np.max(of_range[1:] / of_range[:-1]) > 2.0) == is_again
    learnt = [e for e in late if e.t_ns > 10 * S]  # before, the images fit no hypothesis
    assert np.mean([e.valid for e in learnt]) > 0.8  # a range that leaps is not valid for a moment
    assert position_error(late[-1]) < 4.0
