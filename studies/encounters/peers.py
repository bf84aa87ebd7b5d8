"""Our estimate and the bearing-angle filter's on the same boxes around a quadrotor.

The size is known, or unknown to half of it, while we sway, circle or fly behind.
"""

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np

from simlink.encounters.conditions import NOMINAL_SIZE
from simlink.encounters.departures import Departure
from simlink.encounters.encounter import make_encounter
from studies.encounters import flights
from studies.encounters.bearing_angle import flown
from studies.encounters.flights import Case, Flight
from studies.encounters.results import Requirement
from studies.encounters.scores import score
from studies.report.findings import Table

UNKNOWN_SIZE_SIGMA: Final = 0.5  # of the supposed size, as a fraction of it
UNKNOWN_SIZE_ERROR: Final = 0.4  # of the supposed size to either side, as a fraction of it
KNOWN_SIZE_SIGMA: Final = 0.02  # of a size that is known, as a fraction of it
LASTING_SIZE_SIGMA: Final = (
    0.1  # of boxes, and of a square of rotors in place of a circle, as a fraction of the size
)
APPARENT_WIDTH_RATIO: Final = 1.15  # a quadrotor's mean width from all sides to that over its rotors
MIN_INSIDE_PERCENT: Final = 90.0  # of our valid estimates
MAX_RANGE_ERROR_RATIO: Final = 1.1  # ours to the other's

_SETTINGS: Final = (f"estimator.leader.size_prior_sigma_m={UNKNOWN_SIZE_SIGMA * NOMINAL_SIZE}",)
WAYS: Final[Mapping[str, tuple[str, float]]] = {
    "we sway by 3 m": ("hover", 3.0),
    "we circle": ("circling", 0.0),
    "we fly behind": ("behind", 0.0),
}
BESIDE: Final[Mapping[str, Case]] = {
    f"{way}, size {size}": Case(
        family, settings, "rotor_box", departure=Departure(size_off=off if off else None, sway=sway)
    )
    for way, (family, sway) in WAYS.items()
    for size, settings, off in (("known", (), 0.0), ("unknown to 50 %", _SETTINGS, UNKNOWN_SIZE_ERROR))
}


class Pair(NamedTuple):
    """One encounter by our estimate, and by the bearing-angle filter."""

    ours: Flight
    other: Flight


def fly(case: Case, seed: int, settings: Sequence[str] = ()) -> Pair:
    """One encounter by both; `settings` are overrides of ours."""
    encounter = make_encounter(case.family, seed, flights.DURATION_S, case.sees, departure=case.departure)
    share = float(np.hypot(UNKNOWN_SIZE_SIGMA if case.settings else KNOWN_SIZE_SIGMA, LASTING_SIZE_SIGMA))
    size = APPARENT_WIDTH_RATIO * NOMINAL_SIZE
    return Pair(flights.fly(case, seed, settings), flown(encounter, size, share * size))


def table_of(pairs: Mapping[str, Sequence[Pair]]) -> Table:
    """One row for each way and size."""
    return Table(
        title="Boxes around a quadrotor, beside the bearing-angle filter",
        note=f"Ours, then the filter of `bearing_angle`. An unknown size is {100 * UNKNOWN_SIZE_ERROR:g} % off. "
        "NEES: of the position, the mean over its freedom of 3.",
        header=(
            *("encounter", "flights", "range error %", "± %", "inside %", "± %", "NEES / 3"),
            *("theirs: range error %", "± %", "inside %", "± %", "NEES / 3"),
        ),
        rows=tuple(
            (name, float(len(each)), *_figures(each, 0), *_figures(each, 1)) for name, each in pairs.items()
        ),
    )


def requirements(pairs: Mapping[str, Sequence[Pair]]) -> dict[str, list[Requirement]]:
    """Return the requirements by claim, as in `results.requirements`."""
    scores = {
        name: (score([p.ours for p in each]), score([p.other for p in each])) for name, each in pairs.items()
    }
    errors = [
        Requirement(
            f"range error, {name}", ours.range_error, high=MAX_RANGE_ERROR_RATIO * other.range_error.percent
        )
        for name, (ours, other) in scores.items()
    ]
    inside = [
        Requirement(f"inside, {name}", ours.inside, low=MIN_INSIDE_PERCENT) for name, (ours, _) in scores.items()
    ]
    return {
        f"Around a quadrotor, the range error is at most {MAX_RANGE_ERROR_RATIO:g} times the bearing-angle "
        "filter's.": errors,
        f"There, the 95 % ellipsoid holds the truth in {MIN_INSIDE_PERCENT:g} % of valid estimates.": inside,
    }


def _figures(pairs: Sequence[Pair], which: int) -> tuple[float, ...]:
    each = [pair[which] for pair in pairs]
    found = score(each)
    return *found.range_error, *found.inside, float(np.mean([np.nanmean(f.nees) for f in each])) / 3.0
