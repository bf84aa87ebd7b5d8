"""A size that was learnt: a track that starts anew starts with it."""

import pytest

from onboard.estimators.leader.assumptions import Size
from onboard.messages import Cause, Reason
from onboard.models.relative_motion import SIZE
from tests.support.images import exposed
from tests.support.streams import SIZE as TRUE_SIZE
from tests.support.streams import Stream, feed, make_config

LARGER = Size(TRUE_SIZE * 1.2, 0.02)


def test_a_track_that_starts_anew_starts_with_the_size_that_is_known() -> None:
    run = feed(Stream(t1=6.0).datagrams(), make_config())
    track = run.pipeline.estimators["leader"]._tracks["leader"]  # type: ignore[attr-defined]
    track.reset(Reason(Cause.REBOOTED, "the test says so"))
    track.size = LARGER
    for item in Stream(t0=6.0, t1=6.6).items():
        run.pipeline.advance(exposed([item.message]))
    assert track.tick(run.pipeline.ownship).mean[SIZE] == pytest.approx(LARGER.value)
