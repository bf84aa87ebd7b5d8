"""Where the leader was last seen: a place mirrored through us has the right range, and is not believed."""

import math

import numpy as np
import pytest

from onboard.estimators.leader.beside import reference
from onboard.estimators.leader.beside.reference import SIZE, Errors, Shown
from onboard.estimators.leader.camera_pose import CameraPose
from onboard.estimators.leader.sight import LastSight, sight
from onboard.filters.belief import Belief
from tests.support.streams import S

NORTH = CameraPose(np.eye(3), np.array([0.3, 0.0, 0.0]), np.zeros(3), np.zeros(3))  # looks north, from our nose
ERRORS = Errors(np.full(3, 2.0), 0.1, 60.0, 0.1, range_bias=0.3, yaw=0.025)
AHEAD = Shown(np.array([28.0, 0.0, 0.0]), np.diag([1.0, 0.1, 0.1]) ** 2, 2.0)


def place(degrees: float, range_: float = 28.0) -> np.ndarray:
    angle = math.radians(degrees)
    return NORTH.r_FC_n + range_ * np.array([math.cos(angle), math.sin(angle), 0.0])


@pytest.mark.parametrize(
    ("degrees", "is_shown"),
    [(0.0, True), (29.0, True), (-29.0, True), (31.0, False), (90.0, False), (180.0, False)],
)
def test_a_place_is_believed_within_30_degrees_of_the_last_sight(degrees: float, is_shown: bool) -> None:
    last = LastSight()
    assert not last.contradicts(place(degrees))
    last.see(S, np.eye(3), NORTH)
    assert last.contradicts(place(degrees)) is not is_shown
    assert sight(np.eye(3), NORTH).shows(place(degrees)) is is_shown


def test_an_older_image_is_not_the_last_sight() -> None:
    last = LastSight()
    last.see(2 * S, np.eye(3), NORTH)
    last.see(S, -np.eye(3), NORTH)
    assert not last.contradicts(place(0.0))


def believed(t: float) -> Belief:
    """A leader that was seen 28 m ahead, t seconds later without any image."""
    belief = reference.start(ERRORS, AHEAD, 2.0, 0.2, np.zeros(3), 1.0)
    for _ in range(round(t / 0.2)):
        belief = reference.predict(ERRORS, belief, 0.2, np.zeros(3))
    return belief


@pytest.mark.parametrize(("t", "is_known"), [(0.2, True), (1.0, True), (3.0, False), (9.0, False)])
def test_without_images_the_direction_is_soon_not_known(t: float, is_known: bool) -> None:
    assert reference.knows_direction(believed(t)) is is_known


def test_a_place_mirrored_through_us_does_not_fit_what_the_camera_shows() -> None:
    belief = believed(0.4)
    mean = belief.mean.copy()
    mean[reference.R] *= -1.0
    assert reference.misfit(belief, AHEAD, 1.0) < 16.3
    assert reference.misfit(Belief(mean, belief.covariance), AHEAD, 1.0) > 100.0
    assert belief.mean[SIZE] == 2.0
