"""What a camera sees of a target: as detectors send it, and as image points; and where a moving mount points."""

from typing import Literal, Self

import msgspec
from msgspec.structs import replace

from onboard.messages.base import Clock, ImagePoint, Message, Quaternion, Record, Vec3
from onboard.messages.causes import Reason

MountFrame = Literal["earth", "heading", "body"]
Covariance3 = tuple[Vec3, Vec3, Vec3]
Sides = tuple[ImagePoint, ImagePoint, ImagePoint, ImagePoint]
Six = tuple[float, float, float, float, float, float]


class MountAttitude(Record, frozen=True, kw_only=True, forbid_unknown_fields=False):
    """Where the head of a moving mount points: `q` (Hamilton, scalar first) from the head's axes (forward, right,
    down) to those of `frame`. That is NED (`earth`), NED turned to our own heading (`heading`), or our body
    (`body`). The camera is on the head as `mount_rpy_deg` says."""

    q: Quaternion
    frame: MountFrame


class GimbalAttitude(Message, frozen=True, kw_only=True):
    """GIMBAL_DEVICE_ATTITUDE_STATUS. `device`: gimbal_device_id, or without one the component that sends it.
    `is_replaced`: from a MOUNT_ORIENTATION, which counts where a device sends nothing newer."""

    device: int
    mount: MountAttitude
    is_replaced: bool = False


class FieldOfView(Message, frozen=True, kw_only=True):
    """CAMERA_FOV_STATUS: the horizontal field of view of a camera that zooms, rad."""

    hfov: float


class RelativePose(Record, frozen=True, kw_only=True):
    """An aircraft's pose relative to the camera, of which a detector may know either part. `r_CL_c`: its center
    from the camera, m, in c, with covariance (3, 3). `q_cL`: from its body's axes to c, with the covariance (3,
    3) of a small rotation about the axes of c, rad^2."""

    r_CL_c: Vec3 | None = None
    r_covariance: Covariance3 | None = None
    q_cL: Quaternion | None = None
    turn_covariance: Covariance3 | None = None


class TargetImage(Message, frozen=True, kw_only=True):
    """What one image shows of one aircraft: see `TargetPoints` and `TargetDetection`.

    Image points are (Y_c/X_c, Z_c/X_c): the image plane of a pinhole camera with unit focal length, lens
    distortion removed, positive right and positive down. `target` is empty if the vision process does not identify
    aircraft; `class_name` is the detector's class, empty without one. `view`: left, upper, right and lower edge of
    the image in that unit; None: as configured. `mount`: where a moving mount pointed at exposure; None: as the
    camera is configured. `range`: how far the aircraft was, m, by another sensor, and its standard deviation, if
    it has one. `pose`: where it was and how it was turned, if the detector knows. `doubt`: what is doubtful in the
    camera's intrinsics, None if nothing is.
    """

    camera: str
    target: str = "leader"
    class_name: str = ""
    view: tuple[float, float, float, float] | None = None
    mount: MountAttitude | None = None
    range: float | None = None
    range_sigma: float | None = None
    pose: RelativePose | None = None
    doubt: Reason | None = None

    @property
    def image_points(self) -> tuple[ImagePoint, ...]:
        """The points that were seen, the center first if it was."""
        raise NotImplementedError


class ImageFeature(Record, frozen=True, kw_only=True):
    """A named point and the standard deviation of each of its coordinates, in focal lengths."""

    name: str
    point: ImagePoint
    sigma: float


class TargetPoints(TargetImage, frozen=True, kw_only=True):
    """All three points of one aircraft. `sigma`: standard deviation of each coordinate of the center, left and
    right point, in focal lengths; None: the configured pixel noise. `others`: further points of the class."""

    center: ImagePoint
    left: ImagePoint
    right: ImagePoint
    sigma: Vec3 | None = None
    others: tuple[ImageFeature, ...] = ()

    @property
    def image_points(self) -> tuple[ImagePoint, ...]:
        """Center, left and right point, and the others."""
        return self.center, self.left, self.right, *(feature.point for feature in self.others)


class TargetDetection(TargetImage, frozen=True, kw_only=True):
    """Less than all three points: some of `center`, `left`, `right` and further points of the class, and `box`,
    the middle of a box. `half_width`: half the larger side of the box, in focal lengths about its middle; None:
    there is none. `sides`: the middles of its left, upper, right and lower side; None where the edge of the image
    may cut it off, so that it shows a direction alone."""

    features: tuple[ImageFeature, ...]
    half_width: float | None = None
    sides: Sides | None = None

    @property
    def image_points(self) -> tuple[ImagePoint, ...]:
        """The points that were seen."""
        return tuple(feature.point for feature in self.features)


