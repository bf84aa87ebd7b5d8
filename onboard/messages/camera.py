"""What a camera sees of a target."""

from onboard.messages.base import Clock, ImagePoint, Message, Record, Vec3


class TargetPoints(Message, frozen=True, kw_only=True):
    """Three points of one aircraft in one image.

    Each point is (Y_c/X_c, Z_c/X_c): position in the image plane of a pinhole camera with unit focal length,
    lens distortion removed, positive right and positive down. `sigma` holds, for the center, left and right
    point, the standard deviation of each coordinate in the same unit; None: the configured pixel noise.
    `target` is empty where the vision process does not tell one aircraft from another. `half_view` is how far the
    image reaches right and down from its axis; None: as configured.
    """

    camera: str
    target: str = "leader"
    center: ImagePoint
    left: ImagePoint
    right: ImagePoint
    sigma: Vec3 | None = None
    half_view: ImagePoint | None = None


class Pixel(Record, frozen=True, kw_only=True):
    """A labelled point in an image: u right, v down, pixels; `sigma_px` of each coordinate if known."""

    u_px: float
    v_px: float
    sigma_px: float | None = None


class Intrinsics(Record, frozen=True, kw_only=True):
    """Pinhole intrinsics in pixels, of the image the pixels are given in (already undistorted)."""

    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float


class CameraPoints(Record, frozen=True, kw_only=True):
    """What a vision process publishes, one per image, as JSON: `t_ns` is the time of exposure on `clock`."""

    t_ns: int
    clock: Clock
    camera: str
    intrinsics: Intrinsics
    center: Pixel
    left: Pixel
    right: Pixel
    target: str = "leader"
