"""How good a filter was: errors against a truth, and whether its covariances say how large they are.

    nis(found).inside, nees(found.beliefs, truth), rms(found.beliefs, truth, states=(0, 1))    # of a run, or a
    batch

NEES is the squared error in units of the covariance, and NIS the same of the innovation: on average the number of
states, and of measured components. Below the bounds a filter is too pessimistic, above them too sure. Runs are
independent, so a batch has narrow bounds at each time; the innovations of one run are, too, its errors are not.

Errors of angles wrap. A `Run` in place of its beliefs says which states are angles; for beliefs alone they are
named, `angular_states=(2,)`. A filter of a batch that was lost does not count.
"""

from typing import Any, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.filters import extended
from onboard.filters.angles import beside
from onboard.filters.belief import Belief, FilterError, Indices
from onboard.filters.gating import chi_square_threshold, normalised_squared
from onboard.filters.runs import Run
from onboard.filters.state_space import AnyModel, model_at


class ConsistencyBounds(NamedTuple):
    """At each time the mean (T,) over the runs that measured and are not lost, what is expected (T,), and the
    bounds (T,) that hold it with the probability that was asked for; NaN where nothing was measured. `inside`: the
    share of times within the bounds."""

    mean: Array
    expected: Array
    low: Array
    high: Array
    inside: float


def nees(
    beliefs: Belief | Run, truth: Array, probability: float = 0.95, angular_states: Indices | None = None
) -> ConsistencyBounds:
    """Normalised estimation error squared of beliefs, mean (T, n) or (T, B, n), against a truth of the same
    shape. `angular_states` are the states that are angles, by default those of the run.

    Raises FilterError.
    """
    error, n = errors(beliefs, truth, angular_states), np.shape(truth)[-1]
    known: Any = np.isfinite(error).all(axis=-1)
    P = np.where(known[..., None, None], of_run(beliefs).covariance, np.eye(n))
    each = normalised_squared(np.where(known[..., None], error, 0).reshape(-1, n), P.reshape(-1, n, n))
    return _judged(each.reshape(len(error), -1), n * known, probability)


def nis(found: Run, probability: float = 0.95) -> ConsistencyBounds:
    """Normalised innovation squared of a run, or of a batch."""
    return _judged(found.nis.reshape(len(found.ts), -1), found.degrees, probability)


def rms(
    beliefs: Belief | Run,
    truth: Array,
    states: tuple[int, ...] | None = None,
    angular_states: Indices | None = None,
) -> Array:
    """Root mean square (T,) over the runs of the length of the error in these states, by default in all;
    `angular_states` as in `nees`. NaN where no run is left.

    Raises FilterError.
    """
    error = errors(beliefs, truth, angular_states)
    chosen = error if states is None else error[..., list(states)]
    squared: Array = np.sum(chosen**2, axis=-1).reshape(len(error), -1)
    known = np.isfinite(squared)
    count = known.sum(axis=1)
    mean = np.where(known, squared, 0).sum(axis=1) / np.maximum(count, 1)
    return np.asarray(np.where(count, np.sqrt(mean), np.nan))


def cramer_rao(model: AnyModel, start: Belief, truth: Array, ts: Array | None = None) -> Array:
    """The least covariance (T, ..., n, n) that an unbiased estimate of this path can have, truth (T, ..., n), from
    a first belief of covariance (n, n) or (..., n, n): Q, R and the prior counted, and models linearised at the
    truth (Taylor 1979, "The Cramer-Rao estimation error lower bound computation for deterministic nonlinear
    systems"). Of a random path it is the mean over many truths. No mode of an `imm`, and no angle, may be open.

    Raises FilterError, NotPositiveDefiniteError.
    """
    truth = np.asarray(truth)
    times = np.arange(float(len(truth))) if ts is None else np.asarray(ts, float)
    P = np.broadcast_to(start.covariance, (*truth.shape, truth.shape[-1]))[0]
    bounds = []
    for k, state in enumerate(truth):
        now = model_at(model, times, k)
        if k and times[k] > times[k - 1]:
            before = Belief(truth[k - 1], P)
            F = extended.tangent(before, now.process, now.process_jacobian, None, now.angular_states)[1]
            P = F @ P @ np.swapaxes(F, -1, -2) + now.Q
        y = np.zeros((*state.shape[:-1], len(now.R)), state.dtype)
        H = extended.tangent(Belief(state, P), now.measure, now.measure_jacobian, y, now.angular)[1]
        H_t = np.swapaxes(H, -1, -2)
        gain = np.swapaxes(np.linalg.solve(H @ P @ H_t + now.R, H @ P), -1, -2)
        rest = np.eye(state.shape[-1]) - gain @ H
        P = rest @ P @ np.swapaxes(rest, -1, -2) + gain @ now.R @ np.swapaxes(gain, -1, -2)
        bounds.append(P)
    return np.array(bounds)


def errors(beliefs: Belief | Run, truth: Array, angular_states: Indices | None = None) -> Array:
    """What beliefs, mean (T, n) or (T, B, n), are off a truth of the same shape; `angular_states` as in `nees`.

    Raises FilterError.
    """
    mean, angles = of_run(beliefs).mean, angular_states
    if angles is None:
        angles = beliefs.angular_states if isinstance(beliefs, Run) else ()
    if np.shape(truth) != mean.shape:
        raise FilterError(f"truth: must have the shape of the means, {mean.shape}, not {np.shape(truth)}")
    off = np.asarray(mean - truth)
    return beside(off, np.zeros_like(off), angles)


def of_run(beliefs: Belief | Run) -> Belief:
    """Beliefs, or those of a run."""
    return beliefs.beliefs if isinstance(beliefs, Run) else beliefs


def _judged(values: Array, degrees: Array, probability: float) -> ConsistencyBounds:
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
