"""The camera of a scenario."""

from typing import Annotated, Literal

import msgspec

from onboard.messages import NotNegative, Positive, Record, Vec3
from simlink.scenarios.profiles import Interval, Probability


class Gimbal(Record, frozen=True, kw_only=True):
    """A moving mount, level and turned with our heading; the camera's `mount_rpy_deg` is then from its head. It
    sweeps by `sweep_deg` in yaw and pitch to either side, with `period` s each, and says `rate` times a second
    where it points, with a constant error of `error_deg` about each axis (1 sigma)."""

    sweep_deg: tuple[NotNegative, NotNegative] = (12.0, 5.0)
    period: tuple[Positive, Positive] = (6.0, 3.7)
    rate: Annotated[float, msgspec.Meta(gt=0, le=200)] = 20.0
    error_deg: NotNegative = 0.3
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
    sigma_px: NotNegative = 1.0
    p_lose: Probability = 0.02  # registered -> not, per image
    p_regain: Probability = 0.38  # not registered -> registered, per image
    latency: NotNegative = 0.02  # s, from exposure to delivery
    stamp_late: NotNegative = 0.0  # s, stamp minus exposure: a stamp taken on the way
    wrong_blob: Probability = 0.0  # per registered image
    blob_span_px: tuple[Positive, Positive] = (10.0, 150.0)
    blackouts: tuple[Interval, ...] = ()
    gimbal: Gimbal | None = None
    pictures: Literal["none", "aircraft", "tag"] = "none"  # drawn and published instead of points
