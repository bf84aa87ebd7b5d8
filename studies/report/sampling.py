"""Decisions from a finite number of runs: a statistic, a bound, and the sampling error.

There are three outcomes: True, False, and None if the runs are too few or their scatter too large. Studies combine
them with `all_of` and `any_of`, and `findings.verdict` puts them into words.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Final

import numpy as np
from msgspec.structs import replace
from scipy.special import stdtrit

from onboard.arrays import Array
from studies.report.findings import Claim, Findings, Outcome

ERROR_PROBABILITY: Final = 0.005  # of each wrong decision, where errors are normal
MIN_RUN_COUNT: Final = 5  # their scatter says how far off their mean may be
DECISIVE_RUN_COUNT: Final = 10  # they show what happens in a quarter of all runs, but for one time in twenty


def all_of(outcomes: Iterable[Outcome]) -> Outcome:
    """Return False if any is false, otherwise None if any is undecided, otherwise True."""
    every = list(outcomes)
    if False in every:
        return False
    return None if None in every else True


def any_of(outcomes: Iterable[Outcome]) -> Outcome:
    """Whether any is true."""
    return negated(all_of(map(negated, outcomes)))


def negated(outcome: Outcome) -> Outcome:
    """The opposite; what is not decided stays so."""
    return None if outcome is None else not outcome


def below(values: Sequence[float] | Array, limit: float = 0.0) -> Outcome:
    """Whether the mean is below a limit, from one value of each run: by Student's t.

    A value that is not finite, as of a run that failed, is below nothing.
    """
    x = np.asarray(values, float)
    if x.size < MIN_RUN_COUNT:
        return None
    if not np.isfinite(x).all():
        return False
    error = float(stdtrit(x.size - 1, 1.0 - ERROR_PROBABILITY)) * float(np.std(x, ddof=1)) / math.sqrt(x.size)
    off = float(np.mean(x)) - limit
    if off == 0.0:
        return False
    return off < 0.0 if abs(off) > error else None


def rms_below(values: Sequence[float] | Array, limit: float) -> Outcome:
    """Whether the root mean square over runs is below a limit."""
    return below(np.square(np.asarray(values, float)), limit * limit)


def rms_less(ours: Mapping[int, float], others: Mapping[int, float], factor: float = 1.0) -> Outcome:
    """Whether ours, by seed, has an RMS below `factor` times that of others.

    The decision uses the differences of squares of the seeds that both have flown.
    """
    both = [seed for seed in ours if seed in others]
    a, b = (np.array([values[seed] for seed in both]) for values in (ours, others))
    return below(a * a - factor * factor * b * b)


def at_most(count: int, runs: int, share: float) -> Outcome:
    """Return whether something happens in at most this share of runs, after `count` of `runs`.

    It is False only if `count` would be improbable at this share (binomial), and True only if enough runs were
    flown to expect one case.
    """
    if count > share * runs:
        return False if _tail(count, runs, share) < ERROR_PROBABILITY else None
    return True if runs >= DECISIVE_RUN_COUNT and runs * share > 1.0 - 1e-9 else None


def none(count: int, runs: int, enough: int = DECISIVE_RUN_COUNT) -> Outcome:
    """Whether something happens never: once refutes it, and `enough` runs without it must do."""
    return False if count else True if runs >= enough else None


def at_least(count: int, runs: int, share: float) -> Outcome:
    """Whether something happens in at least this share of runs."""
    return at_most(runs - count, runs, 1.0 - share)


def rarer(count: int, time: float, rate: float) -> Outcome:
    """Whether an event is rarer than `rate`, after `count` times in a `time` (Poisson)."""
    expected = rate * time
    fewer = sum(math.exp(-expected) * expected**k / math.factorial(k) for k in range(count))
    exactly = math.exp(-expected) * expected**count / math.factorial(count)
    if 1.0 - fewer < ERROR_PROBABILITY:
        return False
    return True if fewer + exactly < 0.05 else None


def inside(value: float, low: float, high: float, runs: int) -> Outcome:
    """Whether a statistic is inside the bounds of a correct one, which are wider with fewer runs.

    Few runs can show only that it is not.
    """
    if not low <= value <= high:
        return False if runs >= MIN_RUN_COUNT else None
    return True if runs >= DECISIVE_RUN_COUNT else None


def decided(found: Findings, least: int) -> Findings:
    """Return the findings with claims undecided if fewer than `least` seeds were flown.

    Claims without runs are excepted, and findings with figures by run.
    """
    if found.seeds >= least:
        return found
    return replace(found, claims=tuple([_open(c, found.seeds, least) if c.sampled else c for c in found.claims]))


def _open(claim: Claim, seeds: int, least: int) -> Claim:
    evidence = f"{claim.evidence.rstrip('.')}. Not decided: {seeds} of at least {least} seeds."
    return replace(claim, verdict="not decided", evidence=evidence)


def _tail(count: int, runs: int, share: float) -> float:
    """The probability of at least `count` of `runs`."""
    return sum(math.comb(runs, k) * share**k * (1.0 - share) ** (runs - k) for k in range(count, runs + 1))
