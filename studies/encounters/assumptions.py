"""What the estimator assumes, one assumption false at a time: every family flown again, with nothing configured of
it. The estimate may be vaguer then; it must not be confidently wrong.
"""

from collections.abc import Mapping
from typing import Final, NamedTuple

from simlink.encounters.departures import Departure
from simlink.encounters.families import FAMILIES
from studies.encounters.flights import Case
from studies.encounters.results import Requirement
from studies.encounters.scores import Score
from studies.report.findings import Table

WRONG: Final = 5.0  # percent of valid estimates, at most
STRAIGHT: Final = ("crossing", "head_on")  # whose leaders do not manoeuvre
FIXED_WING: Final = ("crab",)  # neither leans against the air, nor points its nose anywhere; has a wind of its own
ANY_NOSE: Final = ("hover", "circling", "wander")  # whose leaders' noses point anywhere as it is


class Assumption(NamedTuple):
    """What is different, and the families for which that is nothing new, or impossible."""

    departure: Departure
    without: tuple[str, ...] = ()


ASSUMPTIONS: Final[Mapping[str, Assumption]] = {
    "it does not lean against the air": Assumption(Departure(drag=0.0), FIXED_WING),
    "twice the drag": Assumption(Departure(drag=2.0), FIXED_WING),
    "wind of 8 m/s": Assumption(Departure(wind=8.0), FIXED_WING),
    "nose drawn uniformly": Assumption(Departure(any_nose=True), (*FIXED_WING, *ANY_NOSE)),
    "size 6 % off": Assumption(Departure(size_off=0.06)),
    "manoeuvres three times as hard": Assumption(Departure(vigour=3.0), STRAIGHT),
    "mount 1 degree off": Assumption(Departure(mount_off_deg=1.0)),
    "image noise 3.7 times as large": Assumption(Departure(image_noise=3.7)),
    "errors of our attitude and velocity twice as large": Assumption(Departure(own_errors=2.0)),
}
BROKEN: Final = tuple(
    Case(family, departure=assumption.departure)
    for assumption in ASSUMPTIONS.values()
    for family in FAMILIES
    if family not in assumption.without
)


def name_of(case: Case) -> str:
    """Which assumption is false in a case; "" if none is."""
    return next((name for name, a in ASSUMPTIONS.items() if a.departure == case.departure), "")


def table_of(scores: Mapping[Case, Score]) -> Table:
    """One row for each assumption and family."""
    return Table(
        title="One assumption false",
        note=f"As above. Wanted: at most {WRONG:g} % confidently wrong in each row. What is missing is impossible,"
        " or nothing new: a fixed wing does not lean, a hovering leader's nose points anywhere, and who flies"
        " straight does not manoeuvre.",
        header=(
            *("false", "encounter", "flights", "confidently wrong %", "± %", "inside %", "± %"),
            *("range error %", "± %", "sigma of range % (median)", "valid %"),
        ),
        rows=tuple(
            (
                *(name_of(case), case.family.replace("_", " "), float(s.flights), *s.wrong, *s.inside),
                *(*s.range_error, s.sigma, s.valid.percent),
            )
            for case, s in scores.items()
        ),
    )


def requirements(scores: Mapping[Case, Score]) -> dict[str, list[Requirement]]:
    """What is required, by claim, as of `results.requirements`."""
    wrong = [
        Requirement(f"confidently wrong, {case.name}, {name_of(case)}", s.wrong, high=WRONG)
        for case, s in scores.items()
    ]
    return {f"With one assumption false, at most {WRONG:g} % of any family's are confidently wrong.": wrong}
