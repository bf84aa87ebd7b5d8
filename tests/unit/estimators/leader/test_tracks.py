"""Parts of a track by themselves: images that a filter cannot take, known sizes, sights, and stated attitudes."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from onboard.estimators.leader.assumptions import Size
from onboard.estimators.leader.image.camera_pose import CameraPose
from onboard.estimators.leader.image.detector import NoiseScale
from onboard.estimators.leader.tracks import fusing
from onboard.estimators.leader.tracks.report import with_attitude
from onboard.filters.belief import Belief, FilterError
from onboard.messages import Cause, Reason
from onboard.models.relative_motion import SIZE
from tests.support.images import exposed
from tests.support.streams import SIZE as TRUE_SIZE
from tests.support.streams import Stream, feed, make_config


class Refusing:
    """A filter that refuses every image."""

    def fuse(self, *_: Any) -> Any:
        raise FilterError("not positive definite")


def test_an_image_that_shows_the_whole_ends_the_track_and_a_direction_alone_costs_only_itself() -> None:
    filter_: Any = Refusing()
    none: Any = None

    def image(*, has_extent: bool) -> Any:
        return SimpleNamespace(
            has_extent=has_extent, measurement=SimpleNamespace(rows=SimpleNamespace(y=np.zeros(4)))
        )

    compared: Any = SimpleNamespace()
    before = fusing.TrackState("a state", NoiseScale())
    state, outcome = fusing.fuse(filter_, none, before, image(has_extent=False), none, compared)
    assert state == before
    assert not fusing.passes(outcome)
    with pytest.raises(FilterError, match="not positive definite"):
        fusing.fuse(filter_, none, before, image(has_extent=True), none, compared)


LARGER = Size(TRUE_SIZE * 1.2, 0.02)


def test_a_track_that_starts_anew_starts_with_the_size_that_is_known() -> None:
    run = feed(Stream(t1=6.0).datagrams(), make_config())
    track = run.pipeline.estimators["leader"]._tracks["leader"]  # type: ignore[attr-defined]
    track.reset(Reason(Cause.REBOOTED, "the test says so"))
    track.size = LARGER
    for item in Stream(t0=6.0, t1=6.6).items():
        run.pipeline.advance(exposed([item.message]))
    assert track.tick(run.pipeline.ownship).mean[SIZE] == pytest.approx(LARGER.value)


NORTH = CameraPose(np.eye(3), np.array([0.3, 0.0, 0.0]), np.zeros(3), np.zeros(3))  # looks north, from our nose


def place(degrees: float, range_: float = 28.0) -> np.ndarray:
    angle = math.radians(degrees)
    return NORTH.r_FC_n + range_ * np.array([math.cos(angle), math.sin(angle), 0.0])


@pytest.mark.parametrize(
    ("degrees", "is_shown"),
    [(0.0, True), (29.0, True), (-29.0, True), (31.0, False), (90.0, False), (180.0, False)],
)
def test_a_place_is_believed_within_30_degrees_of_the_line_of_sight(degrees: float, is_shown: bool) -> None:
    measurement: Any = SimpleNamespace(axes=np.eye(3))
    assert fusing.is_in_sight(place(degrees), measurement, NORTH) is is_shown


KNOWN = np.radians([0.3, 0.3, 1.0])


def test_a_yaw_that_the_autopilot_states_widens_the_estimate_across_the_line_of_sight() -> None:
    """30 m to the north-east: 10 degrees are 5.2 m across, none along; 1 degree is known of already."""
    mean = np.array([30.0 / math.sqrt(2.0), 30.0 / math.sqrt(2.0), -3.0, 1.0, 0.0, 0.0, 2.0])
    belief = Belief(mean, np.eye(7))
    found = with_attitude(belief, (0.0, 0.0, math.radians(10.0)), KNOWN).covariance
    across, along = np.array([-1.0, 1.0, 0.0]) / math.sqrt(2.0), np.array([1.0, 1.0, 0.0]) / math.sqrt(2.0)
    assert math.sqrt(across @ found[:3, :3] @ across - 1.0) == pytest.approx(5.21, abs=0.01)
    assert along @ found[:3, :3] @ along == pytest.approx(1.0)
    assert found[4, 4] > 1.02
    assert_allclose(found[6], np.eye(7)[6])
    assert with_attitude(belief, (0.0, 0.0, math.radians(0.5)), KNOWN) is belief
    tilted = with_attitude(belief, (0.05, 0.05, 0.0), KNOWN).covariance
    assert math.sqrt(tilted[2, 2] - 1.0) == pytest.approx(30.0 * 0.05, rel=0.01)
