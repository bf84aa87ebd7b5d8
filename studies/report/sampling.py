"""What runs can decide: a statistic beside a bound, with its error of sampling. Three outcomes: True, False, and
None where the runs are too few or their scatter too large. Studies combine them with `all_of` and `any_of`, and
`findings.verdict` puts them into words.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Final

import numpy as np
from msgspec.structs import replace
from scipy.special import stdtrit

from onboard.arrays import Array
from studies.report.findings import Claim, Findings, Outcome

WRONG: Final = 0.005  # chance of each wrong decision, where errors are normal
FEWEST: Final = 5  # runs whose scatter says how far off their mean may be
ENOUGH: Final = 10  # runs that show what happens in a quarter of all, but for one time in twenty


def all_of(outcomes: Iterable[Outcome]) -> Outcome:
    """Whether all are true: one that is false decides, one that is not decided leaves it open."""
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
    """Whether the mean is below a limit, from one value of each run: by Student's t. A value that is not finite,
    as of a run that failed, is below nothing."""
    x = np.asarray(values, float)
    if x.size < FEWEST:
        return None
    if not np.isfinite(x).all():
        return False
    error = float(stdtrit(x.size - 1, 1.0 - WRONG)) * float(np.std(x, ddof=1)) / math.sqrt(x.size)
    off = float(np.mean(x)) - limit
    if off == 0.0:
        return False
    return off < 0.0 if abs(off) > error else None


def rms_below(values: Sequence[float] | Array, limit: float) -> Outcome:
    """Whether the root mean square over runs is below a limit."""
    return below(np.square(np.asarray(values, float)), limit * limit)


def rms_less(ours: Mapping[int, float], others: Mapping[int, float], factor: float = 1.0) -> Outcome:
    """Whether ours, by seed, has a root mean square below `factor` times that of others: by the differences of
    squares of the seeds that both have flown."""
    both = [seed for seed in ours if seed in others]
    a, b = (np.array([values[seed] for seed in both]) for values in (ours, others))
    return below(a * a - factor * factor * b * b)


def at_most(count: int, runs: int, share: float) -> Outcome:
    """Whether something happens in at most this share of runs, after `count` of `runs`. More is refuted only if so
    many would be improbable (binomial); for no more, there must be runs enough for one to be expected."""
    if count > share * runs:
        return False if _tail(count, runs, share) < WRONG else None
    return True if runs >= ENOUGH and runs * share > 1.0 - 1e-9 else None


def none(count: int, runs: int, enough: int = ENOUGH) -> Outcome:
    """Whether something happens never: once refutes it, and `enough` runs without it must do."""
    return False if count else True if runs >= enough else None


def at_least(count: int, runs: int, share: float) -> Outcome:
    """Whether something happens in at least this share of runs."""
    return at_most(runs - count, runs, 1.0 - share)


def rarer(count: int, time: float, rate: float) -> Outcome:
    """Whether something happens less often than `rate`, after `count` times in a `time` (Poisson)."""
    expected = rate * time
    fewer = sum(math.exp(-expected) * expected**k / math.factorial(k) for k in range(count))
    exactly = math.exp(-expected) * expected**count / math.factorial(count)
    if 1.0 - fewer < WRONG:
        return False
    return True if fewer + exactly < 0.05 else None


def inside(value: float, low: float, high: float, runs: int) -> Outcome:
    """Whether a statistic is inside the bounds of a right one's, which are wider the fewer the runs: few show only
    that it is not."""
    if not low <= value <= high:
        return False if runs >= FEWEST else None
    return True if runs >= ENOUGH else None


def decided(found: Findings, least: int) -> Findings:
    """Findings whose figures are not known run by run: with fewer seeds than `least` the claims are not decided,
    but for those that no run enters."""
    if found.seeds >= least:
        return found
    return replace(found, claims=tuple([_open(c, found.seeds, least) if c.sampled else c for c in found.claims]))


def _open(claim: Claim, seeds: int, least: int) -> Claim:
    evidence = f"{claim.evidence.rstrip('.')}. Not decided: {seeds} of at least {least} seeds."
    return replace(claim, verdict="not decided", evidence=evidence)


def _tail(count: int, runs: int, share: float) -> float:
    """The probability of at least `count` of `runs`."""
    return sum(math.comb(runs, k) * share**k * (1.0 - share) ** (runs - k) for k in range(count, runs + 1))
