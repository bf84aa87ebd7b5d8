"""Estimates compared with a reference posterior of 20,000 particles instead of 900.

Encounter, bytes and model are the same. Equal errors of the reference show that geometry or model leave the range
uncertain, not too few particles. A test compares the model with an independent particle filter.
"""

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np

from studies.encounters.flights import DEFAULTS, WITH_CENTER, Case, Flight
from studies.encounters.scores import score
from studies.report.findings import Check, Claim, Table, check, verdict

PARTICLES: Final = 20_000
SETTINGS: Final = (f"estimator.leader.particles={PARTICLES}",)
COMPARED: Final = (*DEFAULTS, *WITH_CENTER)
MAX_SIGMA_RATIO: Final = 1.5  # to the reference's sigma, and its inverse is the smallest


class Pair(NamedTuple):
    """One encounter, flown as it ships and by the reference."""

    ours: Flight
    reference: Flight


def sigma_ratio(pair: Pair) -> float:
    """Return the median ratio of our range sigma to the reference's, each relative to its own range.

    It is over the times at which both are valid, NaN without any.
    """
    ours, reference = pair
    _, a, b = np.intersect1d(ours.t, reference.t, return_indices=True)
    ratios = (ours.sigma[a] / ours.range_[a]) / (reference.sigma[b] / reference.range_[b])
    known = ratios[np.isfinite(ratios)]
    return float(np.median(known)) if len(known) else float("nan")


def checks_of(pairs: Mapping[Case, Sequence[Pair]]) -> tuple[Check, ...]:
    """The ratio of each case, that of the median flight."""
    return tuple(
        check(
            f"sigma beside the reference, {case.name}",
            "times",
            _median(each),
            1.0 / MAX_SIGMA_RATIO,
            MAX_SIGMA_RATIO,
        )
        for case, each in pairs.items()
    )


def claims_of(checks: Sequence[Check]) -> tuple[Claim, ...]:
    """Return the claim that no case is much more or less certain than the reference."""
    missed = [c.name for c in checks if not c.agrees]
    claim = Claim(
        claim=f"Nowhere is the range {MAX_SIGMA_RATIO:g} times surer than that of {PARTICLES:,} particles, "
        "or less sure.",
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
