"""PASS, AMBER or FAIL: figures of a flight against limits, with advice for a pilot."""

from collections.abc import Iterator
from enum import StrEnum
from typing import Final, NamedTuple

import numpy as np

from onboard.analysis.flights.replay import ReplayResult
from onboard.analysis.report.series import FUSED, STARTING, FlightSeries
from onboard.scoring.leader import LeaderScore


class Grade(StrEnum):
    """Grade of a figure."""

    PASS = "PASS"  # noqa: S105 - no password
    AMBER = "AMBER"
    FAIL = "FAIL"


GRADES: Final = tuple(Grade)


class Check(NamedTuple):
    """A figure with its value, the wanted value, its grade, and advice unless it is PASS."""

    name: str
    value: str
    wanted: str
    grade: Grade
    advice: str


class Limit(NamedTuple):
    """Limit of a figure: PASS up to `good`, AMBER up to `fair`, and FAIL beyond."""

    sense: str  # AT_LEAST or AT_MOST
    good: float
    fair: float
    unit: str
    what: str  # quantity that is measured
    advice: str


AT_LEAST, AT_MOST = "at least", "at most"
CHECK_VIEW: Final = "look at the states and at the rejected images below; was the leader in the image?"
CHECK_IMAGES: Final = "the table of rejected images says why; `gated` fit no track where the leader is expected"
CHECK_GAPS: Final = "do not let an autopilot follow over such a gap"
CHECK_RESETS: Final = "tracks were given up: the leader was lost, or images contradicted what was known"
CONFIDENTLY_WRONG: Final = "off by more than 3 sigmas and 5 %"
CHECK_INPUTS: Final = "GPS, attitude or their rates: see the streams below"
RAISE_RATE: Final = "our own motion is interpolated between these. Ask for more: "
OUR_RATES: Final = "`rates_hz` of [autopilot]"  # in our own recording
AUTOPILOT_RATES: Final = "`LOG_BITMASK` (ArduPilot) or `SDLOG_PROFILE` (PX4)"  # in the autopilot's own log
STREAM_RATES: Final = "`SRn_EXTRA1`, `SRn_POSITION` (ArduPilot) or `mavlink stream` (PX4)"  # in any other log
LIMITS: Final = {
    "leader: valid": Limit(AT_LEAST, 90.0, 50.0, "%", "of the time, after the first 15 s", CHECK_VIEW),
    "leader: images rejected": Limit(AT_MOST, 10.0, 30.0, "%", "of all images", CHECK_IMAGES),
    "leader: longest gap": Limit(AT_MOST, 2.0, 10.0, "s", "between valid estimates", CHECK_GAPS),
    "leader: begun anew": Limit(AT_MOST, 0.0, 3.0, "", "times", CHECK_RESETS),
    "truth: range error": Limit(
        AT_MOST, 5.0, 15.0, "%", "RMS", "the range is no better than the size that is configured"
    ),
    "truth: confidently wrong": Limit(
        AT_MOST, 1.0, 5.0, "%", CONFIDENTLY_WRONG, "the sigmas cannot be relied on in this flight"
    ),
    "truth: inside the 95 % ellipsoid": Limit(
        AT_LEAST, 85.0, 60.0, "%", "of the time", "errors are larger than the filter claims"
    ),
    "own state: valid": Limit(AT_LEAST, 90.0, 70.0, "%", "of the time, since it first was", CHECK_INPUTS),
    "log: damaged": Limit(
        AT_MOST, 0.0, 100.0, "", "stretches that could not be read", "was the recorder killed, the card full?"
    ),
    "autopilot: reboots": Limit(
        AT_MOST,
        0.0,
        0.0,
        "",
        "in this log",
        "every estimate restarts with the autopilot; look at its power supply",
    ),
    "rate: Attitude": Limit(AT_LEAST, 20.0, 5.0, "Hz", "on average", RAISE_RATE),
    "rate: LocalPosition": Limit(AT_LEAST, 20.0, 5.0, "Hz", "on average", RAISE_RATE),
}


def worst(checks: list[Check]) -> Grade:
    """Grade of a flight: that of its worst figure."""
    return max((check.grade for check in checks), key=GRADES.index, default=Grade.PASS)


def judge(
    series: FlightSeries, score: LeaderScore, replayed: ReplayResult, *, rates: str = OUR_RATES
) -> list[Check]:
    """Check all figures of a flight. `rates` sets the rates of messages in such a log."""
    return [
        *_leader(series, score),
        *_consistency(score),
        *_truth(score),
        *_own_state(series),
        *_log(replayed, rates),
    ]


