"""Where the leader was last seen: a place mirrored through us has the right range, and is not believed."""

import math

import numpy as np
import pytest

from onboard.estimators.leader.config import Config
from onboard.estimators.leader.image.camera_pose import CameraPose
from onboard.estimators.leader.tracks.doubts import Checks, LineOfSight
from tests.unit.estimators.leader.test_exchange import image

NORTH = CameraPose(np.eye(3), np.array([0.3, 0.0, 0.0]), np.zeros(3), np.zeros(3))  # looks north, from our nose


def place(degrees: float, range_: float = 28.0) -> np.ndarray:
    angle = math.radians(degrees)
    return NORTH.r_FC_n + range_ * np.array([math.cos(angle), math.sin(angle), 0.0])


@pytest.mark.parametrize(
    ("degrees", "is_shown"),
    [(0.0, True), (29.0, True), (-29.0, True), (31.0, False), (90.0, False), (180.0, False)],
)
def test_a_place_is_believed_within_30_degrees_of_the_last_sight(degrees: float, is_shown: bool) -> None:
    sight = LineOfSight(NORTH.R_cn[0], NORTH.r_FC_n)
    assert sight.shows(place(degrees)) is is_shown


def test_an_older_image_is_not_the_last_sight() -> None:
    checks = Checks(Config())
    for t, place in ((2.0, 1.0), (1.0, 0.0)):
        checks.begin(image(t, degrees=10.0 * place))
    assert checks.sight is not None
    assert checks.sight.direction_n[1] == pytest.approx(math.sin(math.radians(10.0)))
