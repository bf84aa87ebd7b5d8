"""The lens of a camera: pixels to image points, and back.

An image point is (Y_c/X_c, Z_c/X_c): the image plane of a pinhole camera with unit focal length (`camera`). A real
lens moves it: `distortion` holds OpenCV's coefficients, in OpenCV's order, as `calibrateCamera`, Kalibr and ROS
write them. The equations are those of OpenCV's documentation of its module calib3d.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final, Literal

Edges = tuple[float, float, float, float]  # left, upper, right, lower, in focal lengths
Model = Literal["radial-tangential", "fisheye"]
COUNTS: Final = {"radial-tangential": (0, 4, 5, 8), "fisheye": (4,)}  # of coefficients
ITERATIONS: Final = 50
EXACT: Final = 1e-10  # focal lengths
STEP: Final = 1e-6  # focal lengths, of a numerical derivative


class LensError(ValueError):
    """A lens or a pixel that no calibration describes; the message says which."""


@dataclass(frozen=True, kw_only=True)
class Lens:
    """Focal lengths and principal point in pixels, the size of the image (0: not known), and the distortion.

    Raises LensError for a number of coefficients that OpenCV does not have, and for numbers that no lens has.
    """

    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    width_px: float = 0.0
    height_px: float = 0.0
    model: Model = "radial-tangential"
    distortion: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if len(self.distortion) not in COUNTS[self.model]:
            counts = ", ".join(str(n) for n in COUNTS[self.model] if n)
            raise LensError(f"{self.model} has {counts} coefficients, not {len(self.distortion)}")
        if not (self.fx_px > 0.0 and self.fy_px > 0.0):
            raise LensError(f"focal lengths must be positive, not {self.fx_px:g} and {self.fy_px:g} px")
        numbers = (self.fx_px, self.fy_px, self.cx_px, self.cy_px, self.width_px, self.height_px, *self.distortion)
        if not all(map(math.isfinite, numbers)):
            raise LensError("focal lengths, principal point, size and distortion must be finite numbers")

    @property
    def f_px(self) -> float:
        """The geometric mean of the focal lengths: pixels per unit of an image point."""
        return math.sqrt(self.fx_px) * math.sqrt(self.fy_px)

    def image_point(self, u_px: float, v_px: float) -> tuple[float, float]:
        """The image point of a pixel, right and down positive, without the lens's distortion. Raises LensError for
        a pixel where the distortion cannot be inverted."""
        x, y = (u_px - self.cx_px) / self.fx_px, (v_px - self.cy_px) / self.fy_px
        if not any(self.distortion):
            return x, y
        found = _unfish(x, y, self.distortion) if self.model == "fisheye" else _undistorted(x, y, self.distortion)
        if found is None:
            raise LensError(f"pixel ({u_px:g}, {v_px:g}) is outside of what the lens's distortion describes")
        return found

    def pixel(self, x: float, y: float) -> tuple[float, float]:
        """The pixel of an image point, with the lens's distortion."""
        if any(self.distortion):
            x, y = (_fish if self.model == "fisheye" else _distorted)(x, y, self.distortion)
        return self.fx_px * x + self.cx_px, self.fy_px * y + self.cy_px

    def scale(self, u_px: float, v_px: float) -> float:
        """Focal lengths per pixel about a pixel, by which its noise is scaled: a distorted image is not equally
        large everywhere. Raises LensError."""
        if not any(self.distortion):
            return 1.0 / self.f_px
        (a, b), (c, d), (e, f) = (
            self.image_point(u, v) for u, v in ((u_px, v_px), (u_px + 1.0, v_px), (u_px, v_px + 1.0))
        )
        return math.sqrt(abs((c - a) * (f - b) - (d - b) * (e - a)))

    @cached_property
    def view(self) -> Edges | None:
        """The edges of the image, of a distorted one those of its farthest corners. Without its size the principal
        point is taken as its middle; None where that is outside the image, or the edge cannot be undistorted."""
        width, height = self.width_px or 2 * self.cx_px, self.height_px or 2 * self.cy_px
        if min(width, height) <= 0:
            return None
        try:
            around = [self.image_point(u * width, v * height) for u in (0.0, 0.5, 1.0) for v in (0.0, 0.5, 1.0)]
        except LensError:
            return None
        x, y = zip(*around, strict=True)
        return min(x), min(y), max(x), max(y)


def _distorted(x: float, y: float, k: Sequence[float]) -> tuple[float, float]:
    """Radial and tangential distortion: k1, k2, p1, p2, then k3, then k4, k5, k6."""
    k1, k2, p1, p2, k3, k4, k5, k6 = (*k, *(0.0,) * (8 - len(k)))
    r2 = x * x + y * y
    radial = (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    return (
        x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
        y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
    )


def _undistorted(u: float, v: float, k: Sequence[float]) -> tuple[float, float] | None:
    """The point whose distortion is (u, v), by Newton's method from (u, v); None where there is none, or the image
    is folded."""
    x, y = u, v
    for _ in range(ITERATIONS):
        a, b = _distorted(x, y, k)
        ax, bx = _distorted(x + STEP, y, k)
        ay, by = _distorted(x, y + STEP, k)
        xx, yx, xy, yy = (ax - a) / STEP, (bx - b) / STEP, (ay - a) / STEP, (by - b) / STEP
        determinant = xx * yy - xy * yx
        if not (determinant > 0.0 and xx + yy > 0.0):
            return None
        du, dv = u - a, v - b
        if math.hypot(du, dv) < EXACT:
            return x, y
        x, y = x + (yy * du - xy * dv) / determinant, y + (xx * dv - yx * du) / determinant
    return None


def _fish(x: float, y: float, k: Sequence[float]) -> tuple[float, float]:
    """OpenCV's fisheye model: the image grows with the angle off the axis."""
    r = math.hypot(x, y)
    ratio = _fish_angle(math.atan(r), k) / r if r > 0.0 else 1.0
    return x * ratio, y * ratio


def _fish_angle(theta: float, k: Sequence[float]) -> float:
    t2 = theta * theta
    return theta * (1.0 + t2 * (k[0] + t2 * (k[1] + t2 * (k[2] + t2 * k[3]))))


def _unfish(u: float, v: float, k: Sequence[float]) -> tuple[float, float] | None:
    """The point of (u, v); None at and beyond a right angle, where there is no image point."""
    r = math.hypot(u, v)
    low, high = 0.0, math.pi / 2 - 1e-3
    if r == 0.0:
        return u, v
    if not _fish_angle(high, k) > r:
        return None
    for _ in range(ITERATIONS):  # bisection: the model need not be monotonic beyond what was calibrated
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _fish_angle(middle, k) < r else (low, middle)
    ratio = math.tan(0.5 * (low + high)) / r
    return u * ratio, v * ratio
