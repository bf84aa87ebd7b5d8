"""How noisy the detector is, by the filter's own evidence."""

import re

import numpy as np
import pytest
from msgspec.structs import replace

from onboard.estimators.leader.tracks.noise import MOST, WINDOW, NoiseScale
from onboard.messages import TargetPoints
from tests.support.streams import F_PX, Item, Stream, advance


def learnt_from(noise: float, windows: int, seed: int = 1) -> NoiseScale:
    """After images that are so many times as noisy as configured."""
    rng, learnt = np.random.default_rng(seed), NoiseScale()
    for _ in range(windows * WINDOW):
        learnt = learnt.after(noise * rng.normal(size=4), learnt.scale**2 * np.eye(4))
    return learnt


@pytest.mark.parametrize("noise", [2.0, 3.7, 5.0])
def test_the_noise_is_learnt_and_reported(noise: float) -> None:
    learnt = learnt_from(noise, 6)
    assert learnt.scale == pytest.approx(noise, rel=0.2)
    assert learnt.finding == f"the detector is {learnt.scale:.1f} times as noisy as configured"
    assert not learnt.contradiction


@pytest.mark.parametrize("seed", range(1, 9))
@pytest.mark.parametrize("noise", [0.3, 1.0])
def test_noise_as_configured_or_less_changes_nothing_with_seeds_1_to_8(noise: float, seed: int) -> None:
    learnt = learnt_from(noise, 20, seed)
    assert learnt.scale == 1.0
    assert not learnt.finding


def test_outliers_and_a_short_manoeuvre_change_nothing() -> None:
    learnt = NoiseScale()
    for k in range(20 * WINDOW):
        learnt = learnt.after(np.full(2, 30.0 if k % 4 == 0 or 300 < k < 310 else 0.8), np.eye(2))
    assert learnt.scale == 1.0


def test_outliers_far_off_are_no_noise_however_many() -> None:
    learnt = NoiseScale()
    for k in range(20 * WINDOW):
        learnt = learnt.after(np.full(2, 0.8 if k % 15 == 0 else 200.0), np.eye(2))
    assert learnt.scale == 1.0


def test_what_no_noise_explains_ends_valid_until_it_fits_again() -> None:
    learnt = learnt_from(14.0, 5)
    assert learnt.scale == MOST
    assert learnt.contradiction.startswith("the images do not fit: NIS ")
    for _ in range(2 * WINDOW):
        learnt = learnt.after(np.ones(2), MOST**2 * np.eye(2))
    assert not learnt.contradiction


def test_the_scale_falls_again_and_a_new_track_keeps_it() -> None:
    learnt = learnt_from(4.0, 6)
    learnt = learnt.restarted()
    assert learnt.scale > 3.0
    rng = np.random.default_rng(2)
    for _ in range(20 * WINDOW):
        learnt = learnt.after(rng.normal(size=2), learnt.scale**2 * np.eye(2))
    assert learnt.scale < 1.3


@pytest.mark.parametrize(("noise", "seed"), [(2.0, 3), (3.7, 4)])
def test_the_reported_noise_is_that_of_a_flight_with_seed(noise: float, seed: int) -> None:
    """Through the pipeline, with images that arrive before our own motion at their exposure is known."""
    rng = np.random.default_rng(seed)

    def noisy(item: Item) -> Item:
        m = item.message
        if not isinstance(m, TargetPoints):
            return item
        points = np.array([m.center, m.left, m.right]) + noise * rng.normal(size=(3, 2)) / F_PX
        center, left, right = (tuple(p) for p in points.tolist())
        return Item(item.t_recv_ns, replace(m, center=center, left=left, right=right))

    run = advance(noisy(i).message for i in Stream(t0=5.0, t1=35.0, seed=None, latency=0).items())
    scales = [float(found[1]) for e in run.estimates if (found := re.search(r"([\d.]+) times", e.reason))]
    assert np.median(scales) == pytest.approx(noise, rel=0.1)
    assert all(e.valid for e in run.estimates[500:])
