"""What to do about a refusal, by its cause."""

from typing import Final, NamedTuple

from onboard.messages import Severity
from onboard.messages.causes import Cause


class Remedy(NamedTuple):
    """The name of the advice, the line to type or the key to change, the same in a few words for a pilot, and what
    it costs as long as nothing is done."""

    advice: str
    remedy: str
    short: str
    severity: Severity = Severity.WARNING


STAMPS: Final = Remedy(
    "stamps",
    "stamp the time of exposure; a steady error is `delay_s` of [camera] (`onboard calibrate LOG` finds it)",
    "stamps are off",
)
SIGNING: Final = Remedy(
    "signing",
    "`key_file` of the [[link]] and the other side must have one key, and both clocks be set",
    "MAVLink signing",
)
PIXELS: Final = Remedy(
    "pixels",
    "set `width_px` and `height_px` of [camera] to the detector's images, or send `intrinsics`",
    "pixels of another image",
)
UNKNOWN: Final = Remedy("refused", "", "messages refused")  # the words themselves say what was expected
NOTICED: Final = UNKNOWN._replace(severity=Severity.NOTICE)

REMEDIES: Final = {
    Cause.UNKNOWN_CAMERA: Remedy(
        "camera",
        "send a known name as `camera`, or add [cameras.NAME] to the configuration",
        "unknown camera name",
    ),
    Cause.UNKNOWN_CLASS: Remedy(
        "class", "add it to `classes` of that camera, or leave `classes` out", "class is not followed"
    ),
    Cause.UNSTAMPED_POINTS: Remedy(
        "clock",
        "send `t_ns`, the time of exposure, with `clock: host` or `clock: boot`",
        "images without a time",
    ),
    Cause.OTHER_CLOCK: Remedy(
        "clock", "send nanoseconds of the clock that `clock` names", "stamps of another clock"
    ),
    **dict.fromkeys(
        (Cause.LATER_THAN_ARRIVAL, Cause.DUPLICATE, Cause.TOO_OLD, Cause.TOO_NEW, Cause.NO_POSE), STAMPS
    ),
    Cause.SIGNING: SIGNING,
    Cause.UNVERIFIED: SIGNING._replace(severity=Severity.NOTICE),
    Cause.KEY_UNREADABLE: NOTICED,
    Cause.BAUD_RATE: Remedy(
        "link",
        "set the baud rate, the last part of a serial `url` of the [[link]]",
        "no MAVLink in what comes",
    ),
    Cause.RATE_REFUSED: Remedy(
        "rates",
        "set it there: ArduPilot `param set SR1_EXTRA1 50` (4.7: MAV2_EXTRA1), PX4 `mavlink stream -d DEVICE "
        "-s ATTITUDE_QUATERNION -r 50`; or leave out of `rates_hz` in [autopilot] what it does not know",
        "it refuses message rates",
    ),
    Cause.MOUNT: Remedy(
        "mount",
        "turn the camera, or set `mount_rpy_deg` of [camera]; `onboard calibrate LOG` finds it",
        "camera mount is off",
    ),
    Cause.FOCAL_LENGTH: Remedy(
        "focal",
        "set `f_px` of [camera] for images of that size, or send `intrinsics`; `onboard calibrate LOG` finds it",
        "focal length is off",
    ),
    Cause.DELAY: Remedy(
        "stamps",
        "stamp the time of exposure, or set the `delay_s` of [camera] that fits (`onboard calibrate LOG`)",
        "stamps are off",
    ),
    Cause.CAMERA_SETUP: Remedy(
        "camera-setup",
        "`onboard calibrate LOG` of a flight that pitches, rolls and turns finds `delay_s`, `mount_rpy_deg` and "
        "`f_px` of [camera]",
        "camera setup is off",
    ),
    Cause.OFF_CENTER: Remedy(
        "pixels",
        "let `cx_px` and `cy_px`, `intrinsics` or `calibration` be of images of the detector's size; a part of an "
        "image is `crop_px` of [camera]",
        "principal point of another image",
    ),
    Cause.BINNED: Remedy(
        "pixels",
        "write focal lengths, principal point and size of one image, if this is not meant",
        "intrinsics scaled to the image",
        Severity.NOTICE,
    ),
    Cause.OWN_MOTION_DOUBT: Remedy(
        "own-misfit",
        "look for vibration, and which of them the GPS agrees with (`onboard report LOG`); `source` of [ownship] "
        "sets which is used",
        "own velocity in doubt",
        Severity.NOTICE,
    ),
    Cause.OUT_OF_VIEW: PIXELS,
    Cause.QUARTER: PIXELS._replace(severity=Severity.NOTICE),
    Cause.RANGE_UNUSED: NOTICED,
    Cause.IGNORED: NOTICED,
}


def remedy_of(cause: Cause) -> Remedy:
    """What to do about refusals of a cause."""
    return REMEDIES.get(cause, UNKNOWN)
