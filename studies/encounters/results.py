"""The table, checks and claims of the study of encounters.

Every verdict follows from the numbers.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final, NamedTuple

from studies.encounters import recorded
from studies.encounters.flights import (
    BOXES,
    DEFAULTS,
    GIMBALS,
    MANOEUVRE_TIME_S,
    MIN_COURSE_SPEED_M_S,
    ON_WING,
    POINTS,
    POSES,
    SETTLING_TIME_S,
    Case,
    Flight,
)
from studies.encounters.scores import Score, Share, score
from studies.report.findings import Check, Claim, Table, check, verdict
from studies.report.markdown import number

INSIDE_ALL, INSIDE_FAMILY = 93.0, 88.0  # percent of valid estimates, at least
MAX_WRONG_PERCENT: Final = 1.0  # of valid estimates
MIN_BOXES_INSIDE_PERCENT: Final = 92.0  # of valid estimates of the cases with boxes alone
MAX_GIMBAL_ERROR_RATIO: Final = 1.2  # to the range error behind a fixed camera
MIN_POSES_INSIDE_PERCENT: Final = 92.0  # of valid estimates of the cases with poses alone
INSIDE_AFTER, BEYOND_AFTER = 93.0, 2.0  # percent of valid estimates after a manoeuvre, at least and at most
MIN_SHARP_VALID_PERCENT: Final = 90.0  # of all estimates
SHARP: Final = {  # range error (RMS, percent), at most, where the geometry allows it
    Case("behind"): 2.5,
    Case("crab"): 4.0,
    Case("hover", ON_WING): 6.0,
    Case("circling", ON_WING): 6.0,
}


class Requirement(NamedTuple):
    """A figure that must be at least `low`, or at most `high` (percent)."""

    name: str
    ours: Share
    low: float | None = None
    high: float | None = None

    @property
    def missed_by(self) -> float:
        """Return by how much the figure misses, percent; not positive if it does not.

        It is NaN if the figure is unknown.
        """
        return self.ours.percent - self.high if self.high is not None else (self.low or 0.0) - self.ours.percent

    @property
    def is_met(self) -> bool:
        """Whether it is; an unknown figure meets nothing."""
        return self.missed_by <= 0.0

    @property
    def is_near(self) -> bool:
        """Whether it is met, or missed by less than twice the figure's standard error."""
        return self.is_met or self.missed_by < 2.0 * self.ours.error


def table_of(scores: Mapping[Case, Score], total: Score) -> Table:
    """One row for each case, and all flights with default settings together."""
    rows = [(case.name, scores[case]) for case in DEFAULTS if case in scores]
    rows += [("all, defaults", total)] if all(case in scores for case in DEFAULTS) else []
    rows += [(case.name, score) for case, score in scores.items() if case not in DEFAULTS]
    return Table(
        title="Family by family",
        note=f"Every estimate from {SETTLING_TIME_S:g} s on; ± is one standard error, by the scatter from flight "
        "to flight. Range errors are RMS over valid estimates. Inside: the truth is in the 95 % ellipsoid of the "
        "position. Wrong: the range is off by more than 3 sigma and more than 5 %, or another aircraft is "
        "followed. The last rows fly other settings, and do not count in `all, defaults`.",
        header=(
            *(
                "encounter",
                "flights",
                "valid %",
                "± %",
                "range error %",
                "± %",
                "median flight %",
                "worst flight %",
            ),
            *("sigma of range % (median)", "inside %", "± %", "confidently wrong %", "± %"),
        ),
        rows=tuple(
            (
                *(name, float(s.flights), *s.valid, *s.range_error, s.median_flight, s.worst_flight),
                *(s.sigma, *s.inside, *s.wrong),
            )
            for name, s in rows
        ),
    )


def velocity_table(scores: Mapping[Case, Score], after: Mapping[Case, Score]) -> Table:
    """Return one row for each case, and one for the seconds after a manoeuvre begins."""
    rows = [(case.name, s) for case, s in scores.items()]
    rows += [(f"{case.name}, {MANOEUVRE_TIME_S:g} s from the manoeuvre on", s) for case, s in after.items()]
    return Table(
        title="Velocity",
        note="Inside: the truth is in the 95 % ellipsoid. Beyond: the range is off by more than 3 sigma, the"
        " velocity relative to us is out of the ellipsoid of 99.73 %.",
        header=(
            *("encounter", "flights", "velocity inside %", "± %", "velocity beyond %", "± %"),
            *("position inside %", "± %", "range beyond %", "± %"),
        ),
        rows=tuple(
            (name, float(s.flights), *s.velocity_inside, *s.velocity_beyond, *s.inside, *s.beyond)
            for name, s in rows
        ),
    )


