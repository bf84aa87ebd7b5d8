"""Detections of a target in an image, and the attitude of a moving mount.

Detections are in pixels, as detectors send them, and as image points.
"""

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
    """The attitude of the head of a moving mount, to which the camera is fixed by `mount_rpy_deg`.

    Attributes
    ----------
    q
        Rotation from the head's axes (forward, right, down) to those of `frame`; Hamilton, scalar first.
    frame
        NED (`earth`), NED turned to our own heading (`heading`), or our body (`body`).
    """

    q: Quaternion
    frame: MountFrame


class GimbalAttitude(Message, frozen=True, kw_only=True):
    """GIMBAL_DEVICE_ATTITUDE_STATUS.

    Attributes
    ----------
    device
        The gimbal_device_id, or the sending component if there is none.
    is_replaced
        Whether it comes from a MOUNT_ORIENTATION, which is used only while no device sends anything newer.
    """

    device: int
    mount: MountAttitude
    is_replaced: bool = False


class FieldOfView(Message, frozen=True, kw_only=True):
    """CAMERA_FOV_STATUS: the horizontal field of view of a camera that zooms, rad."""

    hfov: float


class RelativePose(Record, frozen=True, kw_only=True):
    """The pose of an aircraft relative to the camera; either part may be unknown.

    Attributes
    ----------
    r_CL_c
        Position of its center from the camera in c, m.
    r_covariance
        Covariance (3, 3) of the position, m^2.
    q_cL
        Rotation from its body's axes to c.
    turn_covariance
        Covariance (3, 3) of a small rotation about the axes of c, rad^2.
    """

    r_CL_c: Vec3 | None = None
    r_covariance: Covariance3 | None = None
    q_cL: Quaternion | None = None
    turn_covariance: Covariance3 | None = None


class TargetImage(Message, frozen=True, kw_only=True):
    """Base of all detections of one aircraft in one image: see `TargetPoints` and `TargetDetection`.

    Image points are (Y_c/X_c, Z_c/X_c): the image plane of a pinhole camera with unit focal length, lens
    distortion removed, positive right and positive down.

    Attributes
    ----------
    target
        Name of the aircraft; empty if the vision process does not identify aircraft.
    class_name
        The detector's class; empty without one.
    view
        Left, upper, right and lower edge of the image, in focal lengths; None: as configured.
    mount
        Attitude of a moving mount at exposure; None: the camera is fixed as configured.
    range, range_sigma
        Distance of the aircraft by another sensor, m, and its standard deviation.
    pose
        Pose of the aircraft relative to the camera, if the detector estimates it.
    doubt
        Reason to doubt the camera's intrinsics; None if there is none.
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
        """Points that were detected, the center first if it was one of them."""
        raise NotImplementedError


class ImageFeature(Record, frozen=True, kw_only=True):
    """A named image point.

    Attributes
    ----------
    sigma
        Standard deviation of each coordinate, in focal lengths.
    """

    name: str
    point: ImagePoint
    sigma: float


class TargetPoints(TargetImage, frozen=True, kw_only=True):
    """All three points of one aircraft.

    Attributes
    ----------
    sigma
        Standard deviation of each coordinate of the center, left and right point, in focal lengths; None: the
        configured pixel noise.
    others
        Further points of the class.
    """

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
    """A detection without all three points: some points, a box, or both.

    Attributes
    ----------
    features
        Detected points: some of `center`, `left`, `right` and the further points of the class, and `box`, the
        middle of a box.
    half_width
        Half the larger side of the box about its middle, in focal lengths; None without a box.
    sides
        Middles of the box's left, upper, right and lower side; None if the edge of the image may cut the box off,
        so that it shows only a direction.
    """

    features: tuple[ImageFeature, ...]
    half_width: float | None = None
    sides: Sides | None = None

    @property
    def image_points(self) -> tuple[ImagePoint, ...]:
        """Points that were detected."""
        return tuple(feature.point for feature in self.features)


class Exposure(Message, frozen=True, kw_only=True):
    """All detections in one image of a camera, at least one, each with the image's stamps."""

    camera: str
    detections: tuple[TargetImage, ...]

    @classmethod
    def of(cls, first: TargetImage, *others: TargetImage) -> "Exposure":
        """Return the exposure with these detections.

        Raises ValueError if they are of several images.
        """
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
        """Return the same exposure, true at a time on the boot clock."""
        stamped = {"t_ns": t_ns, "clock": Clock.BOOT}
        detections = tuple(replace(detection, **stamped) for detection in self.detections)
        return replace(self, detections=detections, **stamped)


