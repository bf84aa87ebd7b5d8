"""How good a filter was: errors against a truth, and whether its covariances say how large they are.

    nis(found).inside, nees(found.beliefs, truth), rms(found.beliefs, truth, states=(0, 1))    # of a run, or a
    batch

NEES is the squared error in units of the covariance, and NIS the same of the innovation: on average the number of
states, and of measured components. Below the bounds a filter is too pessimistic, above them too sure. Runs are
independent, so a batch has narrow bounds at each time; the innovations of one run are, too, its errors are not.
"""

from typing import NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.filters.belief import Belief, FilterError
from onboard.filters.gating import chi_square_threshold, normalised_squared
from onboard.filters.runs import Run


class Consistency(NamedTuple):
    """At each time the mean (T,) over the runs, what is expected (T,), and the bounds (T,) that hold it with the
    probability that was asked for; NaN where nothing was measured. `inside`: the share of times within the
    bounds."""

    mean: Array
    expected: Array
    low: Array
    high: Array
    inside: float


def nees(beliefs: Belief, truth: Array, probability: float = 0.95) -> Consistency:
    """Normalised estimation error squared of beliefs, mean (T, n) or (T, B, n), against a truth of the same
    shape."""
    errors = _errors(beliefs, truth)
    each = normalised_squared(
        errors.reshape(-1, errors.shape[-1]), beliefs.covariance.reshape(-1, *_square(errors))
    )
    return _judged(each.reshape(len(errors), -1), np.full(errors.shape[:-1], errors.shape[-1]), probability)


def nis(found: Run, probability: float = 0.95) -> Consistency:
    """Normalised innovation squared of a run, or of a batch."""
    return _judged(found.nis.reshape(len(found.ts), -1), found.degrees, probability)


def rms(beliefs: Belief, truth: Array, states: tuple[int, ...] | None = None) -> Array:
    """Root mean square (T,) over the runs of the length of the error in these states, by default in all."""
    errors = _errors(beliefs, truth)
    chosen = errors if states is None else errors[..., list(states)]
    squared: Array = np.sum(chosen**2, axis=-1).reshape(len(errors), -1)
    return np.asarray(np.sqrt(np.mean(squared, axis=1)))


def _judged(values: Array, degrees: Array, probability: float) -> Consistency:
    total, runs = degrees.reshape(len(values), -1).sum(axis=1), values.shape[1]
    tail, bounds = 0.5 * (1 - probability), np.full((2, len(values)), np.nan)
    for count in np.unique(total[total > 0]):
        at = total == count
        bounds[:, at] = np.array([[chi_square_threshold(p, int(count)) / runs] for p in (tail, 1 - tail)])
    mean = np.where(total > 0, values.mean(axis=1), np.nan)
    measured = total > 0
    inside = (mean >= bounds[0]) & (mean <= bounds[1])
    share = float(np.mean(inside[measured])) if measured.any() else float("nan")
    return Consistency(mean, np.where(measured, total / runs, np.nan), bounds[0], bounds[1], share)


def _errors(beliefs: Belief, truth: Array) -> Array:
    if np.shape(truth) != beliefs.mean.shape:
        raise FilterError(f"truth: must have the shape of the means, {beliefs.mean.shape}, not {np.shape(truth)}")
    return np.asarray(beliefs.mean - truth)


def _square(errors: Array) -> tuple[int, int]:
    return errors.shape[-1], errors.shape[-1]
