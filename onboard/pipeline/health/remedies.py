"""By what a refusal's reason says: its cause, the remedy, and the same in a few words."""

import re
from typing import Final, NamedTuple

from onboard.messages import Refusal


class Remedy(NamedTuple):
    """A pattern in the reason, the cause, the line to type or the key to change, and a few words for a pilot."""

    pattern: str
    cause: str
    remedy: str
    short: str
    costs: bool = False  # what it finds makes estimates wrong, though the messages are used


REMEDIES: Final = (
    Remedy(
        r"no camera is called",
        "camera",
        "send a known name as `camera`, or add [cameras.NAME] to the configuration",
        "unknown camera name",
    ),
    Remedy(
        r"is not followed; `classes`",
        "class",
        "add it to `classes` of that camera, or leave `classes` out",
        "class is not followed",
    ),
    Remedy(
        r"no time; expected",
        "clock",
        "send `t_ns`, the time of exposure, with `clock: host` or `clock: boot`",
        "images without a time",
    ),
    Remedy(
        r"clock: (host|boot)`",
        "clock",
        "send the clock that is named, which is that of `t_ns`",
        "stamps of another clock",
    ),
    Remedy(
        r"`t_ns` is|our own attitude at `t_ns`",
        "stamps",
        "stamp the time of exposure; a steady error is `delay_s` of [camera] (`onboard calibrate LOG` finds it)",
        "stamps are off",
    ),
    Remedy(
        r"signed|signs as of",
        "signing",
        "`key_file` of the [[link]] and the other side must have one key, and both clocks be set",
        "MAVLink signing",
    ),
    Remedy(
        r"baud rate",
        "link",
        "set the baud rate, the last part of a serial `url` of the [[link]]",
        "no MAVLink in what comes",
    ),
    Remedy(
        r"refuses a message rate",
        "rates",
        "set it there: ArduPilot `param set SR1_EXTRA1 50` (4.7: MAV2_EXTRA1), PX4 `mavlink stream -d DEVICE "
        "-s ATTITUDE_QUATERNION -r 50`; or leave out of `rates_hz` in [autopilot] what it does not know",
        "it refuses message rates",
    ),
    Remedy(
        r"`mount_rpy_deg`",
        "mount",
        "turn the camera, or set `mount_rpy_deg` of [camera]; `onboard calibrate LOG` finds it",
        "camera mount is off",
        costs=True,
    ),
    Remedy(
        r"as if `f_px`",
        "focal",
        "set `f_px` of [camera] for images of that size, or send `intrinsics`; `onboard calibrate LOG` finds it",
        "focal length is off",
        costs=True,
    ),
    Remedy(
        r"no position yet",
        "position",
        "wait until the autopilot's filter has aligned; without GPS, give it another position",
        "autopilot has no position yet",
    ),
    Remedy(
        r"principal point .* far from the middle",
        "pixels",
        "let `cx_px` and `cy_px`, `intrinsics` or `calibration` be of images of the detector's size; a part of an "
        "image is `crop_px` of [camera]",
        "principal point of another image",
        costs=True,
    ),
    Remedy(
        r"principal point .* as of binned pixels",
        "pixels",
        "write focal lengths, principal point and size of one image, if this is not meant",
        "intrinsics scaled to the image",
    ),
    Remedy(
        r"upper left quarter|edge of the image",
        "pixels",
        "set `width_px` and `height_px` of [camera] to the detector's images, or send `intrinsics`",
        "pixels of another image",
    ),
)
UNKNOWN: Final = Remedy("", "refused", "", "messages refused")  # the reason itself says what was expected


def remedy_of(refusal: Refusal) -> Remedy:
    """The remedy that fits a reason."""
    return next((r for r in REMEDIES if re.search(r.pattern, refusal.reason)), UNKNOWN)
