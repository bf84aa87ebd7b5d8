"""Probabilistic data association of targets among false measurements.

    states = [method.predict(state, process, Q) for state in states]
    found = update(method, states, ys, measure, R, detection=0.9, clutter=1e-4)    # ys (k, m), all of this time
    states = found.states                                    # found.probabilities (targets, k + 1), the last: none

For one target (PDA, Bar-Shalom & Tse 1975), and jointly for several (JPDA, Fortmann, Bar-Shalom & Scheffe 1983).
Each target is updated by each measurement within its gate, and becomes the mixture of these and of its prediction.
With a linear model and one target these are the formulas of Bar-Shalom, Daum & Huang (2009). A target has at most
one measurement, and a measurement one source; all joint events are counted.

It is wrong for targets that stay close: their means drift together (coalescence). The best assignment alone is
`association.assign`.
"""

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.filters.angles import beside
from onboard.filters.belief import Belief, Indices, Method, Rows
from onboard.filters.errors import FilterError, require_plain
from onboard.filters.gating import chi_square_threshold
from onboard.filters.multiple_model import ModesState, mixture, with_belief
from onboard.filters.runs import log_likelihood

MAX_SET_COUNT: Final = 100_000  # of sets of used measurements, after any target


class Associated(NamedTuple):
    """Targets after association.

    Attributes
    ----------
    states
        State of each target.
    probabilities : (targets, k + 1)
        Probability that each measurement is the target's own, and last that none is.
    """

    states: tuple[Any, ...]
    probabilities: Array


def update(
    method: Method,
    states: Sequence[Any],
    ys: Array,
    measure: Rows,
    R: Array,
    detection: float,
    clutter: float,
    gate: float = 0.99,
    angular: Indices = (),
    angular_states: Indices = (),
) -> Associated:
    """Update targets that are predicted to the time of the measurements.

    Parameters
    ----------
    method
        A Gaussian filter.
    states
        Its state for each target.
    ys : (k, m)
        Measurements.
    measure, R, angular, angular_states
        As in `unscented.update`.
    detection
        Probability that a target is measured.
    clutter
        Density of false measurements, per unit of the space of y.
    gate
        Probability that a target's own measurement is inside its gate.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    NotPositiveDefiniteError
        If a covariance is not positive definite, or not finite.
    """
    if not (0 < detection <= 1 and clutter > 0 and 0 < gate < 1):
        wanted = "in (0, 1], positive, and between 0 and 1"
        raise FilterError(f"detection, clutter, gate: must be {wanted}, not {detection}, {clutter}, {gate}")
    if "kalman" in method.exempt or any(isinstance(state, ModesState) for state in states):
        raise FilterError(f"method: must be Gaussian and of one mode, as a mixture is, not {method.name}")
    require_plain(ys=ys)
    if ys.ndim != 2 or not states:
        raise FilterError(f"ys: must be (k, m), of at least one target, not {ys.shape} of {len(states)}")
    count = len(ys)
    weights = np.zeros((len(states), count + 1))
    weights[:, count] = 1 - detection * gate
    if not count:
        return Associated(tuple(states), np.ones((len(states), 1)))
    updates = [method.update(_repeated(s, count), ys, measure, R, angular, angular_states) for s in states]
    for row, found in zip(weights, updates, strict=True):
        inside = np.asarray(found.nis) <= chi_square_threshold(gate, ys.shape[-1])
        row[:count] = np.where(inside, detection / clutter * np.exp(log_likelihood(found)), 0)
    probabilities = marginals(weights)
    mixed = [
        _mixed(method, state, found.belief, each, angular_states)
        for state, found, each in zip(states, updates, probabilities, strict=True)
    ]
    return Associated(tuple(mixed), probabilities)


def marginals(weights: Array) -> Array:
    """Return the probabilities (targets, k + 1) of each target's measurements.

    A measurement is of one target at most. The sum over joint events goes from target to target. It needs to know
    only which of the measurements that later targets may use have been used (Maskell, Briers & Wright 2004), so
    targets that are apart cost no more together than each alone.

    Parameters
    ----------
    weights : (targets, k + 1)
        Likelihood ratio of each measurement, and last the weight of none, which must be positive.

    Raises
    ------
    FilterError
        If targets compete for so many measurements that the sum is too long.
    """
    targets, count = weights.shape[0], weights.shape[1] - 1
    scaled = weights / weights.max(axis=1, keepdims=True)
    options = [[(int(j), 1 << int(j) if j < count else 0) for j in np.flatnonzero(row)] for row in scaled]
    later = [0] * (targets + 1)  # measurements that this target or a later one may use
    for t in reversed(range(targets)):
        later[t] = later[t + 1] | sum(bit for _, bit in options[t])
    ways = [{0: 1.0}]  # before each target: the weight of each set of used measurements
    for t in range(targets):
        after: dict[int, float] = {}
        for taken, weight in ways[t].items():
            for j, bit in options[t]:
                if not taken & bit:
                    left = (taken | bit) & later[t + 1]
                    after[left] = after.get(left, 0.0) + weight * scaled[t, j]
        if len(after) > MAX_SET_COUNT:
            raise FilterError(
                f"ys: targets compete for them in more than {MAX_SET_COUNT:,} ways; make the gate narrower"
            )
        total = sum(after.values())
        ways.append({left: weight / total for left, weight in after.items()})
    found, rest = np.zeros(weights.shape), {0: 1.0}  # the weight of everything that may follow a set
    for t in reversed(range(targets)):
        before = dict.fromkeys(ways[t], 0.0)
        for taken, weight in ways[t].items():
            for j, bit in options[t]:
                if not taken & bit:
                    event = scaled[t, j] * rest[(taken | bit) & later[t + 1]]
                    found[t, j] += weight * event
                    before[taken] += event
        most = max(before.values())
        rest = {taken: weight / most for taken, weight in before.items()}
    return np.asarray(found / found.sum(axis=1, keepdims=True))


def _repeated(state: Any, count: int) -> Any:
    """Return the state of a batch of `count` equal members."""
    if isinstance(state, tuple):
        each = [_repeated(part, count) for part in state]
        return type(state)(*each) if hasattr(state, "_fields") else tuple(each)
    return np.repeat(state[None], count, axis=0) if isinstance(state, np.ndarray) else state


def _mixed(method: Method, state: Any, updated: Any, weights: Array, angular_states: Indices) -> Any:
    """Return the mixture of the states by each measurement, and of the prediction."""
    prior, after = method.belief(state), method.belief(updated)
    means = beside(np.concatenate([after.mean, prior.mean[None]]), prior.mean, angular_states)
    all_ = Belief(means, np.concatenate([after.covariance, prior.covariance[None]]))
    (mixed,) = mixture(all_, weights[:, None])
    return with_belief(method, state, mixed)