def acceleration_table(scores: Mapping[Case, Score]) -> Table:
    """One row for each case."""
    return Table(
        title="Acceleration",
        note=f"a_lat and a_long together, while the leader flies faster than {MIN_COURSE_SPEED_M_S:g} m/s. "
        "Inside: the truth is in the 95 % ellipse. Beyond: out of that of 99.73 %.",
        header=("encounter", "flights", "inside %", "± %", "beyond %", "± %"),
        rows=tuple(
            (case.name, float(s.flights), *s.acceleration_inside, *s.acceleration_beyond)
            for case, s in scores.items()
        ),
    )


def of_logs(flights: Mapping[Case, Sequence[Flight]]) -> dict[str, Score]:
    """The score of all flights with the leader of a log together, by the log's name."""
    found: dict[str, list[Flight]] = {}
    for case, each in flights.items():
        if case.log:
            found.setdefault(Path(case.log).name, []).extend(each)
    return {log: score(each) for log, each in found.items()}


def log_table(scores: Mapping[str, Score]) -> Table:
    """One row for each log."""
    return Table(
        title="Leaders that others flew",
        note="All geometries together. A flight is missing where a log allows none: it is too short, or nowhere in"
        f" view for long. Wanted: at most {recorded.MAX_WRONG_PERCENT:g} % confidently wrong and at least "
        f"{recorded.MIN_INSIDE_PERCENT:g} % inside for each log.",
        header=(
            *("log", "flights", "valid %", "± %", "range error %", "± %", "sigma of range % (median)"),
            *("inside %", "± %", "confidently wrong %", "± %", "velocity beyond %", "± %"),
        ),
        rows=tuple(
            (
                *(log, float(s.flights), *s.valid, *s.range_error, s.sigma),
                *(*s.inside, *s.wrong, *s.velocity_beyond),
            )
            for log, s in scores.items()
        ),
    )


def log_requirements(scores: Mapping[str, Score]) -> dict[str, list[Requirement]]:
    """Return the requirements of recorded leaders, as in `requirements`."""
    wrong = [
        Requirement(f"confidently wrong, {log}", s.wrong, high=recorded.MAX_WRONG_PERCENT)
        for log, s in scores.items()
    ]
    inside = [
        Requirement(f"inside, {log}", s.inside, low=recorded.MIN_INSIDE_PERCENT) for log, s in scores.items()
    ]
    return {
        f"With leaders that others flew, at most {recorded.MAX_WRONG_PERCENT:g} % are confidently wrong in "
        "each log.": wrong,
        f"With leaders that others flew, {recorded.MIN_INSIDE_PERCENT:g} % of each log's ellipsoids hold "
        "the truth.": inside,
    }


def after_requirements(after: Mapping[Case, Score]) -> dict[str, list[Requirement]]:
    """Return the requirements of the seconds after a manoeuvre begins, as in `requirements`."""
    found = [
        requirement
        for case, s in after.items()
        for requirement in (
            Requirement(f"position inside after the manoeuvre, {case.name}", s.inside, low=INSIDE_AFTER),
            Requirement(f"velocity inside after the manoeuvre, {case.name}", s.velocity_inside, low=INSIDE_AFTER),
            Requirement(f"range beyond 3 sigma after the manoeuvre, {case.name}", s.beyond, high=BEYOND_AFTER),
            Requirement(f"velocity beyond after the manoeuvre, {case.name}", s.velocity_beyond, high=BEYOND_AFTER),
        )
    ]
    return {
        f"In the {MANOEUVRE_TIME_S:g} s after a leader begins a manoeuvre, position and velocity are inside in "
        f"{INSIDE_AFTER:g} % of valid estimates, and at most {BEYOND_AFTER:g} % are beyond 3 sigma.": found
    }


