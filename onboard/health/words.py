"""The one table of what is said of a cause: why a message is refused, and what to do about that, or about an
estimate that is not valid. What a cause means in general is `Cause.meaning`."""

from collections.abc import Mapping
from typing import Final, NamedTuple

from onboard.messages import Severity
from onboard.messages.causes import Cause


class Remedy(NamedTuple):
    """An action that mends a cause."""

    words: str  # the line to type or the key to change
    advice: str = "not-valid"  # the advice's name
    short: str = ""  # a few words for a pilot
    severity: Severity = Severity.WARNING  # the cost of doing nothing

    @property
    def noticed(self) -> "Remedy":
        """The same, where it costs nothing."""
        return self._replace(severity=Severity.NOTICE)


class Words(NamedTuple):
    """Words for one cause."""

    refused: str | None = None  # why a message is refused, and what was expected
    sensor: str | None = None  # the same for a sensor of our own state
    refusal: Remedy = Remedy("", "refused", "messages refused")  # The refusal itself may name the action.
    state: Remedy = Remedy("report it, with the recording")  # for an estimate that is not valid


def of_state(words: str) -> Words:
    """Return the words of a cause that an estimate states."""
    return Words(state=Remedy(words))


def noticed(words: str) -> Words:
    """Return the words of a cause that costs nothing, as an estimate states it."""
    return Words(state=Remedy(words).noticed)


def of_refusal(advice: str, short: str, words: str) -> Words:
    """Return the words of a cause that refuses messages; each refusal explains itself."""
    return Words(refusal=Remedy(words, advice, short))


NOTHING: Final = Words()
FIT: Final = "`onboard calibrate LOG` finds mount, delay and focal length of a recorded flight"
STAMPS: Final = Remedy(
    "stamp the time of exposure; a steady error is `delay_s` of [camera] (`onboard calibrate LOG` finds it)",
    "stamps",
    "stamps are off",
)
SIGNING: Final = Remedy(
    "`key_file` of the [[link]] and the other side must have one key, and both clocks be set",
    "signing",
    "MAVLink signing",
)
PIXELS: Final = Remedy(
    "set `width_px` and `height_px` of [camera] to the detector's images, or send `intrinsics`",
    "pixels",
    "pixels of another image",
)
SENSORS: Final = Remedy(
    "does another vehicle on these links have the same MAVLink system id? Give each its own (ArduPilot MAV_SYSID "
    "or SYSID_THISMAV, PX4 MAV_SYS_ID); else look at the autopilot's own filter: vibration, compass, GPS; land, "
    "and restart it. `onboard report LOG` shows what contradicts what",
    severity=Severity.ERROR,
)
RESTARTED: Final = noticed("wait: it begins anew with the next images")

