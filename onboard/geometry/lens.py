"""Lens of a camera: conversion of pixels to image points, and back.

An image point is (Y_c/X_c, Z_c/X_c): the image plane of a pinhole camera with unit focal length (`camera`). A real
lens moves it: `distortion` holds OpenCV's coefficients, in OpenCV's order, as `calibrateCamera`, Kalibr and ROS
write them. The equations are those of OpenCV's documentation of its module calib3d.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, Literal, NamedTuple

Edges = tuple[float, float, float, float]  # left, upper, right, lower, in focal lengths
Model = Literal["radial-tangential", "fisheye"]
COEFFICIENT_COUNTS: Final = {"radial-tangential": (0, 4, 5, 8), "fisheye": (4,)}  # of distortion
MAX_NEWTON_ITERATIONS: Final = 50
NEWTON_TOLERANCE: Final = 1e-10  # focal lengths
BINNING_FACTORS: Final = (2, 4, 8)  # usual numbers of pixels that a camera combines, per axis
BINNING_TOLERANCE_RATIO: Final = 0.1  # Error of a principal point, relative to the middle of the binned image.
MAX_CENTER_OFFSET_RATIO: Final = 0.15  # Of a side; a larger offset of the principal point means a cropped image.
MAX_IMAGE_RADIUS: Final = 100.0  # focal lengths (89.4 degrees from the axis)
STEP_SIZE: Final = 1e-6  # focal lengths, for numerical derivatives


class LensError(ValueError):
    """The lens or the pixel is impossible; the message says why."""


class Located(NamedTuple):
    """The image point of a pixel, and the scale there, in focal lengths per pixel.

    The scale multiplies the pixel's noise.
    """

    point: tuple[float, float]
    scale: float

    @property
    def angle(self) -> float:
        """Radians per pixel, the geometric mean of the two directions."""
        return self.scale / float(math.hypot(1.0, *self.point) ** 1.5)


@dataclass(frozen=True, kw_only=True)
class Lens:
    """Intrinsics and distortion of a camera.

    Raises LensError for a number of coefficients that OpenCV does not have, and for values that no lens has.

    Attributes
    ----------
    fx_px, fy_px
        Focal lengths.
    cx_px, cy_px
        Principal point.
    width_px, height_px
        Size of the image; 0: unknown.
    note
        Doubts about these numbers, in words.
    binning
        Factor by which the numbers were multiplied because the image is not binned.
    """

    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    width_px: float = 0.0
    height_px: float = 0.0
    model: Model = "radial-tangential"
    distortion: tuple[float, ...] = ()
    note: str = ""
    binning: int = 1

    def __post_init__(self) -> None:
        if len(self.distortion) not in COEFFICIENT_COUNTS[self.model]:
            counts = ", ".join(str(n) for n in COEFFICIENT_COUNTS[self.model] if n)
            raise LensError(f"{self.model} has {counts} coefficients, not {len(self.distortion)}")
        if not (self.fx_px > 0.0 and self.fy_px > 0.0):
            raise LensError(f"focal lengths must be positive, not {self.fx_px:g} and {self.fy_px:g} px")
        numbers = (self.fx_px, self.fy_px, self.cx_px, self.cy_px, self.width_px, self.height_px, *self.distortion)
        if not all(map(math.isfinite, numbers)):
            raise LensError("focal lengths, principal point, size and distortion must be finite numbers")

    def of_whole_image(self) -> "Lens":
        """Return this lens, corrected for an uncropped image.

        The principal point of an uncropped image is near its middle. If it is in the middle of an image half as
        large, or a fourth or an eighth, the focal lengths are those of binned pixels, and are scaled. This is
        noted, and so is a principal point far from the middle.
        """
        if not (self.width_px and self.height_px):
            return self
        x, y = 2.0 * self.cx_px / self.width_px, 2.0 * self.cy_px / self.height_px
        point = f"the principal point ({self.cx_px:g}, {self.cy_px:g})"
        size = f"the image of {self.width_px:g} x {self.height_px:g} pixels"
        for n in BINNING_FACTORS:
            if max(abs(n * x - 1.0), abs(n * y - 1.0)) < BINNING_TOLERANCE_RATIO:
                note = (
                    f"{point} is the middle of 1/{n} of {size}, as of binned pixels: it is used {n} times as large"
                )
                k = {name: n * getattr(self, name) for name in ("fx_px", "fy_px", "cx_px", "cy_px")}
                return replace(self, **k, note=f"{note}, and so are the focal lengths", binning=n)
        if max(abs(x - 1.0), abs(y - 1.0)) > 2.0 * MAX_CENTER_OFFSET_RATIO:
            return replace(
                self, note=f"{point} is far from the middle of {size}: is it of another size, or a part?"
            )
        return self

    @cached_property
    def is_pinhole(self) -> bool:
        """Whether pixels are proportional to image points.

        A fisheye without coefficients is no pinhole: its pixels are proportional to the angle off the axis.
        """
        return self.model != "fisheye" and not any(self.distortion)

    @property
    def size_px(self) -> tuple[float, float] | None:
        """Width and height of the image.

        If they are unknown, the principal point is assumed to be the middle. None if it is outside the image.
        """
        width, height = self.width_px or 2 * self.cx_px, self.height_px or 2 * self.cy_px
        return (width, height) if min(width, height) > 0 else None

    @property
    def undistorted(self) -> "Lens":
        """A pinhole lens with square pixels that shows as much of the world as this lens."""
        left, upper, right, lower = self.view or (0.0,) * 4
        f = self.f_px
        width, height = f * (right - left), f * (lower - upper)
        return Lens(fx_px=f, fy_px=f, cx_px=-f * left, cy_px=-f * upper, width_px=width, height_px=height)

    @cached_property
    def f_px(self) -> float:
        """Geometric mean of the focal lengths: pixels per unit of an image point."""
        return math.sqrt(self.fx_px) * math.sqrt(self.fy_px)

    def image_point(self, u_px: float, v_px: float) -> tuple[float, float]:
        """Return the undistorted image point of a pixel, right and down positive.

        Raises LensError for a pixel where the distortion cannot be inverted.
        """
        x, y = (u_px - self.cx_px) / self.fx_px, (v_px - self.cy_px) / self.fy_px
        if self.is_pinhole:
            return x, y
        found = _unfish(x, y, self.distortion) if self.model == "fisheye" else _undistorted(x, y, self.distortion)
        if found is None:
            raise LensError(f"pixel ({u_px:g}, {v_px:g}) is outside of what the lens's distortion describes")
        return found

    def pixel(self, x: float, y: float) -> tuple[float, float]:
        """Return the pixel of an image point, with the lens's distortion."""
        if not self.is_pinhole:
            x, y = (_fish if self.model == "fisheye" else _distorted)(x, y, self.distortion)
        return self.fx_px * x + self.cx_px, self.fy_px * y + self.cy_px

    def locate(self, pixels: Iterable[tuple[float, float]]) -> "list[Located | LensError]":
        """Return the image point of each pixel and the scale there, or an error.

        The scale varies over a distorted image. The error is of a pixel whose distortion cannot be inverted.
        """
        if self.is_pinhole:
            scale = 1.0 / self.f_px
            return [Located(self.image_point(u, v), scale) for u, v in pixels]
        return [self._located(u, v) for u, v in pixels]

    def _located(self, u_px: float, v_px: float) -> "Located | LensError":
        """Return the image point of a pixel and the scale there, or the error."""
        try:
            (a, b), (c, d), (e, f) = (
                self.image_point(u, v) for u, v in ((u_px, v_px), (u_px + 1.0, v_px), (u_px, v_px + 1.0))
            )
        except LensError as error:
            return error
        return Located((a, b), math.sqrt(abs((c - a) * (f - b) - (d - b) * (e - a))))

    @cached_property
    def view(self) -> Edges | None:
        """The edges of the image; those of a distorted image are at its outermost corners.

        An edge with pixels that cannot be undistorted is `MAX_IMAGE_RADIUS` away. None if the size is unknown.
        """
        if self.size_px is None:
            return None
        width, height = self.size_px

        def edge(axis: int, end: float) -> float:
            shares = [(end, along) if axis == 0 else (along, end) for along in (0.0, 0.5, 1.0)]
            try:
                found = [self.image_point(u * width, v * height)[axis] for u, v in shares]
            except LensError:
                return MAX_IMAGE_RADIUS if end else -MAX_IMAGE_RADIUS
            return min(max(found), MAX_IMAGE_RADIUS) if end else max(min(found), -MAX_IMAGE_RADIUS)

        return edge(0, 0.0), edge(1, 0.0), edge(0, 1.0), edge(1, 1.0)


