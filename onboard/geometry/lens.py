"""The lens of a camera: pixels to image points, and back.

An image point is (Y_c/X_c, Z_c/X_c): the image plane of a pinhole camera with unit focal length (`camera`).
"""

import math
from dataclasses import dataclass

Edges = tuple[float, float, float, float]  # left, upper, right, lower, in focal lengths


@dataclass(frozen=True, kw_only=True)
class Lens:
    """Focal lengths and principal point in pixels, and the size of the image; 0: not known."""

    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    width_px: float = 0.0
    height_px: float = 0.0

    @property
    def f_px(self) -> float:
        """The geometric mean of the focal lengths: pixels per unit of an image point."""
        return math.sqrt(self.fx_px) * math.sqrt(self.fy_px)

    def image_point(self, u_px: float, v_px: float) -> tuple[float, float]:
        """The image point of a pixel, right and down positive."""
        return (u_px - self.cx_px) / self.fx_px, (v_px - self.cy_px) / self.fy_px

    @property
    def view(self) -> Edges | None:
        """The edges of the image. Without its size the principal point is taken as its middle; None where that is
        outside the image."""
        width, height = self.width_px or 2 * self.cx_px, self.height_px or 2 * self.cy_px
        if min(width, height) <= 0:
            return None
        return (*self.image_point(0.0, 0.0), *self.image_point(width, height))
