"""Which messages of cameras are refused, in words for the detector's author: the field, and what was expected."""

from functools import lru_cache
from typing import Final, NamedTuple

from msgspec.structs import replace

from onboard.messages import Estimate, Exposure, MeasurementReport, Message, NavState, Refusal, Verdict
from onboard.messages.causes import Cause, Reason
from onboard.messages.text import plain, without_names, without_numbers
from onboard.units import S_PER_NS

MOST_REFUSALS: Final = 32  # kinds that are remembered: a source and a reason each
ALIKE: Final = 8  # of these, kinds that differ only in names: senders may choose any number of them
OTHERS: Final = "others"  # the source of all further ones
ROS_HASH: Final = "/RIHS"  # of a type begins so, at the end of a key of rmw_zenoh: nobody reads it
LONGEST: Final = 240  # characters; the text may quote what came

REFUSAL_WORDS: Final[dict[str, str]] = {  # by what the health counts
    Cause.BEFORE_HEARTBEAT: "no autopilot has sent a heartbeat yet, so it is not known whose vehicle this is",
    Cause.OTHER_SYSTEM: "it is of another MAVLink system; expected the system of our autopilot",
    Cause.UNSTAMPED_POINTS: "it has no time; expected the time of exposure, on the clock `boot` or `host`",
    Cause.NO_TIME_BASE: "the autopilot has sent no time stamp yet, so the time of exposure cannot be compared "
    "with it",
}
VERDICTS: Final = {  # each is a cause, too
    Verdict.NOT_FINITE: "a coordinate or a sigma is not a finite number",
    Verdict.DEGENERATE: "the wingtips coincide, a point is 90 degrees off the optical axis, or a sigma is absurd; "
    "expected three distinct points in pixels of the image",
    Verdict.OUT_OF_VIEW: "a point is at or beyond the edge of the image; expected all inside `width_px` and "
    "`height_px` by more than `edge_px`",
    Verdict.DUPLICATE: "`t_ns` is that of an earlier image of this target; expected a new time for each image",
    Verdict.STALE: "the points have not changed at all although the camera has turned: does the camera hang?",
    Verdict.TOO_OLD: "`t_ns` is {age:.2f} s before the autopilot's newest message; expected at most "
    "`rewind_horizon_s`, and a time of exposure on the clock that `clock` names",
    Verdict.TOO_NEW: "`t_ns` is {lead:.2f} s after the autopilot's newest message; expected a time of exposure on "
    "the clock that `clock` names",
    Verdict.NO_POSE: "our own attitude at `t_ns`, {age:.2f} s before the autopilot's newest message, is not known"
    ", or not that of the camera's gimbal",
    Verdict.DIRECTION_ONLY: "it shows no wing, or one of less than two sigmas, and a direction alone starts no "
    "track; expected `left` and `right` in the first images",
    Verdict.FULL: "as many targets are followed as `max_targets` allows",
}

OWN_SENSORS: Final = {  # of our own state's sensors
    Verdict.NOT_FINITE: "a field is not a finite number; expected one, or MAVLink's value for not known",
    Verdict.DEGENERATE: "it states what no vehicle does; expected the units and scales of the MAVLink message",
    Verdict.UNASSOCIATED: "no motor is observed: the vehicle is armed, and no outputs run all of them above the "
    "`pwm_us` of its airframe, so that its faults are not named; expected SERVO_OUTPUT_RAW of the motors' port",
}


class RefusalKind(NamedTuple):
    """What is counted together: a source and words without their numbers. `alike`: without names, too."""

    source: str
    words: str
    alike: str


class Refusals:
    """What was refused, by source and reason. The kinds that came last are kept; a flood costs no more room, and
    not that of other kinds: of those that differ only in names, a few are kept apart."""

    def __init__(self) -> None:
        self._kinds: dict[RefusalKind, Refusal] = {}  # the latest last

    @property
    def latest(self) -> tuple[Refusal, ...]:
        """The kinds of refusals that came last, the latest last."""
        return tuple(self._kinds.values())

    def add(self, source: str, why: Reason, t_recv_ns: int) -> None:
        """Count a message that was refused. Reasons that differ only in numbers are one: the first is kept."""
        source, words, key = _sorted(source, why.words)
        if key not in self._kinds and sum(other.alike == key.alike for other in self._kinds) >= ALIKE:
            source, key = OTHERS, RefusalKind(OTHERS, key.alike, key.alike)
        before = self._kinds.pop(key, None)
        if before is None:
            before = Refusal(source=source, cause=why.cause, reason=words, count=0, t_recv_ns=t_recv_ns)
        self._kinds[key] = replace(before, count=before.count + 1, t_recv_ns=t_recv_ns)
        while len(self._kinds) > MOST_REFUSALS:
            del self._kinds[next(iter(self._kinds))]

    def add_message(self, message: Message, why: str | Reason) -> None:
        """Count a message that went no further, if it is of a camera: for a reason, or by what the health
        counts."""
        if isinstance(message, Exposure):
            found = why if isinstance(why, Reason) else Reason(Cause(why), REFUSAL_WORDS[why])
            self.add(f"camera {message.camera}", found, message.t_recv_ns)

    def add_verdict(self, estimate: Estimate, report: MeasurementReport) -> None:
        """Count an image that an estimator could not use. A gated image could be used: it only fits no track."""
        is_own = isinstance(estimate, NavState) and report.verdict in OWN_SENSORS
        text = (OWN_SENSORS if is_own else VERDICTS).get(report.verdict)
        if text is None or (report.points is None and not is_own):
            return
        lead = (report.t_ns - estimate.t_ns) * S_PER_NS
        words = f"{report.verdict}: {text.format(lead=lead, age=-lead)}"
        source = f"{'our own' if is_own else 'camera'} {report.source}"
        self.add(source, Reason(Cause(report.verdict), words), report.t_recv_ns)


@lru_cache(maxsize=4 * MOST_REFUSALS)  # a flood says the same
def _sorted(source: str, words: str) -> tuple[str, str, RefusalKind]:
    """Source and words as they are shown, and their kind."""
    source, words = plain(source.partition(ROS_HASH)[0], LONGEST), plain(words, LONGEST)
    kind = without_numbers(words)
    return source, words, RefusalKind(source, kind, without_names(kind))