def _distorted(x: float, y: float, k: Sequence[float]) -> tuple[float, float]:
    """Apply radial and tangential distortion: k1, k2, p1, p2, then k3, then k4, k5, k6."""
    k1, k2, p1, p2, k3, k4, k5, k6 = (*k, *(0.0,) * (8 - len(k)))
    r2 = x * x + y * y
    radial = (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    return (
        x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
        y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
    )


def _undistorted(u: float, v: float, k: Sequence[float]) -> tuple[float, float] | None:
    """Return the point whose distortion is (u, v), by Newton's method from (u, v).

    Returns None if there is no such point, or if the image folds over.
    """
    x, y = u, v
    for _ in range(MAX_NEWTON_ITERATIONS):
        a, b = _distorted(x, y, k)
        ax, bx = _distorted(x + STEP_SIZE, y, k)
        ay, by = _distorted(x, y + STEP_SIZE, k)
        xx, yx, xy, yy = (ax - a) / STEP_SIZE, (bx - b) / STEP_SIZE, (ay - a) / STEP_SIZE, (by - b) / STEP_SIZE
        determinant = xx * yy - xy * yx
        if not (determinant > 0.0 and xx + yy > 0.0):
            return None
        du, dv = u - a, v - b
        if math.hypot(du, dv) < NEWTON_TOLERANCE:
            return x, y
        x, y = x + (yy * du - xy * dv) / determinant, y + (xx * dv - yx * du) / determinant
    return None


def _fish(x: float, y: float, k: Sequence[float]) -> tuple[float, float]:
    """Apply OpenCV's fisheye model, in which the image grows with the angle off the axis."""
    r = math.hypot(x, y)
    ratio = _fish_angle(math.atan(r), k) / r if r > 0.0 else 1.0
    return x * ratio, y * ratio


def _fish_angle(theta: float, k: Sequence[float]) -> float:
    t2 = theta * theta
    return theta * (1.0 + t2 * (k[0] + t2 * (k[1] + t2 * (k[2] + t2 * k[3]))))


def _unfish(u: float, v: float, k: Sequence[float]) -> tuple[float, float] | None:
    """Invert `_fish`. Returns None at and beyond a right angle, where there is no image point."""
    r = math.hypot(u, v)
    low, high = 0.0, math.pi / 2 - 1e-3
    if r == 0.0:
        return u, v
    if not _fish_angle(high, k) > r:
        return None
    for _ in range(MAX_NEWTON_ITERATIONS):  # bisection: the model need not be monotonic beyond what was calibrated
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _fish_angle(middle, k) < r else (low, middle)
    ratio = math.tan(0.5 * (low + high)) / r
    return u * ratio, v * ratio
