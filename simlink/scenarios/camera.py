"""The camera of a scenario."""

from typing import Annotated, Final, Literal, get_args

import msgspec

from onboard.messages import NotNegative, Positive, Record, Vec3
from simlink.scenarios.profiles import Interval, Probability

# What its detector finds of the leader: the wing, whose tips it names by their sides in the image; points with
# names, nose and tail among them; a box around these, alone or beside the center; a box around four rotors; a
# pose, alone or beside the wing.
Sees = Literal["wing", "points", "box", "center_box", "rotor_box", "pose", "wing_pose"]
SEES: Final[tuple[Sees, ...]] = get_args(Sees)


class Gimbal(Record, frozen=True, kw_only=True):
    """A moving mount, level and turned with our heading; the camera's `mount_rpy_deg` is then from its head. It
    sweeps by `sweep_deg` in yaw and pitch to either side, with `period` s each, and says `rate` times a second
    where it points, with a constant error (1 sigma) of `error_deg` about each axis."""

    sweep_deg: tuple[NotNegative, NotNegative] = (12.0, 5.0)
    period: tuple[Positive, Positive] = (6.0, 3.7)
    phase_deg: tuple[float, float] = (0.0, 0.0)  # of either sweep at the start
    rate: Annotated[float, msgspec.Meta(gt=0, le=200)] = 20.0
    latency: NotNegative = 0.0  # s, from its stamp to delivery
    error_deg: NotNegative = 0.3
    yaw_error_deg: NotNegative | None = None  # about the vertical axis, if another
    component: Annotated[int, msgspec.Meta(ge=1, le=255)] = 154


class Camera(Record, frozen=True, kw_only=True):
    """The camera and the vision process behind it. `mount_rpy_deg` is ZYX from body to camera; [0, 15, 0] looks
    up. `mount_offset` is r_FC_b (m), `rate` in Hz."""

    name: str = "front"
    rate: Annotated[float, msgspec.Meta(gt=0, le=200)] = 25.0
    f_px: Positive = 554.256
    width_px: Positive = 640.0
    height_px: Positive = 480.0
    mount_rpy_deg: Vec3 = (0.0, 0.0, 0.0)
    mount_offset: Vec3 = (0.0, 0.0, 0.0)
    sees: Sees = "wing"
    sigma_px: NotNegative = 1.0
    states_sigma: bool = True  # whether each point comes with its `sigma_px`
    smallest_px: NotNegative = 0.0  # of the wingspan as seen broadside: what is smaller is not detected
    p_lose: Probability = 0.02  # registered -> not, per image
    p_regain: Probability = 0.38  # not registered -> registered, per image
    latency: NotNegative = 0.02  # s, from exposure to delivery
    stamp_late: NotNegative = 0.0  # s, stamp minus exposure: a stamp taken on the way
    wrong_blob: Probability = 0.0  # per registered image
    blob_span_px: tuple[Positive, Positive] = (10.0, 150.0)
    blackouts: tuple[Interval, ...] = ()
    gimbal: Gimbal | None = None
    pictures: Literal["none", "aircraft", "tag"] = "none"  # drawn and published instead of points