WORDS: Final[Mapping[str, Words]] = {  # by cause, and by a verdict of the same name
    # The state of a track
    **dict.fromkeys(
        (Cause.NO_MEASUREMENT, Cause.FORGOTTEN, Cause.TIMEOUT, Cause.DISPLACED),
        noticed("nothing, if no leader is in view; else look at what the detector finds"),
    ),
    **dict.fromkeys(
        (Cause.STARTING, Cause.SEEN_AGAIN), noticed("wait; if it lasts, look at what the detector finds")
    ),
    Cause.NO_RANGE: noticed("wait for an image of its wing; else let the detector find `left` and `right`"),
    **dict.fromkeys(
        (Cause.LEAPT, Cause.CLASS_OPEN, Cause.CLASS_CHANGED, Cause.RENAMED),
        of_state("let the detector follow one aircraft, and name it by one `target`, `id` and `class`"),
    ),
    **dict.fromkeys((Cause.FILTER_FAILED, Cause.ESTIMATOR_ERROR), Words()),
    **dict.fromkeys(
        (Cause.UNEXPECTED, Cause.NOISE, Cause.ALL_GATED),
        of_state(
            "look at how the leader flies, as no `leader_class` of [estimator.leader] flies aerobatics, and at "
            f"what the detector finds. If it lasts in steady flight: {FIT}"
        ),
    ),
    Cause.CAMERAS_APART: of_state(
        "`mount_rpy_deg`, `f_px` or `delay_s` of one of these cameras is wrong, or one `target` is two "
        "aircraft: fly with one camera alone to see which"
    ),
    Cause.FULL: Words(
        "as many targets are followed as `max_targets` allows",
        state=Remedy("raise `max_targets` of [estimator.leader], or let the detector report fewer aircraft"),
    ),
    Cause.STALE: Words(
        "the points have not changed at all although the camera has turned: does the camera hang?",
        state=Remedy("restart the camera: it sends the same image again"),
    ),
    **dict.fromkeys(
        (
            Cause.REBOOTED,
            Cause.CLOCK_SET,
            Cause.CLOCK_CORRECTED,
            Cause.OTHER_AUTOPILOT,
            Cause.ORIGIN_MOVED,
        ),
        RESTARTED,
    ),
    Cause.WARM_STATE: RESTARTED._replace(refusal=NOTHING.refusal.noticed),
    # Our own motion
    **dict.fromkeys((Cause.NO_POSITION, Cause.FIX_UNUSABLE), of_state("wait for its GPS; look at its antenna")),
    **dict.fromkeys(
        (Cause.NO_ATTITUDE, Cause.OWN_MOTION_UNKNOWN, Cause.SILENT),
        of_state("look at the autopilot's streams: ATTITUDE_QUATERNION and LOCAL_POSITION_NED, 10 Hz or more"),
    ),
    **dict.fromkeys(
        (Cause.HELD_UP, Cause.BEHIND, Cause.OUTDATED),
        of_state("make the link faster, or this program's computer less busy (`top`)"),
    ),
    Cause.FIXES_CONTRADICT: Words(state=SENSORS),
    Cause.OWN_MOTION_DOUBT: Words(
        refusal=Remedy(
            "look for vibration, and which of them the GPS agrees with (`onboard report LOG`); `source` of "
            "[ownship] sets which is used",
            "own-misfit",
            "own velocity in doubt",
        ).noticed,
        state=SENSORS,
    ),
    Cause.OTHER_VEHICLE: of_state("set `airframe` of [estimator.own_state] to what flies"),
    Cause.CLOCK_RATE: of_state(
        "let a simulator run in real time, make a slow link faster, or stamp images by its clock (`clock: boot`)"
    ),
    # Messages that are refused
    Cause.BEFORE_HEARTBEAT: Words(
        "no autopilot has sent a heartbeat yet, so it is not known whose vehicle this is"
    ),
    Cause.OTHER_SYSTEM: Words("it is of another MAVLink system; expected the system of our autopilot"),
    Cause.NO_TIME_BASE: Words(
        "the autopilot has sent no time stamp yet, so the time of exposure cannot be compared with it"
    ),
    Cause.UNSTAMPED_POINTS: Words(
        "it has no time; expected the time of exposure, on the clock `boot` or `host`",
        refusal=Remedy(
            "send `t_ns`, the time of exposure, with `clock: host` or `clock: boot`",
            "clock",
            "images without a time",
        ),
    ),
    Cause.OTHER_CLOCK: of_refusal(
        "clock", "stamps of another clock", "send nanoseconds of the clock that `clock` names"
    ),
    Cause.LATER_THAN_ARRIVAL: Words(refusal=STAMPS),
    Cause.DUPLICATE: Words(
        "`t_ns` is that of an earlier image of this target; expected a new time for each image", refusal=STAMPS
    ),
    Cause.TOO_OLD: Words(
        "`t_ns` is {age:.2f} s before the autopilot's newest message; expected at most "
        "0.5 s, and a time of exposure on the clock that `clock` names",
        refusal=STAMPS,
    ),
    Cause.TOO_NEW: Words(
        "`t_ns` is {lead:.2f} s after the autopilot's newest message; expected a time of exposure on "
        "the clock that `clock` names",
        refusal=STAMPS,
    ),
    Cause.NO_POSE: Words(
        "our own attitude at `t_ns`, {age:.2f} s before the autopilot's newest message, is not known"
        ", or not that of the camera's gimbal",
        refusal=STAMPS,
    ),
    Cause.NOT_FINITE: Words(
        "a coordinate or a sigma is not a finite number",
        "a field is not a finite number; expected one, or MAVLink's value for not known",
    ),
    Cause.DEGENERATE: Words(
        "the wingtips coincide, a point is 90 degrees off the optical axis, or a sigma is absurd; "
        "expected three distinct points in pixels of the image",
        "it states what no vehicle does; expected the units and scales of the MAVLink message",
    ),
    Cause.UNASSOCIATED: Words(
        sensor="no motor is observed: the vehicle is armed, and no outputs run all of them above the `pwm_us` of "
        "its airframe, so that its faults are not named; expected SERVO_OUTPUT_RAW of the motors' port"
    ),
    Cause.OUT_OF_VIEW: Words(
        "a point is at or beyond the edge of the image; expected all inside `width_px` and `height_px` by more "
        "than `edge_px`",
        refusal=PIXELS,
    ),
    Cause.DIRECTION_ONLY: Words(
        "it shows no wing, or one of less than two sigmas, and a direction alone starts no track; expected `left` "
        "and `right` in the first images"
    ),
    Cause.UNKNOWN_CAMERA: of_refusal(
        "camera",
        "unknown camera name",
        "send a known name as `camera`, or add [cameras.NAME] to the configuration",
    ),
    Cause.UNKNOWN_CLASS: of_refusal(
        "class", "class is not followed", "add it to `classes` of that camera, or leave `classes` out"
    ),
    Cause.SIGNING: Words(refusal=SIGNING),
    Cause.UNVERIFIED: Words(refusal=SIGNING.noticed),
    Cause.OTHER_TARGET: Words(
        refusal=Remedy(
            "end it there (QGroundControl: General, Stream GCS position: never)",
            "follow-target",
            "also sends FOLLOW_TARGET",
            Severity.ERROR,
        )
    ),
    Cause.BAUD_RATE: of_refusal(
        "link", "no MAVLink in what comes", "set the baud rate, the last part of a serial `url` of the [[link]]"
    ),
    Cause.RATE_REFUSED: of_refusal(
        "rates",
        "it refuses message rates",
        "set it there: ArduPilot `param set SR1_EXTRA1 50` (4.7: MAV2_EXTRA1), PX4 `mavlink stream -d DEVICE "
        "-s ATTITUDE_QUATERNION -r 50`; or leave out of `rates_hz` in [autopilot] what it does not know",
    ),
    # What is named of messages that are used
    Cause.MOUNT: of_refusal(
        "mount",
        "camera mount is off",
        "turn the camera, or set `mount_rpy_deg` of [camera]; `onboard calibrate LOG` finds it",
    ),
    Cause.OFF_CENTER: of_refusal(
        "pixels",
        "principal point of another image",
        "let `cx_px` and `cy_px`, `intrinsics` or `calibration` be of images of the detector's size; a part of "
        "an image is `crop_px` of [camera]",
    ),
    Cause.BINNED: Words(
        refusal=Remedy(
            "write focal lengths, principal point and size of one image, if this is not meant",
            "pixels",
            "intrinsics scaled to the image",
        ).noticed
    ),
    Cause.QUARTER: Words(refusal=PIXELS.noticed),
    **dict.fromkeys(
        (Cause.KEY_UNREADABLE, Cause.RANGE_UNUSED, Cause.IGNORED), Words(refusal=NOTHING.refusal.noticed)
    ),
}
