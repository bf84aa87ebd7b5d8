"""Quality of a filter: errors against a truth, and consistency of its covariances.

    nis(found).inside, nees(found.beliefs, truth), rms(found.beliefs, truth, states=(0, 1))    # of a run, or a
    batch

NEES is the squared error in units of the covariance, and NIS the same for the innovation: on average the number of
states, and of measured components. Below the bounds a filter is too pessimistic, above them overconfident. Runs
are independent, so a batch has narrow bounds at each time; so are the innovations of one run, but not its errors.

Errors of angles wrap. A `Run` in place of its beliefs determines which states are angles; for beliefs alone they
are given, `angular_states=(2,)`. A filter of a batch that was lost does not count.
"""

from typing import Any, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.filters import extended
from onboard.filters.angles import beside
from onboard.filters.belief import Belief, FilterError, Indices
from onboard.filters.gating import chi_square_threshold, normalised_squared
from onboard.filters.runs import Run
from onboard.filters.state_space import AnyModel, model_at, seconds


class ConsistencyBounds(NamedTuple):
    """A consistency statistic over time; NaN where nothing was measured.

    Attributes
    ----------
    mean : (T,)
        Mean over the runs that measured and are not lost.
    expected : (T,)
        Its expectation.
    low, high : (T,)
        Bounds that contain it with the requested probability.
    inside
        Share of times within the bounds.
    """

    mean: Array
    expected: Array
    low: Array
    high: Array
    inside: float


def nees(
    beliefs: Belief | Run, truth: Array, probability: float = 0.95, angular_states: Indices | None = None
) -> ConsistencyBounds:
    """Return the normalised estimation error squared of beliefs.

    Parameters
    ----------
    beliefs
        A run, or beliefs with mean (T, n) or (T, B, n).
    truth : (T, n) or (T, B, n)
        True states.
    probability
        Probability of the bounds.
    angular_states
        Indices of states that are angles; by default those of the run.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    """
    error, n = errors(beliefs, truth, angular_states), np.shape(truth)[-1]
    known: Any = np.isfinite(error).all(axis=-1)
    P = np.where(known[..., None, None], of_run(beliefs).covariance, np.eye(n))
    each = normalised_squared(np.where(known[..., None], error, 0).reshape(-1, n), P.reshape(-1, n, n))
    return _bounds(each.reshape(len(error), -1), n * known, probability)


def nis(found: Run, probability: float = 0.95) -> ConsistencyBounds:
    """Return the normalised innovation squared of a run or of a batch."""
    return _bounds(found.nis.reshape(len(found.ts), -1), found.degrees, probability)


def rms(
    beliefs: Belief | Run,
    truth: Array,
    states: tuple[int, ...] | None = None,
    angular_states: Indices | None = None,
) -> Array:
    """Return the root mean square error (T,) over the runs; NaN where no run is left.

    Parameters
    ----------
    beliefs, truth, angular_states
        As in `nees`.
    states
        Indices of the states whose error is measured, as the length of a vector; by default all.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    """
    error = errors(beliefs, truth, angular_states)
    chosen = error if states is None else error[..., list(states)]
    squared: Array = np.sum(chosen**2, axis=-1).reshape(len(error), -1)
    known = np.isfinite(squared)
    count = known.sum(axis=1)
    mean = np.where(known, squared, 0).sum(axis=1) / np.maximum(count, 1)
    return np.asarray(np.where(count, np.sqrt(mean), np.nan))


def cramer_rao(model: AnyModel, start: Belief, truth: Array, ts: Array | None = None) -> Array:
    """Return the Cramer-Rao bound of a path, the least covariance of an unbiased estimate.

    Q, R and the prior are counted, and models are linearised at the truth. For a random path, average over many
    truths. No mode of an `imm`, and no angle, may be uncertain.

    Parameters
    ----------
    model
        The model, see `runs`.
    start
        First belief, of covariance (n, n) or (..., n, n).
    truth : (T, ..., n)
        The path.
    ts : (T,)
        Times; by default 0, 1, ...

    Returns
    -------
    Array
        Covariances (T, ..., n, n).

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    NotPositiveDefiniteError
        If a covariance is not positive definite, or not finite.

    References
    ----------
    J. H. Taylor, The Cramer-Rao estimation error lower bound computation for deterministic nonlinear systems,
    1979.
    """
    truth = np.asarray(truth)
    times = np.arange(float(len(truth))) if ts is None else seconds(ts)
    P = np.broadcast_to(start.covariance, (*truth.shape, truth.shape[-1]))[0]
    bounds = []
    for k, state in enumerate(truth):
        now = model_at(model, times, k)
        if k and times[k] > times[k - 1]:
            before = Belief(truth[k - 1], P)
            F = extended.tangent(before, now.process, now.process_jacobian, None, now.angular_states)[1]
            P = F @ P @ np.swapaxes(F, -1, -2) + now.Q
        y = np.zeros((*state.shape[:-1], len(now.R)))
        H = extended.tangent(Belief(state, P), now.measure, now.measure_jacobian, y, now.angular)[1]
        H_t = np.swapaxes(H, -1, -2)
        gain = np.swapaxes(np.linalg.solve(H @ P @ H_t + now.R, H @ P), -1, -2)
        rest = np.eye(state.shape[-1]) - gain @ H
        P = rest @ P @ np.swapaxes(rest, -1, -2) + gain @ now.R @ np.swapaxes(gain, -1, -2)
        bounds.append(P)
    return np.array(bounds)


def errors(beliefs: Belief | Run, truth: Array, angular_states: Indices | None = None) -> Array:
    """Return the errors of beliefs, mean (T, n) or (T, B, n), against a truth.

    `angular_states` is as in `nees`. Raises FilterError.
    """
    mean, angles = of_run(beliefs).mean, angular_states
    if angles is None:
        angles = beliefs.angular_states if isinstance(beliefs, Run) else ()
    if np.shape(truth) != mean.shape:
        raise FilterError(f"truth: must have the shape of the means, {mean.shape}, not {np.shape(truth)}")
    off = np.asarray(mean - truth)
    return beside(off, np.zeros_like(off), angles)


def of_run(beliefs: Belief | Run) -> Belief:
    """Return the beliefs of a run, or the beliefs themselves."""
    return beliefs.beliefs if isinstance(beliefs, Run) else beliefs


def _bounds(values: Array, degrees: Array, probability: float) -> ConsistencyBounds:
    each = degrees.reshape(len(values), -1)
    total, runs = each.sum(axis=1), np.maximum((each > 0).sum(axis=1), 1)
    tail, bounds = 0.5 * (1 - probability), np.full((2, len(values)), np.nan)
    for count in np.unique(total[total > 0]):
        at = total == count
        bounds[:, at] = np.array([[chi_square_threshold(p, int(count))] for p in (tail, 1 - tail)]) / runs[at]
    measured = total > 0
    mean = np.where(measured, np.where(each > 0, values, 0).sum(axis=1) / runs, np.nan)
    inside = (mean >= bounds[0]) & (mean <= bounds[1])
    share = float(np.mean(inside[measured])) if measured.any() else float("nan")
    return ConsistencyBounds(mean, np.where(measured, total / runs, np.nan), bounds[0], bounds[1], share)
