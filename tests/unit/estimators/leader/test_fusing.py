"""What becomes of a state where the filter cannot take an image."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from onboard.estimators.leader.image.detector import NoiseScale
from onboard.estimators.leader.tracks import fusing
from onboard.filters.belief import FilterError


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