def _leader(series: FlightSeries, score: LeaderScore) -> Iterator[Check]:
    images = sum(series.counts.values())
    if not images:
        return
    yield _check("leader: valid", score.valid_percent or 0.0)
    kept = sum(series.counts[verdict] for verdict in (*FUSED, *STARTING))
    yield _check("leader: images rejected", 100.0 * (1.0 - kept / images))
    if np.isfinite(series.longest_gap_s):
        yield _check("leader: longest gap", series.longest_gap_s)
    yield _check("leader: begun anew", float(score.resets))


def _consistency(score: LeaderScore) -> Iterator[Check]:
    if score.nis_mean is None or not score.nis_dof:
        return
    ratio, wanted = score.nis_mean / score.nis_dof, "0.4 to 1.5 (AMBER: 0.1 to 2.5)"
    grade = Grade.PASS if 0.4 <= ratio <= 1.5 else Grade.AMBER if 0.1 <= ratio <= 2.5 else Grade.FAIL
    fit = f"{ratio**0.5:.1f} times as far off as expected" if ratio > 1.0 else "nearer than expected"
    advice = f"the images are {fit}; `onboard calibrate LOG` compares the camera's settings with this flight"
    yield Check("images: NIS, of its expectation", f"{ratio:.2f}", wanted, grade, advice)


def _truth(score: LeaderScore) -> Iterator[Check]:
    if score.range_error_rms_percent is None:
        if score.diverged:
            yield Check("leader: diverged", "yes", "no", Grade.FAIL, "nothing could be compared with the truth")
        return
    yield _check("truth: range error", score.range_error_rms_percent)
    yield _check("truth: confidently wrong", score.confidently_wrong_percent or 0.0)
    yield _check("truth: inside the 95 % ellipsoid", score.inside_95_percent or 0.0)
    if score.diverged:
        yield Check("truth: diverged", "yes", "no", Grade.FAIL, "its last seconds are wrong, or empty")


def _own_state(series: FlightSeries) -> Iterator[Check]:
    rows = series.own_state.table()
    if not len(rows):
        return
    first = int(np.argmax(rows[:, 1]))  # before it the vehicle waits on the ground for its filter and GPS
    yield _check("own state: valid", 100.0 * float(rows[first:, 1].mean()))
    ratios = rows[np.isfinite(rows[:, 2]), 2]
    if len(ratios):
        ratio = float(ratios.mean())
        grade = Grade.PASS if 0.3 <= ratio <= 2.0 else Grade.AMBER  # of noisy sensors, not of how wrong we are
        advice = "noisier sensors, or another airframe, than configured" if ratio > 1 else "too cautious"
        yield Check("own state: NIS, of its expectation", f"{ratio:.2f}", "0.3 to 2", grade, advice)
    names = dict.fromkeys(fault.name for fault in series.faults.values())
    grade = Grade.AMBER if names else Grade.PASS
    yield Check("faults named", ", ".join(names) or "none", "none", grade, "look at the vehicle first")


def _log(replayed: ReplayResult, rates: str) -> Iterator[Check]:
    health = replayed.health
    yield _check("log: damaged", float(replayed.damaged))
    yield _check("autopilot: reboots", float(health.autopilot_reboots))
    for name in ("Attitude", "LocalPosition"):
        stream = health.streams.get(name)
        rate = stream.count / replayed.duration if stream and replayed.duration > 0 else 0.0
        yield _check(f"rate: {name}", rate, rates)
    errors = sum(count for name, count in health.rejected.items() if name.startswith("error"))
    if errors:
        yield Check("program errors", str(errors), "0", Grade.FAIL, "please report this log")


def _check(name: str, value: float, more: str = "") -> Check:
    """Check a figure against its limit; `more` ends the advice."""
    sense, good, fair, unit, what, advice = LIMITS[name]
    sign = 1.0 if sense == AT_LEAST else -1.0
    above = [sign * value >= sign * limit for limit in (good, fair)]
    grade = Grade.PASS if above[0] else Grade.AMBER if above[1] else Grade.FAIL
    amber = "" if fair == good else f" (AMBER: {fair:g})"
    return Check(
        name, f"{value:.4g} {unit}".strip(), f"{sense} {good:g} {unit} {what}{amber}", grade, advice + more
    )
