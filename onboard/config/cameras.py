"""`[camera]` and `[cameras.NAME]`: mounts, lenses, delays, and their models."""

import dataclasses
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, ClassVar, Final, Literal, NamedTuple

import msgspec
from msgspec.structs import replace

from onboard.config.calibration import read_calibration
from onboard.geometry.camera import Camera, make_camera
from onboard.geometry.lens import Lens, LensError
from onboard.messages import NotNegative, Positive, Record, Vec3
from onboard.messages.target import WING_POINTS
from onboard.wire.documents.cameras import CameraInput, RosTopics
from onboard.wire.ros.camera_info import part_of
from onboard.wire.ros.received import RosKind

# Default errors of a gimbal's reported attitude. Its level comes from accelerometers, as an autopilot's does,
# plus some tenths of a degree from encoders and skew. Its yaw comes from gyros alone, which drift by 10 to 50
# degrees an hour: a degree within minutes.
GIMBAL_SIGMA_DEG: Final = 0.5
GIMBAL_YAW_SIGMA_DEG: Final = 1.0
ComponentId = Annotated[int, msgspec.Meta(ge=1, le=255)]
WIDTH_PX: Final = 640.0
HEIGHT_PX: Final = 480.0
Crop = tuple[NotNegative, NotNegative, Positive, Positive]
GimbalId = Annotated[int, msgspec.Meta(ge=1, le=255)]
TOPIC: Final = re.compile(r"(\w+(/\w+)*)?", re.ASCII)


class CameraConfig(Record, frozen=True, kw_only=True):
    """`[camera]`: mount and lens. Points in pixels bring their own intrinsics.

    Raises ValueError for a distortion or a calibration that cannot be used.
    """

    name: str = "front"
    f_px: Positive = 554.256
    fy_px: Positive | None = None  # vertical focal length; None: as f_px
    cx_px: float | None = None  # principal point; None: the image's middle
    cy_px: float | None = None
    width_px: Positive | None = None  # None: 640, or that of the calibration
    height_px: Positive | None = None  # None: 480, or that of the calibration
    distortion_model: Literal["radial-tangential", "fisheye"] = "radial-tangential"
    distortion: tuple[float, ...] = ()  # OpenCV's coefficients, in its order; none for undistorted pixels
    calibration: str | None = None  # a file, instead of the keys above; with a size: of an image resized to it
    crop_px: Crop | None = None  # left, upper, width, height: the part of the calibrated image that is used
    sigma_px: Positive = 1.0  # standard deviation of each image coordinate
    min_confidence: Annotated[float, msgspec.Meta(ge=0, le=1)] = 0.3  # of a detection that has a confidence
    classes: tuple[str, ...] = ()  # classes to follow, by the detector's names; none: all
    mount_rpy_deg: Vec3 = (0.0, 0.0, 0.0)  # body to camera, ZYX; [0, 15, 0] looks 15 degrees up
    mount_offset_m: Vec3 = (0.0, 0.0, 0.0)  # camera from the vehicle's position, body FRD
    gimbal: GimbalId | None = None  # of a moving mount: gimbal_device_id (1 to 6), or the gimbal's component
    gimbal_frame: Literal["as flagged", "body", "earth", "heading"] = (
        "as flagged"  # frame of its angles, overriding its flags
    )
    gimbal_reversed: tuple[Literal["roll", "pitch", "yaw"], ...] = ()  # angles that have the other sign
    mount_sigma_deg: NotNegative | None = (
        None  # systematic error of the mount about each axis; None: 0.5 with a gimbal
    )
    mount_yaw_sigma_deg: NotNegative | None = None  # of its yaw; None: as mount_sigma_deg, or 1 with a gimbal
    tracker: ComponentId | None = None  # MAVLink component that sends this camera's CAMERA_TRACKING_IMAGE_STATUS
    landing_target: Literal["points", "aircraft"] = "points"  # meaning of one LANDING_TARGET
    ros_topic: str = ""  # of detections, such as "detector/detections"; rmw_zenoh's keys contain the type
    ros_type: RosKind = "vision_msgs/Detection2DArray"  # of the topic, if its key does not contain it
    ros_camera_info: str = ""  # topic of sensor_msgs/CameraInfo: overrides the lens above
    ros_rectified: bool = False  # pixels of `ros_topic` are those of the rectified image, as for apriltag_ros
    delay_s: float | None = None  # how much older than its stamp an image is; None: `delay.camera_s`

    # Withdrawn as a key: mounts and gimbals warm up and drift over minutes.
    mount_time_s: ClassVar[float] = 120.0  # correlation time of these errors

    def __post_init__(self) -> None:
        lens_of(self)
        for key, topic in (("ros_topic", self.ros_topic), ("ros_camera_info", self.ros_camera_info)):
            if not TOPIC.fullmatch(topic):
                raise ValueError(f"{key}: {topic!r} is not a topic; write its name without the leading slash")


