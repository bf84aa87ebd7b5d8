"""Estimates beside a reference posterior: ratios and verdicts on flights made up by hand, and one flown."""

from collections.abc import Mapping, Sequence

import numpy as np
import pytest

from onboard.arrays import Array
from onboard.config import load_config
from studies.encounters import flights as flown
from studies.encounters import reference, study
from studies.encounters.flights import DEFAULTS, Case, Flight
from studies.encounters.reference import COMPARED, MAX_SIGMA_RATIO, Pair, sigma_ratio

TIMES: Array = np.arange(5.0, 9.0, 0.1)
CLAIM = "Nowhere is the range 1.5 times surer than that of 20,000 particles, or less sure."


def made(share: float, range_: float = 20.0, times: Array = TIMES) -> Flight:
    """A flight at 20 m, estimated at `range_` with a sigma of `share` of that."""
    ones = np.ones(len(times))
    return Flight(times, 20.0 * ones, range_ * ones, share * range_ * ones, 2.0 * ones)


def test_the_ratio_is_of_relative_sigmas_at_times_when_both_are_valid() -> None:
    ours, other = made(0.03, range_=10.0, times=TIMES[5:]), made(0.02)
    assert sigma_ratio(Pair(ours, other)) == pytest.approx(1.5)
    ours.range_[3:20] = ours.sigma[3:20] = np.nan
    other.sigma[:30] = np.nan
    other.sigma[30:] *= 2.0
    assert sigma_ratio(Pair(ours, other)) == pytest.approx(0.75)
    other.sigma[:] = np.nan
    assert np.isnan(sigma_ratio(Pair(ours, other)))


@pytest.mark.parametrize(
    ("shares", "expected"),
    [
        ([0.02, 0.02, 0.09], "holds"),  # the median flight counts
        ([0.02, 0.031, 0.031], "does not hold"),  # much less sure
        ([0.013, 0.013, 0.02], "does not hold"),  # much surer
        ([0.029, 0.029, 0.029], "holds"),
        ([0.0135, 0.0135, 0.0135], "holds"),
        ([float("nan")] * 3, "does not hold"),
    ],
)
def test_one_case_with_another_sigma_decides(shares: Sequence[float], expected: str) -> None:
    ours = {case: [made(0.02)] * 5 for case in COMPARED} | {Case("crab"): [made(share) for share in shares]}
    references: Mapping[Case, Sequence[Flight]] = {case: [made(0.02)] * 3 for case in COMPARED}
    found = study.findings(ours, 1, (), references)
    assert found.claims[-1].claim == CLAIM
    assert found.claims[-1].verdict == expected
    missed = [c.name for c in found.checks if "reference" in c.name and not c.agrees]
    assert missed == ([] if expected == "holds" else ["sigma beside the reference, crab"])
    assert len(found.tables[3].rows) == len(COMPARED)


def test_an_encounter_is_flown_by_the_reference_too_seed_1(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(flown, "DURATION_S", 5.0)
    monkeypatch.setattr(reference, "SETTINGS", ("estimator.leader.particles=200",))
    found = study.run(1, 1, 1, cases=[Case("hover")], compared=1)
    (row,) = found.tables[2].rows
    assert row[:2] == ("hover", 1.0)
    assert all(
        1.0 / MAX_SIGMA_RATIO < c.ours < MAX_SIGMA_RATIO and c.ours != 1.0
        for c in found.checks
        if "reference" in c.name
    )


def test_every_family_is_compared() -> None:
    assert set(DEFAULTS) < set(COMPARED)
    leader = load_config(None, reference.SETTINGS).estimator["leader"]
    assert leader.particles == reference.PARTICLES >= 20_000
