"""A size that becomes known better: what the filters' states become by it."""

import numpy as np
import pytest

from onboard.estimators.leader.size import Size, with_size
from onboard.messages import Estimate
from onboard.models.relative_motion import SIZE, R
from tests.support.streams import SIZE as TRUE_SIZE
from tests.support.streams import Stream, feed, make_config

LARGER = Size(TRUE_SIZE * 1.2, 0.02)


def test_a_marginal_is_replaced_and_the_rest_follows_as_for_a_given_size() -> None:
    rng = np.random.default_rng(3)
    root = rng.normal(size=(2, 12, 12))
    P, mean = root @ np.swapaxes(root, 1, 2), rng.normal(size=(2, 12))
    moved, covariance = with_size(mean, P, Size(2.5, 0.1))
    assert moved[:, SIZE] == pytest.approx(2.5)
    assert covariance[:, SIZE, SIZE] == pytest.approx(0.01)
    slope, after = P[:, 0, SIZE] / P[:, SIZE, SIZE], covariance[:, 0, SIZE] / covariance[:, SIZE, SIZE]
    assert after == pytest.approx(slope)
    assert moved[:, 0] - slope * moved[:, SIZE] == pytest.approx(mean[:, 0] - slope * mean[:, SIZE])
    given = P[:, 0, 0] - slope**2 * P[:, SIZE, SIZE]
    assert covariance[:, 0, 0] - after**2 * covariance[:, SIZE, SIZE] == pytest.approx(given)


def resize(filter_: str, size: Size) -> tuple[Estimate, Estimate]:
    """The estimates before and after, of a track of a size that is known to 25 %."""
    settings = "estimator.leader.size_prior_sigma_m=0.5", f"estimator.leader.filter={filter_}"
    run = feed(Stream(t1=5.4).datagrams(), make_config(*settings))
    track = run.pipeline.estimators["leader"]._tracks["leader"]  # type: ignore[attr-defined]
    track.learn(size, run.pipeline.ownship)
    return run.estimates[-1], track.tick(run.pipeline.ownship)


def along(estimate: Estimate) -> tuple[float, float]:
    """The range and its variance."""
    r, P = np.array(estimate.mean)[R], np.array(estimate.covariance)[R, R]
    return float(np.linalg.norm(r)), float(r @ P @ r / (r @ r))


def test_a_larger_leader_is_as_much_farther_away() -> None:
    before, after = resize("any-side", LARGER)
    assert along(after)[0] / along(before)[0] == pytest.approx(1.2, abs=0.03)
    assert along(after)[1] < 0.5 * along(before)[1]
    assert after.mean is not None
    assert after.mean[SIZE] == pytest.approx(LARGER.value)


def test_a_larger_leader_is_farther_away_as_the_covariance_says() -> None:
    before, after = resize("wing-line", LARGER)
    P = np.array(before.covariance)
    expected = np.array(before.mean)[R] + P[R, SIZE] / P[SIZE, SIZE] * (LARGER.value - TRUE_SIZE)
    assert np.array(after.mean)[R] == pytest.approx(expected, abs=0.02)
    assert along(after)[0] > along(before)[0]
    assert np.array(after.covariance)[SIZE, SIZE] == pytest.approx(LARGER.sigma**2, rel=1e-3)


def test_a_track_that_starts_anew_starts_with_the_size_that_is_known() -> None:
    run = feed(Stream(t1=6.0).datagrams(), make_config("estimator.leader.filter=wing-line"))
    track = run.pipeline.estimators["leader"]._tracks["leader"]  # type: ignore[attr-defined]
    track.reset("the test says so")
    track.learn(LARGER, run.pipeline.ownship)
    for item in Stream(t0=6.0, t1=6.6).items():
        run.pipeline.advance([item.message])
    assert track.tick(run.pipeline.ownship).mean[SIZE] == pytest.approx(LARGER.value)
