"""A camera hangs if image after image shows the same, though our rotation would have moved it."""

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from onboard.estimators.leader.image.detector import Repeats
from onboard.estimators.leader.image.prepare import Image
from onboard.geometry.rotations import matrix_from_euler
from onboard.messages import ImageFeature, TargetDetection, Verdict
from onboard.units import NS_PER_S

SIGMA = 0.005  # of a box, focal lengths
ROLL, YAW = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])  # about the line of sight, and across it


def judged(at_s: list[float], degrees: float, axis: np.ndarray, *, moves: float = 0.0) -> list[Verdict | None]:
    """Of boxes near the image's middle at these times, to which the camera has turned by so many degrees a second,
    and which move by `moves` each."""
    repeats, found = Repeats(0.5, 0.002), []
    for k, t in enumerate(at_s):
        box = ImageFeature(name="box", point=(0.01 + moves * k, 0.0), sigma=SIGMA)
        t_ns = round(t * NS_PER_S)
        message = TargetDetection(t_ns=t_ns, t_recv_ns=t_ns, camera="front", features=(box,), half_width=0.05)
        pose = SimpleNamespace(R_cn=matrix_from_euler(*(np.radians(degrees) * t * axis)).T)
        found.append(repeats.judge(cast("Image", SimpleNamespace(message=message, pose=pose))))
    return found


@pytest.mark.parametrize("degrees", [4.0, -4.0])
def test_a_camera_that_shows_the_same_while_we_turn_hangs(degrees: float) -> None:
    assert judged([0.0, 0.2, 0.4, 0.6], degrees, YAW) == [None, None, None, Verdict.STALE]


def test_two_images_that_are_alike_are_chance() -> None:
    """After a gap a box was within a third of its deviation of the last one, and the leader's track was ended."""
    assert judged([0.0, 0.6], 4.0, YAW) == [None, None]
    assert judged([0.0, 0.6, 0.7], 4.0, YAW) == [None, None, Verdict.STALE]


@pytest.mark.parametrize(
    ("degrees", "axis", "moves"), [(20.0, ROLL, 0.0), (1.0, YAW, 0.0), (4.0, YAW, 0.6 * SIGMA)]
)
def test_a_camera_does_not_hang_where_nothing_would_have_moved_or_it_did(
    degrees: float, axis: np.ndarray, moves: float
) -> None:
    """A rotation about the line of sight; one by two deviations; and points that follow it."""
    assert set(judged([0.0, 0.2, 0.4, 0.6], degrees, axis, moves=moves)) == {None}
