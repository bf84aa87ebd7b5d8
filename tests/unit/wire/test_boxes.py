"""Boxes in the images of real lenses: how large they are, and whether the edge may cut them off."""

import math
from collections.abc import Callable

import pytest

from onboard.geometry.lens import Lens
from onboard.messages import Box, DetectedPose, Detection
from onboard.wire.documents import agreement, boxes
from onboard.wire.documents.document import BadDocumentError

PINHOLE = Lens(fx_px=500.0, fy_px=500.0, cx_px=320.0, cy_px=240.0, width_px=640.0, height_px=480.0)
COEFFICIENTS = (0.03, -0.008, 0.002, -0.0003)
FISHEYE = Lens(
    fx_px=400.0,
    fy_px=400.0,
    cx_px=640.0,
    cy_px=640.0,
    width_px=1280.0,
    height_px=1280.0,
    model="fisheye",
    distortion=COEFFICIENTS,
)
BARREL = Lens(
    fx_px=600.0,
    fy_px=600.0,
    cx_px=640.0,
    cy_px=480.0,
    width_px=1280.0,
    height_px=960.0,
    distortion=(-0.3, 0.1, 0.0, 0.0),
)


def fisheye(angle: float) -> float:
    t2 = angle * angle
    return 400.0 * angle * (1.0 + t2 * (0.03 + t2 * (-0.008 + t2 * (0.002 - 0.0003 * t2))))


def barrel(angle: float) -> float:
    r = math.tan(angle)
    return 600.0 * r * (1.0 + r * r * (-0.3 + 0.1 * r * r))


@pytest.mark.parametrize("side", ["right", "below"])
@pytest.mark.parametrize(
    ("lens", "radius", "degrees"),
    [(FISHEYE, fisheye, 20), (FISHEYE, fisheye, 50), (FISHEYE, fisheye, 80), (BARREL, barrel, 40)],
)
def test_a_ball_is_as_wide_as_high_wherever_a_lens_shows_it(
    lens: Lens, radius: Callable[[float], float], degrees: int, side: str
) -> None:
    """A ball of 2 degrees, by the lens's equation along the radius, and by a circle about the axis across it."""
    angle, half = math.radians(degrees), math.radians(1.0)
    near, far, middle = radius(angle - half), radius(angle + half), radius(angle)
    across = 2.0 * middle * math.tan(half) / math.sin(angle)
    place, sizes = (0.5 * (near + far), 0.0), (far - near, across)
    if side == "below":
        place, sizes = place[::-1], sizes[::-1]
    u, v = lens.cx_px + place[0], lens.cy_px + place[1]
    found = boxes.sides(Box(u_px=u, v_px=v, width_px=sizes[0], height_px=sizes[1]), lens)
    assert found is not None
    left, upper, right, lower = found
    assert apart(left, right) == pytest.approx(2.0, rel=0.005)
    assert apart(upper, lower) == pytest.approx(2.0, rel=0.005)


def apart(a: tuple[float, float], b: tuple[float, float]) -> float:
    """Degrees between two image points."""
    dot = 1.0 + a[0] * b[0] + a[1] * b[1]
    return math.degrees(math.acos(dot / math.hypot(1.0, *a) / math.hypot(1.0, *b)))


def test_a_box_that_reaches_beyond_what_the_lens_describes_has_no_sides() -> None:
    edge = 640.0 + fisheye(math.radians(89.0))
    assert boxes.sides(Box(u_px=edge, v_px=640.0, width_px=40.0, height_px=40.0), FISHEYE) is None
    assert boxes.sides(Box(u_px=edge - 60.0, v_px=640.0, width_px=40.0, height_px=40.0), FISHEYE) is not None


@pytest.mark.parametrize(
    ("left", "upper", "width", "height", "is_cut"),
    [
        (300.0, 200.0, 60.0, 30.0, False),
        (0.0, 200.0, 60.0, 30.0, True),
        (6.0, 200.0, 60.0, 30.0, True),  # two sigmas inside
        (10.0, 200.0, 60.0, 30.0, False),
        (640.0 - 66.0, 200.0, 60.0, 30.0, True),
        (640.0 - 70.0, 200.0, 60.0, 30.0, False),
        (300.0, 6.0, 30.0, 60.0, True),
        (300.0, 10.0, 30.0, 60.0, False),
        (300.0, 480.0 - 66.0, 30.0, 60.0, True),
        (300.0, 480.0 - 70.0, 30.0, 60.0, False),
        (2.5, 200.0, 6.0, 6.0, True),  # three times the noise of a pixel
        (3.5, 200.0, 6.0, 6.0, False),
        (-20.0, 200.0, 60.0, 30.0, True),
    ],
)
def test_a_box_that_ends_within_its_noise_of_an_edge_may_be_cut_off(
    left: float, upper: float, width: float, height: float, is_cut: bool
) -> None:
    box = Box(u_px=left + width / 2, v_px=upper + height / 2, width_px=width, height_px=height)
    assert boxes.may_be_cut(box, PINHOLE, 1.0) is is_cut


def test_the_edge_of_a_distorted_image_is_that_of_its_pixels() -> None:
    """Its corners see farther than the middles of its edges, where a box is cut off all the same."""
    at_edge = Box(u_px=1280.0 - 30.0, v_px=480.0, width_px=58.0, height_px=20.0)
    assert boxes.may_be_cut(at_edge, BARREL, 1.0)


def test_where_the_size_of_the_image_is_not_known_nothing_is_cut_off() -> None:
    anywhere = Lens(fx_px=500.0, fy_px=500.0, cx_px=0.0, cy_px=0.0)
    assert not boxes.may_be_cut(Box(u_px=0.0, v_px=0.0, width_px=9.0, height_px=9.0), anywhere, 1.0)


@pytest.mark.parametrize("degrees", [10, 60, 80])
def test_a_right_range_and_position_agree_with_a_box_far_off_the_axis(degrees: int) -> None:
    """An aircraft 0.6 m wide at 15 m; its position is half a degree off the middle of its box."""
    angle, half = math.radians(degrees), 0.3 / 15.0
    near, far = fisheye(angle - half), fisheye(angle + half)
    box = Box(u_px=640.0 + 0.5 * (near + far), v_px=640.0, width_px=far - near, height_px=10.0)
    off = angle + math.radians(0.5)
    pose = DetectedPose(position_m=(15.0 * math.sin(off), 0.0, 15.0 * math.cos(off)))
    places = {"box": FISHEYE.locate([(box.u_px, box.v_px)])[0]}
    agreement.check(Detection(box=box, pose=pose, range_m=15.0), places, FISHEYE, (0.6, 0.6), 1.0, "d")
    with pytest.raises(BadDocumentError, match=r"44 m the box would be 1\.[5-8]"):
        agreement.check(Detection(box=box, range_m=44.0), places, FISHEYE, (0.6, 0.6), 1.0, "d")


def test_a_side_with_a_noise_of_its_own_ends_as_far_inside() -> None:
    box = Box(u_px=60.0, v_px=240.0, width_px=60.0, height_px=30.0)
    assert not boxes.may_be_cut(box, PINHOLE, 1.0)
    assert boxes.may_be_cut(Box(u_px=60.0, v_px=240.0, width_px=60.0, height_px=30.0, sigma_px=12.0), PINHOLE, 1.0)
