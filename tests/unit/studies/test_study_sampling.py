"""Verdicts know their error of sampling: few runs decide nothing, many decide, and neither says the opposite."""

import numpy as np
import pytest

from studies.cwpa_kalman_tracker_3d import study as cwpa
from studies.report.findings import Outcome, verdict
from studies.report.sampling import (
    MIN_RUN_COUNT,
    all_of,
    any_of,
    at_least,
    at_most,
    below,
    inside,
    negated,
    none,
    rarer,
    rms_below,
    rms_less,
)


@pytest.mark.parametrize(
    ("holds", "only_if", "expected"),
    [
        (True, None, "holds"),
        (None, True, "not decided"),
        (None, False, "not decided"),
        (False, None, "not decided"),
        (False, True, "holds only if"),
        (False, False, "does not hold"),
    ],
)
def test_verdicts_of_three_outcomes(holds: Outcome, only_if: Outcome, expected: str) -> None:
    assert verdict(holds, only_if) == expected


def test_outcomes_are_combined_without_losing_what_is_open() -> None:
    assert [all_of(x) for x in ([], [True], [True, None], [None, False])] == [True, True, None, False]
    assert [any_of(x) for x in ([], [False], [False, None], [None, True])] == [False, False, None, True]
    assert [negated(x) for x in (True, False, None)] == [False, True, None]


@pytest.mark.parametrize("off", [-1.0, -0.1, 0.1, 1.0])
def test_a_mean_is_hardly_ever_decided_wrongly_and_many_runs_decide_it_seed_51(off: float) -> None:
    rng = np.random.default_rng(51)
    few, many = ([below(rng.normal(off, 1.0, n)) for _ in range(500)] for n in (MIN_RUN_COUNT, 2000))
    assert few.count(off > 0.0) <= 10  # 0.5 % of them are expected
    assert many.count(off < 0.0) >= 450
    assert (off > 0.0) not in many


def test_below_five_runs_nothing_is_decided_and_a_failed_run_is_below_nothing() -> None:
    assert below([0.0] * (MIN_RUN_COUNT - 1), 1.0) is None
    assert below([0.0] * MIN_RUN_COUNT, 1.0) is True
    assert below([0.0] * MIN_RUN_COUNT + [np.nan], 1.0) is False


def test_errors_of_the_same_flights_are_compared_by_their_differences_seed_52() -> None:
    """What the flights have in common, and what only one has flown, does not count."""
    flights = np.random.default_rng(52).uniform(1.0, 10.0, 20)
    ours = dict(enumerate(0.94 * flights))
    theirs = dict(enumerate(flights)) | {99: 1e9}
    assert rms_less(ours, theirs) is True
    assert rms_less(theirs, ours) is False
    assert rms_less(ours, theirs, 0.94 + 1e-9) is True
    assert rms_below(list(ours.values()), 6.0) is None


def test_shares_of_runs() -> None:
    assert [none(0, n) for n in (2, 10)] == [None, True]
    assert none(1, 2) is False
    assert [at_most(0, n, 0.02) for n in (10, 50)] == [None, True]
    assert [at_most(k, 50, 0.02) for k in (1, 2, 20)] == [True, None, False]
    assert [at_least(n, n, 0.9) for n in (2, 10)] == [None, True]
    assert at_least(2, 10, 0.9) is False


def test_rates_and_bounds_of_a_right_filter() -> None:
    assert [rarer(0, hours, 1.0) for hours in (0.5, 4.0)] == [None, True]
    assert rarer(9, 2.0, 1.0) is False
    assert [inside(9.0, 8.0, 10.0, n) for n in (2, 10)] == [None, True]
    assert [inside(2.0, 8.0, 10.0, n) for n in (2, 10)] == [None, False]


@pytest.mark.parametrize("seeds", [1, 2])
def test_a_study_of_few_seeds_never_says_the_opposite(seeds: int) -> None:
    """The fourth claim is about two series, which no run enters."""
    found = cwpa.run(seeds=seeds, jobs=1)
    assert [c.verdict for c in found.claims] == [*["not decided"] * 3, "does not hold"]
    assert all(
        f"Not decided: {seeds} of at least {cwpa.MIN_SEED_COUNT} seeds." in c.evidence for c in found.claims[:3]
    )
