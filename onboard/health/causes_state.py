"""Why an estimate is not valid, where nothing else that is wrong says so: by the cause that it states itself."""

from collections.abc import Iterator
from typing import Final, NamedTuple

from onboard.health.needs import Moment
from onboard.messages import Advice, Health, Severity
from onboard.messages.causes import Cause
from onboard.units import NS_PER_S

NOT_VALID_NS: Final = 5 * NS_PER_S  # not valid for so long
VALID: Final = frozenset({Cause.NONE, Cause.FUSED, Cause.PREDICTED, Cause.CARRIED})


class StateRemedy(NamedTuple):
    """What to do, and what it costs meanwhile."""

    words: str
    severity: Severity = Severity.WARNING


FIT: Final = "`onboard calibrate LOG` finds mount, delay and focal length of a recorded flight"
LEADER_ABSENT: Final = StateRemedy(
    "nothing, if no leader is in view; else look at what the detector finds", Severity.NOTICE
)
STARTS: Final = StateRemedy("wait; if it lasts, look at what the detector finds", Severity.NOTICE)
MISFIT_REMEDY: Final = StateRemedy(f"`mount_rpy_deg`, `delay_s`, `f_px` of [camera] or the size is wrong: {FIT}")
UNEXPECTED: Final = StateRemedy(
    "look at how the leader flies: no `leader_class` of [estimator.leader] flies aerobatics. If it flies "
    "steadily, the detector is noisier than `sigma_px` of [camera], or `size_prior_m` of [estimator.leader] or "
    f"`mount_rpy_deg`, `delay_s`, `f_px` of [camera] is wrong: {FIT}"
)
ONE_TARGET: Final = StateRemedy(
    "let the detector follow one aircraft, and name it by one `target`, `id` and `class`"
)
STREAMS: Final = StateRemedy(
    "look at the autopilot's streams: ATTITUDE_QUATERNION and LOCAL_POSITION_NED, 10 Hz or more"
)
SENSORS: Final = StateRemedy(
    "look at the autopilot's own filter: vibration, compass, GPS; land, and restart it. `onboard report LOG` "
    "shows what contradicts what",
    Severity.ERROR,
)
SLOW: Final = StateRemedy("make the link faster, or this program's computer less busy (`top`)")
RESTARTED: Final = StateRemedy("wait: it begins anew with the next images", Severity.NOTICE)
OUR_FAULT: Final = StateRemedy("report it, with the recording")
STATE_REMEDIES: Final = {
    **dict.fromkeys((Cause.NO_MEASUREMENT, Cause.FORGOTTEN, Cause.TIMEOUT, Cause.DISPLACED), LEADER_ABSENT),
    **dict.fromkeys((Cause.STARTING, Cause.SEEN_AGAIN), STARTS),
    **dict.fromkeys(
        (
            *(Cause.NOISE, Cause.ASTRAY, Cause.RANGE_CONTRADICTS, Cause.WING_TOO_LARGE, Cause.ALL_GATED),
            *(Cause.NO_RANGE, Cause.GIMBAL_FRAME),
        ),
        MISFIT_REMEDY,
    ),
    Cause.UNEXPECTED: UNEXPECTED,
    **dict.fromkeys((Cause.LEAPT, Cause.CLASS_OPEN, Cause.CLASS_CHANGED, Cause.RENAMED), ONE_TARGET),
    Cause.CAMERAS_APART: StateRemedy(
        "`mount_rpy_deg`, `f_px` or `delay_s` of one of these cameras is wrong, or one `target` is two aircraft: "
        "fly with one camera alone to see which"
    ),
    Cause.EXTENT_OPEN: StateRemedy(
        "look at the detector's boxes or points: let it bound the same extent of the aircraft in each image"
    ),
    Cause.FULL: StateRemedy(
        "raise `max_targets` of [estimator.leader], or let the detector report fewer aircraft"
    ),
    Cause.STALE: StateRemedy("restart the camera: it sends the same image again"),
    **dict.fromkeys(
        (
            *(Cause.REBOOTED, Cause.CLOCK_SET, Cause.CLOCK_CORRECTED, Cause.OTHER_AUTOPILOT, Cause.ORIGIN_MOVED),
            Cause.WARM_STATE,
        ),
        RESTARTED,
    ),
    **dict.fromkeys((Cause.NO_POSITION, Cause.FIX_UNUSABLE), StateRemedy("wait for its GPS; look at its antenna")),
    **dict.fromkeys((Cause.NO_ATTITUDE, Cause.OWN_MOTION_UNKNOWN, Cause.SILENT), STREAMS),
    **dict.fromkeys((Cause.OWN_MOTION_DOUBT, Cause.FIXES_CONTRADICT), SENSORS),
    Cause.OTHER_VEHICLE: StateRemedy("set `airframe` of [estimator.own_state] to what flies"),
    Cause.CLOCK_RATE: StateRemedy(
        "let a simulator run in real time, or stamp images by its clock (`clock: boot`)"
    ),
    **dict.fromkeys((Cause.HELD_UP, Cause.BEHIND, Cause.OUTDATED), SLOW),
    **dict.fromkeys((Cause.FILTER_FAILED, Cause.ESTIMATOR_ERROR), OUR_FAULT),
}


def invalid(m: Moment) -> Iterator[Advice]:
    """Estimates that have not been valid for some seconds."""
    if m.now.t_recv_ns - m.before.t_recv_ns < NOT_VALID_NS:
        return
    for name in m.now.states:
        if is_valid(m.now, name) or name not in m.before.states or is_valid(m.before, name):
            continue
        cause, why = m.now.causes.get(name, Cause.NONE), m.now.reasons.get(name, "")
        remedy = STATE_REMEDIES.get(cause, OUR_FAULT)
        yield Advice(
            kind="not-valid",
            severity=remedy.severity,
            about=f"estimate {name}",
            what=f"the {name} estimate is not valid: {why or cause.meaning}",
            remedy=remedy.words,
            text=f"{name}: {why or cause.meaning}",
            over=f"{name}: valid again",
        )


def is_valid(health: Health, name: str) -> bool:
    """Whether the newest estimate of this name may be used."""
    return health.states[name].is_valid and health.causes.get(name, Cause.NONE) in VALID
