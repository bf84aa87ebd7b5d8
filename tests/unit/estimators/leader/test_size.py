"""A size that becomes known better: what a track becomes by it."""

import numpy as np
import pytest

from onboard.estimators.leader.size import Size
from onboard.messages import Estimate
from onboard.models.relative_motion import SIZE, R
from tests.support.streams import SIZE as TRUE_SIZE
from tests.support.streams import Stream, feed, make_config

LARGER = Size(TRUE_SIZE * 1.2, 0.02)


def resize(size: Size) -> tuple[Estimate, Estimate]:
    """The estimates before and after, of a track of a size that is known to 25 %."""
    run = feed(Stream(t1=10.0).datagrams(), make_config("estimator.leader.size_prior_sigma_m=0.5"))
    track = run.pipeline.estimators["leader"]._tracks["leader"]  # type: ignore[attr-defined]
    track.learn(size, run.pipeline.ownship)
    return run.estimates[-1], track.tick(run.pipeline.ownship)


def along(estimate: Estimate) -> tuple[float, float]:
    """The range and its variance."""
    r, P = np.array(estimate.mean)[R], np.array(estimate.covariance)[R, R]
    return float(np.linalg.norm(r)), float(r @ P @ r / (r @ r))


def test_a_larger_leader_is_as_much_farther_away() -> None:
    before, after = resize(LARGER)
    assert along(after)[0] / along(before)[0] == pytest.approx(1.2, abs=0.03)
    assert along(after)[1] < 0.7 * along(before)[1]
    assert after.mean is not None
    assert after.mean[SIZE] == pytest.approx(LARGER.value)


def test_a_track_that_starts_anew_starts_with_the_size_that_is_known() -> None:
    run = feed(Stream(t1=6.0).datagrams(), make_config())
    track = run.pipeline.estimators["leader"]._tracks["leader"]  # type: ignore[attr-defined]
    track.reset("the test says so")
    track.learn(LARGER, run.pipeline.ownship)
    for item in Stream(t0=6.0, t1=6.6).items():
        run.pipeline.advance([item.message])
    assert track.tick(run.pipeline.ownship).mean[SIZE] == pytest.approx(LARGER.value)
