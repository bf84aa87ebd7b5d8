"""What becomes of a state where the filter cannot take an image."""

from types import SimpleNamespace
from typing import Any

import pytest

from onboard.estimators.leader.image.detector import NoiseScale
from onboard.estimators.leader.tracks import fusing
from onboard.filters.belief import FilterError


class Refusing:
    """A filter that refuses every image."""

    gate = None
    shape = None

    def seen(self, measurement: Any, _pose: Any) -> Any:
        return measurement

    def fuse(self, *_: Any) -> Any:
        raise FilterError("not positive definite")


def test_an_image_that_shows_the_whole_ends_the_track_and_a_direction_alone_costs_only_itself(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(fusing, "newest_pose", lambda *_: SimpleNamespace(noise_c=None))
    monkeypatch.setattr(fusing, "_refused", lambda *_: "an update")
    monkeypatch.setattr(fusing, "measured", lambda taken, *_: taken.measurement)
    filter_: Any = Refusing()
    none: Any = None

    def image(*, has_extent: bool) -> Any:
        return SimpleNamespace(
            has_extent=has_extent, measurement=SimpleNamespace(with_attitude_noise=lambda noise: noise)
        )

    before = fusing.TrackState("a state", NoiseScale())
    state, outcome = fusing.fuse(filter_, none, before, image(has_extent=False), none)
    assert state == before
    assert (outcome.fused, outcome.update) == (False, "an update")
    with pytest.raises(FilterError, match="not positive definite"):
        fusing.fuse(filter_, none, before, image(has_extent=True), none)