def requirements(scores: Mapping[Case, Score], total: Score) -> dict[str, list[Requirement]]:
    """Return the requirements by claim, none for cases that were not flown."""
    families = {case: scores[case] for case in DEFAULTS if case in scores}
    sharp = {case: scores[case] for case in SHARP if case in scores}
    inside = [Requirement("inside, all", total.inside, low=INSIDE_ALL)] if total.flights else []
    inside += [Requirement(f"inside, {c.name}", s.inside, low=INSIDE_FAMILY) for c, s in families.items()]
    wrong = [
        Requirement(f"confidently wrong, {c.name}", s.wrong, high=MAX_WRONG_PERCENT) for c, s in families.items()
    ]
    errors = [Requirement(f"range error, {c.name}", s.range_error, high=SHARP[c]) for c, s in sharp.items()]
    valid = [Requirement(f"valid, {c.name}", s.valid, low=MIN_SHARP_VALID_PERCENT) for c, s in sharp.items()]
    boxes = [
        Requirement(f"inside, {c.name}", scores[c].inside, low=MIN_BOXES_INSIDE_PERCENT)
        for c in BOXES
        if c in scores
    ]
    points = [
        Requirement(f"range error, {c.name}", scores[c].range_error, high=scores[wing].range_error.percent)
        for c in POINTS
        if c in scores and (wing := Case(c.family)) in scores
    ]
    posed = [c for c in POSES if c in scores]
    poses = [Requirement(f"inside, {c.name}", scores[c].inside, low=MIN_POSES_INSIDE_PERCENT) for c in posed]
    poses += [Requirement(f"confidently wrong, {c.name}", scores[c].wrong, high=MAX_WRONG_PERCENT) for c in posed]
    moved = [
        Requirement(
            f"range error, {c.name}",
            scores[c].range_error,
            high=MAX_GIMBAL_ERROR_RATIO * scores[fixed].range_error.percent,
        )
        for c in GIMBALS
        if c in scores and (fixed := c._replace(mount="fixed")) in scores
    ]
    return {
        f"The 95 % ellipsoid holds the truth in {INSIDE_ALL:g} % of all valid estimates, and in "
        f"{INSIDE_FAMILY:g} % of each family's.": inside,
        f"At most {MAX_WRONG_PERCENT:g} % of the valid estimates of any family are confidently wrong.": wrong,
        "The range is sharp where the geometry allows it: "
        + ", ".join(f"{limit:g} % ({case.name})" for case, limit in SHARP.items())
        + ".": errors,
        f"There, at least {MIN_SHARP_VALID_PERCENT:g} % of all estimates are valid.": valid,
        f"With boxes alone, the 95 % ellipsoid holds the truth in {MIN_BOXES_INSIDE_PERCENT:g} % of valid "
        "estimates.": boxes,
        "Nose and tail, where a detector finds them, make the range better than the wing alone does.": points,
        f"With poses alone, the 95 % ellipsoid holds the truth in {MIN_POSES_INSIDE_PERCENT:g} % of valid "
        f"estimates, and at most {MAX_WRONG_PERCENT:g} % are confidently wrong.": poses,
        f"With the camera on a gimbal that sweeps, the range error is at most {MAX_GIMBAL_ERROR_RATIO:g} times "
        "that of a fixed one.": moved,
    }


def checks_of(required: Mapping[str, Sequence[Requirement]]) -> tuple[Check, ...]:
    """Every requirement as a check."""
    return tuple(check(r.name, "%", r.ours.percent, r.low, r.high) for each in required.values() for r in each)


def claims_of(required: Mapping[str, Sequence[Requirement]]) -> tuple[Claim, ...]:
    """A claim holds if each of its requirements is met.

    If each miss is less than twice its standard error, it holds only if those misses are chance.
    """
    return tuple(
        Claim(
            claim=claim,
            where="required",
            verdict=verdict(all(r.is_met for r in each), all(r.is_near for r in each)),
            evidence=_evidence(each),
        )
        for claim, each in required.items()
        if each
    )


def _evidence(each: Sequence[Requirement]) -> str:
    little = [_text(r) for r in each if not r.is_met and r.is_near]
    surely = [_text(r) for r in each if not r.is_near]
    return (
        f"{sum(r.is_met for r in each)} of {len(each)} are met. Missed by more than twice the error of sampling: "
        f"{', '.join(surely) or 'none'}; by less: {', '.join(little) or 'none'}."
    )


def _text(r: Requirement) -> str:
    return f"{r.name} {number(r.ours.percent)} ± {number(r.ours.error, 2)} %"
