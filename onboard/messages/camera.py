"""Image points of a target, measured by a camera."""

from onboard.messages.base import Clock, ImagePoint, Message, Record, Vec3


class TargetPoints(Message, frozen=True, kw_only=True):
    """Three points of one aircraft in one image.

    Each point is (Y_c/X_c, Z_c/X_c): the image plane of a pinhole camera with unit focal length, lens distortion
    removed, positive right and positive down. `sigma`: standard deviation of each coordinate of the center, left
    and right point, in the same unit; None: the configured pixel noise. `target` is empty if the vision process
    does not identify aircraft. `view`: left, upper, right and lower edge of the image in that unit; None: as
    configured.
    """

    camera: str
    target: str = "leader"
    center: ImagePoint
    left: ImagePoint
    right: ImagePoint
    sigma: Vec3 | None = None
    view: tuple[float, float, float, float] | None = None


class Pixel(Record, frozen=True, kw_only=True):
    """A labelled image point in pixels: u right, v down. `sigma_px`: standard deviation of each coordinate, if
    known."""

    u_px: float
    v_px: float
    sigma_px: float | None = None


class Intrinsics(Record, frozen=True, kw_only=True):
    """Pinhole intrinsics in pixels of the image that contains the points, lens distortion removed. Without its
    width and height, the principal point (cx, cy) is taken as its middle."""

    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    width_px: float | None = None
    height_px: float | None = None


class CameraPoints(Record, frozen=True, kw_only=True):
    """Output of a vision process, one per image. `t_ns` is the time of exposure on `clock`."""

    t_ns: int
    clock: Clock
    camera: str
    intrinsics: Intrinsics
    center: Pixel
    left: Pixel
    right: Pixel
    target: str = "leader"
