"""The estimator's assumptions, violated one at a time in every family.

Nothing of a violation is configured. The estimate may be less certain then, but not confidently wrong.
"""

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from simlink.encounters.departures import Departure
from simlink.encounters.families import FAMILIES
from simlink.scenarios.profiles import GaussMarkov
from studies.encounters.flights import DEFAULTS, Case, Flight
from studies.encounters.results import Requirement
from studies.encounters.scores import Score, score
from studies.report.findings import Table

MAX_WRONG_PERCENT: Final = 5.0  # of valid estimates
MIN_INSIDE_PERCENT: Final = 88.0  # of valid estimates
STEADY: Final = ("crossing", "head_on", "loiter")  # whose leaders do not manoeuvre
# Neither leans against the air, nor points its nose anywhere; each has a wind of its own.
HOVERING: Final = ("hover", "circling", "cut", "two_cross")
SLOW: Final = (*HOVERING, "wander")
FIXED_WING: Final = ("crab", "loiter")
ANY_NOSE: Final = (
    "hover",
    "circling",
    "wander",
    "cut",
    "two_cross",
)  # whose leaders' noses point anywhere as it is


class Assumption(NamedTuple):
    """A departure, and the assumptions that it violates."""

    departure: Departure
    # Falsified: names in `onboard/estimators/leader/assumptions.py` or keys of the configuration.
    priors: tuple[str, ...]
    without: tuple[str, ...] = ()


# Families falsify priors by themselves: `leaves_hover` and `stops` how long a leader hovers and flies
# (`hovers_for`, `flies_for`), `straight_sideways` that its nose is on its course (`tied`, `heading`, `on_course`),
# `head_on` its first `speed`, `loiter` that it flies along with us, `cut` that a box is whole, `class_flickers`
# that a class is right, `two_cross` that the image nearest to what is predicted is the leader's.
ASSUMPTIONS: Final[Mapping[str, Assumption]] = {
    "it does not lean against the air": Assumption(Departure(drag=0.0), ("drag", "drag_sigma"), FIXED_WING),
    "drag of 0.5 / s": Assumption(Departure(drag=0.5), ("drag", "drag_sigma"), FIXED_WING),
    "wind of 8 m/s": Assumption(Departure(wind=8.0), ("wind",), FIXED_WING),
    "nose drawn uniformly": Assumption(
        Departure(any_nose=True), ("tied", "heading", "on_course"), (*FIXED_WING, *ANY_NOSE)
    ),
    "size 6 % off": Assumption(Departure(size_off=0.06), ("size_sigma",)),
    "manoeuvres three times as hard": Assumption(
        Departure(vigour=3.0), ("acceleration_random_walk", "hover_speed", "steady_for"), STEADY
    ),
    "bank and nose wobble four times as much": Assumption(Departure(wobble=4.0), ("bank", "nose_wobble")),
    "mount 1 degree off": Assumption(Departure(mount_off_deg=1.0), ("misalignment",)),
    "image noise 3.7 times as large": Assumption(Departure(image_noise=3.7), ("sigma_px",)),
    "image noise correlated over 0.5 s": Assumption(
        Departure(image_noise_time=0.5), ("evidence_rate", "sigma_px")
    ),
    "images stamped 30 ms late": Assumption(Departure(stamp_late=0.03), ("delay_sigma_s",)),
    "errors of our attitude and velocity twice as large": Assumption(
        Departure(own_errors=2.0), ("misalignment", "own_velocity")
    ),
    "errors of our attitude and velocity correlated over 3 s": Assumption(
        Departure(own_errors_time=3.0), ("misalignment_time", "own_velocity_time")
    ),
    # What leaders did that others flew, each at its extreme: quads of four teams, by hand and guided, racers, a
    # tail-sitter, planes, an X8 in loops.
    "its yaw leads its course by 1 s": Assumption(
        Departure(yaw_leads=1.0), ("nose_about_course",), (*STEADY, *SLOW)
    ),
    "its nose swings by 28 degrees": Assumption(Departure(nose_slack_deg=28.0), ("nose_about_course",), HOVERING),
    "its nose turns by up to 0.8 rad/s, 40 % of the time": Assumption(
        Departure(nose_rate=0.8, nose_turns=0.4), ("nose_rate", "still_for", "turns_for"), FIXED_WING
    ),
    "its nose turns by up to 3.1 rad/s, nearly always": Assumption(
        Departure(nose_rate=3.1, nose_turns=0.95), ("nose_rate", "still_for", "turns_for"), FIXED_WING
    ),
    "accelerations of 4 m/s^2": Assumption(Departure(acceleration=4.0), ("acceleration_random_walk",)),
    "accelerations of 9 m/s^2": Assumption(Departure(acceleration=9.0), ("acceleration_random_walk",)),
    "it hovers by hand, 0.57 m/s": Assumption(
        Departure(jitter=0.57), ("hover_speed",), tuple(f for f in FAMILIES if f not in HOVERING)
    ),
    "drag of 0.06 / s": Assumption(Departure(drag=0.06), ("drag", "drag_sigma"), FIXED_WING),
    "drag of 0.28 / s": Assumption(Departure(drag=0.28), ("drag", "drag_sigma"), FIXED_WING),
    "drag of 2.2 / s across a wing that stands": Assumption(
        Departure(sail=2.2), ("drag", "drag_sigma"), tuple(f for f in FAMILIES if f not in SLOW)
    ),
    "its bank is 9 degrees off, for 0.3 s": Assumption(
        Departure(bank=GaussMarkov(sigma=9.0, time=0.3)), ("bank", "bank_time")
    ),
    "white noise of 0.6 degrees in our attitude": Assumption(
        Departure(attitude_white_deg=0.6), ("misalignment", "misalignment_time")
    ),
}
BROKEN: Final = tuple(
    case._replace(departure=assumption.departure)
    for assumption in ASSUMPTIONS.values()
    for case in DEFAULTS
    if case.family not in assumption.without
)


