"""Pinhole camera: its pose on the vehicle, and its projection.

Camera frame as in Oh & Johnson: X forward along the optical axis, Y right, Z down. An image point is
(Y_c/X_c, Z_c/X_c). Multiplied by the focal length and added to the principal point it is in pixels.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from onboard.arrays import Array
from onboard.geometry.lens import Edges
from onboard.geometry.rotations import matrix_from_euler

Axis = Literal["roll", "pitch", "yaw"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Camera:
    """A camera on a vehicle.

    Attributes
    ----------
    R_bc
        Rotation (3, 3), camera to body; on a moving mount, camera to the mount's head.
    r_FC_b
        Position (3,) on the vehicle, m.
    sigma_px
        Standard deviation of one image coordinate.
    gimbal
        Id of the moving mount that carries the camera.
    gimbal_frame
        Reference of the mount's angles; "" if the mount reports it.
    gimbal_reversed
        Axes about which the mount's angles have the opposite sign.
    """

    name: str
    f_px: float
    width_px: float
    height_px: float
    R_bc: Array
    r_FC_b: Array
    sigma_px: float = 1.0
    gimbal: int | None = None
    gimbal_frame: Literal["", "body", "earth", "heading"] = ""
    gimbal_reversed: tuple[Axis, ...] = ()
    others: "tuple[Camera, ...]" = ()  # further cameras on the same vehicle
    view: Edges | None = None  # the edges of its image, if its lens is known

    def named(self, name: str) -> "Camera":
        """Return the camera of that name, or this one if no other has it."""
        return next((other for other in self.others if other.name == name), self)

    @property
    def edges(self) -> Edges:
        """Left, upper, right and lower edge of the image, in focal lengths."""
        half_width, half_height = 0.5 * self.width_px / self.f_px, 0.5 * self.height_px / self.f_px
        return self.view or (-half_width, -half_height, half_width, half_height)

    @property
    def sigma(self) -> float:
        """Standard deviation of one image coordinate, in units of the focal length."""
        return self.sigma_px / self.f_px


def make_camera(
    *,
    name: str = "front",
    f_px: float,
    width_px: float,
    height_px: float,
    mount_rpy_deg: ArrayLike = (0.0, 0.0, 0.0),
    mount_offset: ArrayLike = (0.0, 0.0, 0.0),
    sigma_px: float = 1.0,
    gimbal: int | None = None,
) -> Camera:
    """Create a camera from its mount.

    `mount_rpy_deg` are ZYX angles, body to camera, in degrees ([0, 15, 0] looks 15 degrees UP). `mount_offset` is
    in metres, body FRD.
    """
    roll, pitch, yaw = np.radians(np.asarray(mount_rpy_deg, dtype=float))
    return Camera(
        name=name,
        f_px=f_px,
        width_px=width_px,
        height_px=height_px,
        R_bc=matrix_from_euler(roll, pitch, yaw),
        r_FC_b=np.asarray(mount_offset, dtype=float),
        sigma_px=sigma_px,
        gimbal=gimbal,
    )


def project(r_c: ArrayLike) -> Array:
    """Return image points (..., 2) of positions (..., 3) in the camera frame.

    NaN behind the lens.
    """
    r = np.asarray(r_c, dtype=float)
    x = r[..., 0:1]
    return np.asarray(np.where(x > 1e-9, r[..., 1:3] / np.where(x > 1e-9, x, 1.0), np.nan))


def pixels_from_points(points: ArrayLike, camera: Camera) -> Array:
    """Return pixels (u right, v down, from the image's upper left corner) of image points (..., 2)."""
    centre = np.array([camera.width_px / 2, camera.height_px / 2])
    return np.asarray(np.asarray(points, dtype=float) * camera.f_px + centre)


def in_view(points: ArrayLike, camera: Camera) -> bool:
    """Return whether all image points (..., 2) are inside the image."""
    p, edges = np.asarray(points, dtype=float), np.array(camera.edges)
    return bool(np.all((edges[:2] <= p) & (p <= edges[2:])))
