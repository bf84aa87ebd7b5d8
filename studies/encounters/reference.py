"""Estimates beside a reference posterior: the same encounter, the same bytes and the same model, with 20,000
particles for 900. Where the reference errs as much, the geometry or the model leaves the range open, not too few
particles. A test holds the model to an independent particle filter.
"""

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np

from studies.encounters.flights import DEFAULTS, IN_WIND, WITH_CENTER, Case, Flight
from studies.encounters.scores import score
from studies.report.findings import Check, Claim, Table, check, verdict

PARTICLES: Final = 20_000
SETTINGS: Final = (f"estimator.leader.particles={PARTICLES}",)
COMPARED: Final = (*DEFAULTS, *WITH_CENTER, *IN_WIND)
MOST: Final = 1.5  # times the reference's sigma, and as many times less


class Pair(NamedTuple):
    """One encounter, flown as it ships and by the reference."""

    ours: Flight
    reference: Flight


def sigma_ratio(pair: Pair) -> float:
    """The median, over the times at which both are valid, of our standard deviation of the range over the
    reference's, each as a share of its own range; NaN without such a time."""
    ours, reference = pair
    _, a, b = np.intersect1d(ours.t, reference.t, return_indices=True)
    ratios = (ours.sigma[a] / ours.range_[a]) / (reference.sigma[b] / reference.range_[b])
    known = ratios[np.isfinite(ratios)]
    return float(np.median(known)) if len(known) else float("nan")


def checks_of(pairs: Mapping[Case, Sequence[Pair]]) -> tuple[Check, ...]:
    """The ratio of each case, that of the median flight."""
    return tuple(
        check(f"sigma beside the reference, {case.name}", "times", _median(each), 1.0 / MOST, MOST)
        for case, each in pairs.items()
    )


def claims_of(checks: Sequence[Check]) -> tuple[Claim, ...]:
    """That no case is much surer or less sure than the reference; nothing where none was flown."""
    missed = [c.name for c in checks if not c.agrees]
    claim = Claim(
        claim=f"Nowhere is the range {MOST:g} times surer than that of {PARTICLES:,} particles, or less sure.",
        where="required",
        verdict=verdict(not missed),
        evidence=f"{len(checks) - len(missed)} of {len(checks)} are met; not: {', '.join(missed) or 'none'}.",
    )
    return (claim,) if checks else ()


def table_of(pairs: Mapping[Case, Sequence[Pair]]) -> Table:
    """One row for each case."""
    return Table(
        title=f"Beside {PARTICLES:,} particles",
        note="Ratio: our sigma of the range over the reference's, each as a share of its range: the median of a "
        "flight, then of these the median, least and greatest. Range errors are RMS over valid estimates, sigmas "
        "medians.",
        header=(
            *("encounter", "flights", "ratio", "least", "greatest"),
            *("sigma of range %", "reference %", "range error %", "reference %", "inside %", "reference %"),
        ),
        rows=tuple(_row(case, each) for case, each in pairs.items()),
    )


def _row(case: Case, each: Sequence[Pair]) -> tuple[str | float, ...]:
    ratios = [sigma_ratio(pair) for pair in each]
    ours, reference = score([p.ours for p in each]), score([p.reference for p in each])
    return (
        *(case.name, float(len(each)), _median(each), min(ratios), max(ratios)),
        *(ours.sigma, reference.sigma, ours.range_error.percent, reference.range_error.percent),
        *(ours.inside.percent, reference.inside.percent),
    )


def _median(each: Sequence[Pair]) -> float:
    return float(np.median([sigma_ratio(pair) for pair in each]))