def name_of(case: Case) -> str:
    """Which assumption is false in a case; "" if none is."""
    return next((name for name, a in ASSUMPTIONS.items() if a.departure == case.departure), "")


def table_of(scores: Mapping[Case, Score]) -> Table:
    """One row for each assumption and family."""
    return Table(
        title="One assumption false",
        note=f"As above. Wanted: at most {MAX_WRONG_PERCENT:g} % confidently wrong and at least "
        f"{MIN_INSIDE_PERCENT:g} % inside in each row. What is missing is impossible, or nothing new: a fixed "
        "wing does not lean, a hovering leader's nose points anywhere, and who flies straight or in a circle "
        "does not manoeuvre.",
        header=(
            *("false", "encounter", "flights", "confidently wrong %", "± %", "inside %", "± %"),
            *("range error %", "± %", "sigma of range % (median)", "valid %"),
        ),
        rows=tuple(
            (
                *(name_of(case), case.name, float(s.flights), *s.wrong, *s.inside),
                *(*s.range_error, s.sigma, s.valid.percent),
            )
            for case, s in scores.items()
        ),
    )


def summary_of(astray: Mapping[Case, Sequence[Flight]]) -> Table:
    """One row for each assumption, over all its families together."""
    of_assumption: dict[str, list[Flight]] = {}
    for case, flights in astray.items():
        of_assumption.setdefault(name_of(case), []).extend(flights)
    scores = {name: score(flights) for name, flights in of_assumption.items()}
    return Table(
        title="One assumption false, all families",
        note="The flights of all families together. Priors: what the assumption is called in the settings.",
        header=(
            *("false", "priors", "flights", "confidently wrong %", "± %", "inside %", "± %"),
            *("range error %", "± %", "sigma of range % (median)", "velocity inside %", "± %"),
        ),
        rows=tuple(
            (
                *(name, ", ".join(ASSUMPTIONS[name].priors), float(s.flights), *s.wrong, *s.inside),
                *(*s.range_error, s.sigma, *s.velocity_inside),
            )
            for name, s in scores.items()
        ),
    )


def requirements(scores: Mapping[Case, Score]) -> dict[str, list[Requirement]]:
    """Return the requirements by claim, as in `results.requirements`."""
    wrong, inside = [], []
    for case, s in scores.items():
        which = f"{case.name}, {name_of(case)}"
        wrong.append(Requirement(f"confidently wrong, {which}", s.wrong, high=MAX_WRONG_PERCENT))
        inside.append(Requirement(f"inside, {which}", s.inside, low=MIN_INSIDE_PERCENT))
    return {
        f"With one assumption false, at most {MAX_WRONG_PERCENT:g} % of any family's are confidently "
        "wrong.": wrong,
        f"With one assumption false, {MIN_INSIDE_PERCENT:g} % of any family's ellipsoids hold the truth.": inside,
    }
