"""One cause with changing numbers is one refusal; another field or name is another."""

import pytest

from onboard.health.refusals import Refusals
from onboard.messages import Cause, Reason

FIRST = "pixel (9000, -0.25) is outside - at `$.detections[0].points.left`"


@pytest.mark.parametrize(
    ("reason", "kinds"),
    [
        ("pixel (12.5, 1e+06) is outside - at `$.detections[11].points.left`", 1),
        ("pixel (9000, -0.25) is outside - at `$.detections[0].points.right`", 2),
        ("no camera is called `cam2`", 2),
    ],
)
def test_reasons_that_differ_only_in_numbers_are_one(reason: str, kinds: int) -> None:
    refusals = Refusals()
    for n, text in enumerate((FIRST, reason)):
        refusals.add("onboard/1/camera/front/detections", Reason(Cause.DOCUMENT, text), n)
    assert len(refusals.latest) == kinds
    assert refusals.latest[0].reason == FIRST
    assert sum(refusal.count for refusal in refusals.latest) == 2


def test_names_with_numbers_are_not_one() -> None:
    refusals = Refusals()
    for name in ("cam1", "cam2", "cam-3"):
        refusals.add("c", Reason(Cause.UNKNOWN_CAMERA, f"no camera is called `{name}`"), 0)
    assert len(refusals.latest) == 3


def test_the_hash_of_a_ros_type_is_left_out() -> None:
    """64 digits of a key took the place of the reason."""
    refusals = Refusals()
    key = "0/perception/boxes/vision_msgs::msg::dds_::Detection2DArray_"
    refusals.add(f"{key}/RIHS01_{'0af3' * 16}", Reason(Cause.DOCUMENT, "it is not CDR"), 1)
    assert [refusal.source for refusal in refusals.latest] == [key]
