"""Causes and reasons: why an estimate is what it is, and why something is refused or fails.

A cause is for programs, and a reason adds words for people. The writer of the words chooses the cause, and no
program parses the words. One cause covers everything with the same remedy; the words add names and numbers.
"""

from enum import StrEnum
from typing import Final, NamedTuple


class Cause(StrEnum):
    """The cause of an estimate's state, of a refusal, or of the error of a link or a sink.

    A cause keeps its name; the words that accompany it may change.
    """

    meaning: str

    def __new__(cls, value: str, meaning: str = "") -> "Cause":
        """Create a cause with its name, and its meaning for a table."""
        made = str.__new__(cls, value)
        made._value_, made.meaning = value, meaning
        return made

    @classmethod
    def _missing_(cls, value: object) -> "Cause":  # noqa: ARG003 - as EnumType calls it
        """Return NONE for an unknown cause, from a record of another version."""
        return cls.NONE

    NONE = "none", "nothing to explain, or a record from before there were causes"
    # The state of a track, by its measurements
    FUSED = "fused", "measurements are fused"
    PREDICTED = "predicted", "none was fused lately"
    CARRIED = "carried", "none was fused lately; the target's own broadcast says where it is"
    NO_MEASUREMENT = "no_measurement", "none has come yet"
    STARTING = "starting", "too few have come yet, or too few that agree"
    CAMERAS_APART = "cameras_apart", "two cameras show it in different places, or of different sizes"
    SEEN_AGAIN = "seen_again", "after a loss, more must agree"
    TIMEOUT = "timeout", "none was fused within the validity timeout"
    NO_RANGE = "no_range", "none has shown the range for too long"
    FORGOTTEN = "forgotten", "none for so long that the track has ended"
    ALL_GATED = "all_gated", "none has passed the gate for so long that the track has ended"
    FULL = "full", "as many targets are followed as may be"
    # What contradicts a track
    NOISE = "noise", "measurements do not fit, even at several times their noise"
    LEAPT = "leapt", "another object may have taken the target's place in the images"
    UNEXPECTED = "unexpected", "images fit no hypothesis of how the leader flies"
    CLASS_OPEN = "class_open", "the detector takes it now for one class, now for another"
    STALE = "stale", "the camera hangs: the same image comes again"
    FILTER_FAILED = "filter_failed", "the filter has lost its state or covariance"
    # Why a track has ended, or begun anew
    CLASS_CHANGED = "class_changed", "the detector takes it for another class now"
    RENAMED = "renamed", "it goes on under another name"
    DISPLACED = "displaced", "nearer aircraft have taken its place"
    ORIGIN_MOVED = "origin_moved", "the autopilot has moved its origin"
    REBOOTED = "rebooted", "the autopilot has rebooted"
    CLOCK_SET = "clock_set", "the autopilot has set its clock"
    CLOCK_CORRECTED = "clock_corrected", "the clocks' offset was wrong"
    OTHER_AUTOPILOT = "other_autopilot", "another autopilot is followed"
    ESTIMATOR_ERROR = "estimator_error", "an error in the estimator"
    # Our own motion, by which estimates are predicted
    NO_POSITION = "no_position", "the autopilot has no position yet"
    NO_ATTITUDE = "no_attitude", "no attitude from the autopilot"
    OTHER_VEHICLE = "other_vehicle", "what flies is not what the estimator supposes"
    FIXES_CONTRADICT = "fixes_contradict", "GPS fixes contradict accelerometer and attitude"
    FIX_UNUSABLE = "fix_unusable", "GPS fixes cannot be used"
    OWN_MOTION_UNKNOWN = "own_motion_unknown", "our own motion is not known"
    OWN_MOTION_DOUBT = "own_motion_doubt", "our own motion contradicts itself"
    CLOCK_RATE = "clock_rate", "the rate of the autopilot's clock is uncertain"
    SILENT = "silent", "nothing usable of our own motion arrives"
    HELD_UP = "held_up", "the autopilot's messages are held up on their way"
    BEHIND = "behind", "this program is late"
    OUTDATED = "outdated", "a query is answered with a record that was published too long ago"
    # Why a message is refused
    DOCUMENT = "document", "a field is missing, or has a value that it cannot have"
    UNKNOWN_CAMERA = "unknown_camera", "no camera has this name"
    UNKNOWN_CLASS = "unknown_class", "the class is not followed"
    UNSTAMPED_POINTS = "unstamped_points", "an image has no time"
    OTHER_CLOCK = "other_clock", "the time is of another clock than it says"
    NO_TIME_BASE = "no_time_base", "the autopilot has sent no time yet"
    LATER_THAN_ARRIVAL = "later_than_arrival", "the time is later than the arrival"
    DUPLICATE = "duplicate", "the time is that of an earlier image"
    TOO_OLD = "too_old", "older than the rewind horizon"
    TOO_NEW = "too_new", "after the autopilot's newest message"
    NO_POSE = "no_pose", "our own attitude, or the gimbal's, is not known at that time"
    NOT_FINITE = "not_finite", "a number is not finite"
    DEGENERATE = "degenerate", "no camera, or no vehicle, gives such values"
    UNASSOCIATED = "unassociated", "of nothing that is known: outputs that run none of our motors"
    OUT_OF_VIEW = "out_of_view", "at or beyond the edge of the image"
    DIRECTION_ONLY = "direction_only", "a direction alone starts no track"
    BEFORE_HEARTBEAT = "before_heartbeat", "no autopilot is heard yet"
    OTHER_SYSTEM = "other_system", "of another MAVLink system"
    SIGNING = "signing", "frames are not signed, or with another key, or by a wrong clock"
    BAUD_RATE = "baud_rate", "bytes come, and no MAVLink frame"
    NO_MAVLINK = "no_mavlink", "JSON comes, and no MAVLink frame"
    OURSELVES = "ourselves", "our own frames come back"
    RATE_REFUSED = "rate_refused", "the autopilot refuses a message rate"
    OTHER_TARGET = "other_target", "another sender tells the autopilot whom to follow"
    RATIONED = "rationed", "a sender asks for too much"
    UNTRUSTED = "untrusted", "a sender may not change that"
    WARM_STATE = "warm_state", "the state of an earlier run cannot be used"
    LOG = "log", "a row or a line of a log cannot be used"
    # What is named of messages that are used
    IGNORED = "ignored", "a part of a message is not used"
    MOUNT = "mount", "as if the camera looked elsewhere than configured"
    OFF_CENTER = "off_center", "the principal point is far from the image's middle"
    BINNED = "binned", "the focal length is of larger pixels than the image"
    QUARTER = "quarter", "all points are in a quarter of the image"
    RANGE_UNUSED = "range_unused", "the range of detections is not used"
    UNVERIFIED = "unverified", "signed frames, whose key is not at hand"
    KEY_UNREADABLE = "key_unreadable", "the key of a link cannot be read"
    # Why a link or a sink does not work
    UNREACHABLE = "unreachable", "nobody answers, or the device is not there"
    TLS = "tls", "a certificate is not accepted"
    NAME_SHARED = "name_shared", "another program says that it is this vehicle, too"
    DISK_FULL = "disk_full", "no space is left"
    FAILED = "failed", "any other error"


class Reason(NamedTuple):
    """A cause and its description for a person."""

    cause: Cause
    words: str

    def also(self, words: str) -> "Reason":
        """Return a reason with the same cause and further words."""
        return Reason(self.cause, f"{self.words}; {words}")


NO_REASON: Final = Reason(Cause.NONE, "")