class Exposure(Message, frozen=True, kw_only=True):
    """What one image of a camera shows: the `detections` in it, at least one, each with the image's stamps."""

    camera: str
    detections: tuple[TargetImage, ...]

    @classmethod
    def of(cls, first: TargetImage, *others: TargetImage) -> "Exposure":
        """The exposure in which these are. Raises ValueError where they are not of one image."""
        if any((other.camera, other.t_ns) != (first.camera, first.t_ns) for other in others):
            raise ValueError("detections of one exposure have one camera and one time")
        return cls(
            t_ns=first.t_ns,
            t_recv_ns=first.t_recv_ns,
            clock=first.clock,
            system=first.system,
            component=first.component,
            camera=first.camera,
            detections=(first, *others),
        )

    def at(self, t_ns: int) -> Self:
        """The same, true at a time on the boot clock."""
        stamped = {"t_ns": t_ns, "clock": Clock.BOOT}
        detections = tuple(replace(detection, **stamped) for detection in self.detections)
        return replace(self, detections=detections, **stamped)


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


class DetectedPoint(Record, frozen=True, kw_only=True, forbid_unknown_fields=False):
    """A named point in pixels: u right, v down. `sigma_px`: standard deviation of each coordinate, if known."""

    u_px: float
    v_px: float
    sigma_px: float | None = None


class Box(Record, frozen=True, kw_only=True, forbid_unknown_fields=False):
    """A box around an aircraft in pixels: its middle, u right, v down, and its size. `sigma_px`: standard
    deviation of each side, if known."""

    u_px: float
    v_px: float
    width_px: float
    height_px: float
    sigma_px: float | None = None


class DetectedPose(Record, frozen=True, kw_only=True, forbid_unknown_fields=False):
    """An aircraft's pose, as OpenCV's solvePnP, ArUco and AprilTag give it: in the camera's optical axes, right,
    down and forward. `position_m`: the aircraft's center. `q` (Hamilton, scalar first): from the aircraft's axes
    (forward, right, down) to the camera's. Either may be missing. `covariance` (6 x 6): of x, y and z in m^2, then
    of small rotations about the camera's x, y and z in rad^2, the order of ROS; the part of what is missing is not
    read. Without one the position is as exact as a point and 5 % of the range, the rotation to 10 degrees."""

    position_m: Vec3 | None = None
    q: Quaternion | None = None
    covariance: tuple[Six, Six, Six, Six, Six, Six] | None = None


class Detection(Record, frozen=True, kw_only=True, forbid_unknown_fields=False):
    """One aircraft in an image: named points (`center`, `left`, `right`, and those of its class), any of them, a
    `box`, or a `pose`, or several of these. All else is optional. `target` names the aircraft: "leader", or any
    other id; empty: it goes to the track that it fits best. `class`: what the detector takes it for; see
    `classes` of `[camera]` and `[target.CLASS]`. `id`: the detector's own track number, which is not used yet.
    `confidence`: 0 to 1; below the camera's `min_confidence` the detection is refused, and the lower it is, the
    larger is the noise of points that bring no sigma. `range_m`: how far it was at exposure by a rangefinder or
    a radio, and `range_sigma_m`, its standard deviation; see `[estimator.leader.range]`."""

    points: dict[str, DetectedPoint] = msgspec.field(default_factory=dict)
    box: Box | None = None
    pose: DetectedPose | None = None
    target: str = ""
    class_name: str = msgspec.field(default="", name="class")
    id: int | str | None = None
    confidence: float | None = None
    range_m: float | None = None
    range_sigma_m: float | None = None


class CameraDetections(Record, frozen=True, kw_only=True, forbid_unknown_fields=False):
    """Output of a detector, one per image: as much of each aircraft as it has found. `t_ns` is the time of
    exposure on `clock`. Without `camera` it is the first that is configured, and without `intrinsics` the camera's
    own hold. `attitude`: where a moving mount pointed at exposure. Fields that are not known are ignored, and each
    is named once."""

    t_ns: int
    clock: Clock
    camera: str = ""
    intrinsics: Intrinsics | None = None
    attitude: MountAttitude | None = None
    detections: tuple[Detection, ...] = ()