class Pixel(Record, frozen=True, kw_only=True):
    """An image point in pixels: u right, v down.

    Attributes
    ----------
    sigma_px
        Standard deviation of each coordinate, if known.
    """

    u_px: float
    v_px: float
    sigma_px: float | None = None


class Intrinsics(Record, frozen=True, kw_only=True):
    """Pinhole intrinsics in pixels of the image that contains the points, lens distortion removed.

    Attributes
    ----------
    fx_px, fy_px
        Focal lengths.
    cx_px, cy_px
        Principal point.
    width_px, height_px
        Size of the image; None: the principal point is assumed to be its middle.
    """

    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    width_px: float | None = None
    height_px: float | None = None


class CameraPoints(Record, frozen=True, kw_only=True):
    """Output of a vision process that finds all three points, one record per image.

    Attributes
    ----------
    t_ns
        Time of exposure on `clock`.
    """

    t_ns: int
    clock: Clock
    camera: str
    intrinsics: Intrinsics
    center: Pixel
    left: Pixel
    right: Pixel
    target: str = "leader"


class DetectedPoint(Record, frozen=True, kw_only=True, forbid_unknown_fields=False):
    """A named point in pixels: u right, v down.

    Attributes
    ----------
    sigma_px
        Standard deviation of each coordinate, if known.
    """

    u_px: float
    v_px: float
    sigma_px: float | None = None


class Box(Record, frozen=True, kw_only=True, forbid_unknown_fields=False):
    """A box around an aircraft in pixels.

    Attributes
    ----------
    u_px, v_px
        Middle of the box: u right, v down.
    sigma_px
        Standard deviation of each side, if known.
    """

    u_px: float
    v_px: float
    width_px: float
    height_px: float
    sigma_px: float | None = None


class DetectedPose(Record, frozen=True, kw_only=True, forbid_unknown_fields=False):
    """The pose of an aircraft as OpenCV's solvePnP, ArUco and AprilTag give it.

    The camera's axes are its optical axes: right, down and forward. Position or rotation may be missing. Without a
    covariance the position is as accurate as a point and 5 % of the range, and the rotation is known to 10
    degrees.

    Attributes
    ----------
    position_m
        Center of the aircraft in the camera's axes.
    q
        Rotation from the aircraft's axes (forward, right, down) to the camera's; Hamilton, scalar first.
    covariance
        Covariance (6, 6) of x, y and z in m^2, then of small rotations about the camera's x, y and z in rad^2, the
        order of ROS. The part of a missing quantity is ignored.
    """

    position_m: Vec3 | None = None
    q: Quaternion | None = None
    covariance: tuple[Six, Six, Six, Six, Six, Six] | None = None


class Detection(Record, frozen=True, kw_only=True, forbid_unknown_fields=False):
    """One aircraft in an image, given by named points, a box, a pose, or several of these.

    Attributes
    ----------
    points
        Any of `center`, `left`, `right` and the further points of its class.
    target
        Name of the aircraft: "leader", or any other id; empty: the detection goes to the track that it fits best.
    class
        Class by the detector; see `classes` of `[camera]` and `[target.CLASS]`.
    id
        The detector's own track number, which is not used yet.
    confidence
        From 0 to 1. A detection below the camera's `min_confidence` is refused. Lower confidence means more noise
        for points without a `sigma_px`.
    range_m
        Distance at exposure by a rangefinder or a radio; see `[estimator.leader.range]`.
    range_sigma_m
        Standard deviation of `range_m`.
    """

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
    """Output of a detector, one record per image, with whatever it has found of each aircraft.

    Unknown fields are ignored, and each is reported once.

    Attributes
    ----------
    t_ns
        Time of exposure on `clock`.
    camera
        Name of the camera; empty: the first configured one.
    intrinsics
        Intrinsics of this image; None: as configured.
    attitude
        Attitude of a moving mount at exposure.
    """

    t_ns: int
    clock: Clock
    camera: str = ""
    intrinsics: Intrinsics | None = None
    attitude: MountAttitude | None = None
    detections: tuple[Detection, ...] = ()
