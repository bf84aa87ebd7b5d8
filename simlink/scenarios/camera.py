"""The camera of a scenario."""

from typing import Annotated, Final, Literal, get_args

import msgspec

from onboard.geometry.lens import Lens, Model
from onboard.messages import NotNegative, Positive, Record, Vec3
from simlink.scenarios.profiles import Interval, Probability

# The detector's output: "wing" has the wing tips named by their side in the image; "points" are named points, nose
# and tail among them; "box" is a box around these, also with the center; "rotor_box" surrounds four rotors; "pose"
# is a pose, also with the wing.
Sees = Literal["wing", "points", "box", "center_box", "rotor_box", "pose", "wing_pose"]
SEES: Final[tuple[Sees, ...]] = get_args(Sees)
BOXES: Final = ("box", "rotor_box")  # detectors that find a box and no points


class Mistaken(Interval, frozen=True, kw_only=True):
    """An interval in which the detector takes every aircraft for this class."""

    class_name: str


class Gimbal(Record, frozen=True, kw_only=True):
    """A moving mount that is level and turns with our heading.

    `mount_rpy_deg` of the camera then starts at the gimbal's head. The head sweeps sinusoidally in yaw and pitch
    and reports its direction with a constant random error.
    """

    sweep_deg: tuple[NotNegative, NotNegative] = (12.0, 5.0)  # amplitudes in yaw and pitch
    period: tuple[Positive, Positive] = (6.0, 3.7)  # s
    phase_deg: tuple[float, float] = (0.0, 0.0)  # of each sweep at the start
    rate: Annotated[float, msgspec.Meta(gt=0, le=200)] = 20.0  # Hz, of its reports
    latency: NotNegative = 0.0  # s, from its stamp to delivery
    error_deg: NotNegative = 0.3  # standard deviation about each axis, constant in a run
    yaw_error_deg: NotNegative | None = None  # about the vertical axis, if it differs
    component: Annotated[int, msgspec.Meta(ge=1, le=255)] = 154


class Camera(Record, frozen=True, kw_only=True):
    """The camera and the vision process behind it.

    `mount_rpy_deg` is ZYX from body to camera; [0, 15, 0] looks up. `mount_offset` is r_FC_b (m), `rate` in Hz.
    Where the lens distorts, points are pixels of the distorted image and come without intrinsics, so the receiver
    needs the calibration.
    """

    name: str = "front"
    rate: Annotated[float, msgspec.Meta(gt=0, le=200)] = 25.0
    f_px: Positive = 554.256
    width_px: Positive = 640.0
    height_px: Positive = 480.0
    distortion_model: Model = "radial-tangential"
    distortion: tuple[float, ...] = ()  # OpenCV's coefficients, in its order; none: a pinhole
    mount_rpy_deg: Vec3 = (0.0, 0.0, 0.0)
    mount_offset: Vec3 = (0.0, 0.0, 0.0)
    sees: Sees = "wing"
    sigma_px: NotNegative = 1.0
    noise_time: NotNegative = 0.0  # s, over which the noise of points and boxes is correlated; 0: white
    states_sigma: bool = True  # whether each point is reported with its `sigma_px`
    has_ids: bool = True  # whether each detection names its aircraft
    class_name: str = ""  # the class of each detection; empty: it has none
    mistaken: tuple[Mistaken, ...] = ()  # intervals with a wrong class
    # The share of a box that must be inside the image for a detection; the edge cuts off the rest. A cut box ends
    # `edge_gap_px` inside the edge.
    least_inside: Annotated[float, msgspec.Meta(gt=0, le=1)] = 1.0
    edge_gap_px: NotNegative = 0.0
    smallest_px: NotNegative = 0.0  # smallest wingspan, as seen broadside, that is detected
    p_lose: Probability = 0.02  # registered -> not, per image
    p_regain: Probability = 0.38  # not registered -> registered, per image
    latency: NotNegative = 0.02  # s, from exposure to delivery
    stamp_late: NotNegative = 0.0  # s, stamp minus exposure: a stamp taken on the way
    wrong_blob: Probability = 0.0  # per registered image
    blob_span_px: tuple[Positive, Positive] = (10.0, 150.0)
    blackouts: tuple[Interval, ...] = ()
    gimbal: Gimbal | None = None
    pictures: Literal["none", "aircraft", "tag"] = "none"  # drawn and published instead of points


def cuts(camera: Camera) -> bool:
    """Whether the image's edge cuts a box instead of hiding it."""
    return camera.least_inside < 1.0 and camera.sees in BOXES


def is_plain(camera: Camera) -> bool:
    """Whether an image holds only the three wing points of one aircraft, as angles."""
    says_more = camera.distortion or camera.class_name or camera.mistaken or not camera.has_ids
    return camera.sees == "wing" and not says_more


def lens_of(camera: Camera) -> Lens:
    """Return a camera's lens, with pixels in focal lengths about the image centre.

    Raises LensError for an invalid distortion.
    """
    model, distortion = camera.distortion_model, camera.distortion
    return Lens(fx_px=1.0, fy_px=1.0, cx_px=0.0, cy_px=0.0, model=model, distortion=distortion)
