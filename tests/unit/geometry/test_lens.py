"""Lenses against OpenCV: pixels by `projectPoints` and `fisheye.projectPoints` of opencv-python-headless 5.0.0."""

import math

import pytest

from onboard.geometry.lens import Lens, LensError, Located

POINTS = [(0.05, -0.02), (-0.3, 0.2), (0.45, 0.33), (-0.55, -0.4), (0.0, 0.0)]
FAR = [(-2.2, -1.1), (0.05, -0.02), (-0.3, 0.2), (0.9, 0.66)]
GOLDEN = {
    "four": ((-0.28, 0.07, 0.0012, -0.0009), [
        (344.888943, 232.737654), (168.086935, 343.37332), (534.059552, 400.698896), (65.283334, 59.663625),
        (318.9, 243.1)]),
    "five": ((-0.2812, 0.0711, 0.0012, -0.0009, 0.011), [
        (344.888853, 232.73769), (168.104611, 343.361573), (534.074805, 400.710047), (65.063403, 59.504168),
        (318.9, 243.1)]),
    "eight": ((0.31, -0.12, 0.0007, -0.0004, 0.02, 0.61, -0.02, 0.035), [
        (344.890012, 232.736777), (168.592618, 343.025996), (532.600557, 399.49227), (68.769987, 61.98439),
        (318.9, 243.1)]),
}  # fmt: skip
FISHEYE = (-0.012, 0.031, -0.0105, 0.0021)
FISHEYE_PIXELS = [
    (-245.267176, -38.116139),
    (344.889, 232.736368),
    (169.242142, 342.565092),
    (672.762981, 501.80152),
]


def lens(distortion: tuple[float, ...] = (), **changes: object) -> Lens:
    k: dict[str, object] = {"fx_px": 520.3, "fy_px": 518.7, "cx_px": 318.9, "cy_px": 243.1}
    return Lens(**(k | {"width_px": 640.0, "height_px": 480.0} | changes), distortion=distortion)


@pytest.mark.parametrize("name", GOLDEN)
def test_radial_and_tangential_distortion_is_opencv_s(name: str) -> None:
    coefficients, pixels = GOLDEN[name]
    one = lens(coefficients)
    for point, pixel in zip(POINTS, pixels, strict=True):
        assert one.pixel(*point) == pytest.approx(pixel, abs=1e-5)
        assert one.image_point(*pixel) == pytest.approx(point, abs=1e-7)


def test_fisheye_distortion_is_opencv_s() -> None:
    one = lens(FISHEYE, model="fisheye")
    for point, pixel in zip(FAR, FISHEYE_PIXELS, strict=True):
        assert one.pixel(*point) == pytest.approx(pixel, abs=1e-5)
        assert one.image_point(*pixel) == pytest.approx(point, abs=1e-6)
    assert one.image_point(318.9, 243.1) == (0.0, 0.0)


def scale(of: Lens, u_px: float, v_px: float) -> float:
    """Focal lengths per pixel, where it is located beside others."""
    _, found, outside = of.locate([(300.0, 200.0), (u_px, v_px), (5e9, 0.0)])
    assert of.is_pinhole or isinstance(outside, LensError)
    assert isinstance(found, Located)
    assert found.point == of.image_point(u_px, v_px)
    return found.scale


def test_noise_is_scaled_as_the_image_is_stretched() -> None:
    assert scale(lens(), 100.0, 100.0) == pytest.approx(1.0 / math.sqrt(520.3 * 518.7))
    barrel = lens(GOLDEN["five"][0])
    assert scale(barrel, 318.9, 243.1) == pytest.approx(1.0 / barrel.f_px, rel=1e-3)
    assert scale(barrel, 65.0, 59.5) * barrel.f_px == pytest.approx(1.275, abs=0.005)  # by hand


def test_the_view_of_a_barrel_reaches_to_its_corners() -> None:
    left, upper, right, lower = lens(GOLDEN["five"][0]).view or (0.0,) * 4
    assert left < -318.9 / 520.3
    assert upper < -243.1 / 518.7
    assert right > (640 - 318.9) / 520.3
    assert lower > (480 - 243.1) / 518.7
    assert lens(cx_px=-5.0, width_px=0.0).view is None


@pytest.mark.parametrize("count", [1, 2, 3, 6, 7, 9, 12, 14])
def test_other_numbers_of_coefficients_are_refused(count: int) -> None:
    with pytest.raises(LensError, match=f"4, 5, 8 coefficients, not {count}"):
        lens((0.1,) * count)
    with pytest.raises(LensError, match="fisheye has 4"):
        lens((0.1,) * 5, model="fisheye")


def test_where_the_distortion_folds_the_image_a_pixel_is_refused() -> None:
    with pytest.raises(LensError, match=r"pixel \(5000, 243.1\)"):
        lens((-0.28, 0.0, 0.0, 0.0)).image_point(5000.0, 243.1)
    with pytest.raises(LensError, match="outside"):
        lens(FISHEYE, model="fisheye").image_point(5000.0, 243.1)
    assert lens((-0.9, 0.0, 0.0, 0.0)).view == (-100.0, -100.0, 100.0, 100.0)


@pytest.mark.parametrize("degrees", [5, 30, 50, 80])
def test_a_fisheye_without_coefficients_is_in_proportion_to_the_angle(degrees: int) -> None:
    """OpenCV's D = 0, as Kalibr and simulators write it; nearly as coefficients that are nearly zero."""
    ideal, angle = lens((0.0,) * 4, model="fisheye"), math.radians(degrees)
    u, v = 318.9 + 520.3 * angle, 243.1
    assert ideal.pixel(math.tan(angle), 0.0) == pytest.approx((u, v))
    assert ideal.image_point(u, v) == pytest.approx((math.tan(angle), 0.0), abs=1e-6)
    almost = lens((0.0, 0.0, 0.0, 1e-12), model="fisheye")
    assert scale(ideal, u, v) == pytest.approx(scale(almost, u, v))
    assert ideal.view == pytest.approx(almost.view)


def test_the_image_of_a_fisheye_beyond_90_degrees_ends_only_where_image_points_do() -> None:
    whole = lens((0.0,) * 4, model="fisheye", width_px=1800.0, height_px=480.0, cx_px=900.0)
    left, upper, right, _ = whole.view or (0.0,) * 4
    assert (left, right) == (-100.0, 100.0)
    assert upper == -100.0  # its corners are beyond, too
    narrow = lens((0.0,) * 4, model="fisheye")
    assert narrow.view is not None
    assert narrow.view[0] == pytest.approx(-math.tan(math.hypot(318.9 / 520.3, 243.1 / 518.7)), rel=0.3)


def angle(of: Lens, u_px: float) -> float:
    [place] = of.locate([(u_px, 243.1)])
    assert isinstance(place, Located)
    return place.angle


def test_an_angle_per_pixel_is_that_of_the_sphere() -> None:
    """By hand: a pinhole at 45 degrees shows 1 / sqrt(2) along the radius and half across ... of 1 / f."""
    assert angle(lens(fy_px=520.3), 318.9 + 520.3) == pytest.approx(2.0**-0.75 / 520.3)
    ideal = lens((0.0,) * 4, model="fisheye", fy_px=520.3)
    theta = math.radians(60.0)
    across = math.sin(theta) / theta
    assert angle(ideal, 318.9 + 520.3 * theta) == pytest.approx(math.sqrt(across) / 520.3, rel=5e-3)