def lens_of(c: CameraConfig) -> Lens:
    """Return the lens of a camera. Raises ValueError."""
    if c.calibration is not None:
        lens = read_calibration(Path(c.calibration))
        _check_center(lens, f"calibration: {c.calibration}: the principal point")
        try:
            return part_of(lens, c.crop_px, c.width_px, c.height_px)
        except LensError as error:
            raise ValueError(f"calibration: {c.calibration}: {error}") from error
    if c.crop_px is not None:
        raise ValueError("crop_px needs `calibration`; set it or remove crop_px")
    width_px, height_px = c.width_px or WIDTH_PX, c.height_px or HEIGHT_PX
    try:
        lens = Lens(
            fx_px=c.f_px,
            fy_px=c.fy_px or c.f_px,
            cx_px=width_px / 2 if c.cx_px is None else c.cx_px,
            cy_px=height_px / 2 if c.cy_px is None else c.cy_px,
            width_px=width_px,
            height_px=height_px,
            model=c.distortion_model,
            distortion=c.distortion,
        )
    except LensError as error:
        raise ValueError(f"distortion: {error}") from error
    _check_center(lens, "cx_px, cy_px")
    return lens.of_whole_image()


def _check_center(lens: Lens, what: str) -> None:
    """Raise ValueError for a principal point outside its image."""
    if not (0.0 < lens.cx_px < lens.width_px and 0.0 < lens.cy_px < lens.height_px):
        raise ValueError(
            f"{what}: ({lens.cx_px:g}, {lens.cy_px:g}) is outside the image of {lens.width_px:g} x "
            f"{lens.height_px:g} pixels; for a part of an image use `calibration` and `crop_px`"
        )


def name_cameras(first: CameraConfig, others: Mapping[str, CameraConfig]) -> list[CameraConfig]:
    """Return all cameras, the first one first; the others are named as their sections."""
    return [first, *(replace(c, name=name) for name, c in others.items())]


def camera_model(cameras: list[CameraConfig]) -> Camera:
    """Return the first camera as a geometric model, which holds the others by name."""
    first, *others = map(_camera, cameras)
    return dataclasses.replace(first, others=tuple(others))


def _camera(c: CameraConfig) -> Camera:
    lens = lens_of(c)
    camera = make_camera(
        name=c.name,
        f_px=lens.f_px,
        width_px=lens.width_px,
        height_px=lens.height_px,
        mount_rpy_deg=c.mount_rpy_deg,
        mount_offset=c.mount_offset_m,
        sigma_px=c.sigma_px,
        gimbal=c.gimbal,
    )
    frame = "" if c.gimbal_frame == "as flagged" else c.gimbal_frame
    return dataclasses.replace(camera, gimbal_frame=frame, gimbal_reversed=c.gimbal_reversed, view=lens.view)


class MountErrors(NamedTuple):
    """Systematic errors of a mount's attitude: sigmas in degrees, correlation time in s."""

    tilt_sigma_deg: float
    yaw_sigma_deg: float
    time_s: float


def mount_errors(cameras: list[CameraConfig]) -> MountErrors:
    """Return the errors of the least certain mount, since all cameras may see one track."""
    every = [_mount_errors(c) for c in cameras]
    worst = max(every, key=lambda e: e.yaw_sigma_deg)
    return worst._replace(tilt_sigma_deg=max(e.tilt_sigma_deg for e in every))


def _mount_errors(c: CameraConfig) -> MountErrors:
    moves = c.gimbal is not None
    tilt, yaw = c.mount_sigma_deg, c.mount_yaw_sigma_deg
    if yaw is None:
        yaw = tilt if tilt is not None else GIMBAL_YAW_SIGMA_DEG if moves else 0.0
    if tilt is None:
        tilt = GIMBAL_SIGMA_DEG if moves else 0.0
    return MountErrors(tilt, yaw, c.mount_time_s)


def camera_inputs(cameras: list[CameraConfig], points: tuple[str, ...]) -> dict[str, CameraInput]:
    """Return the decoder's settings for each camera, by name.

    `points` are the names of points other than the wing's.
    """
    return {
        c.name: CameraInput(
            name=c.name,
            lens=lens_of(c),
            sigma_px=c.sigma_px,
            min_confidence=c.min_confidence,
            classes=c.classes,
            points=(*WING_POINTS, *points),
            tracker=c.tracker,
            is_landing_target=c.landing_target == "aircraft",
            mount=_camera(c),
            ros=RosTopics(c.ros_topic, c.ros_type, c.ros_camera_info, c.ros_rectified),
        )
        for c in cameras
    }
