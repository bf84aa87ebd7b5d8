"""Targets among false measurements, without a decision which is which: probabilistic data association of one
target (Bar-Shalom & Tse 1975) and joint of several (Fortmann, Bar-Shalom & Scheffe 1983).

    states = [method.predict(state, process, Q) for state in states]
    found = update(method, states, ys, measure, R, detection=0.9, clutter=1e-4)    # ys (k, m), all of this time
    states = found.states                                    # found.probabilities (targets, k + 1), the last: none

Each target is updated by each measurement within its gate, and becomes the mixture of these and of its
prediction. With a linear model and one target these are the formulas of Bar-Shalom, Daum & Huang (2009). A
target has one measurement at most, and a measurement one source; all joint events are counted.

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

MOST: Final = 100_000  # sets of measurements that are taken, after any target


class Associated(NamedTuple):
    """Each target's state, and the probabilities (targets, k + 1) that a measurement is its own: by measurement,
    and last that none is."""

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
    """Update targets, each a state of a Gaussian `method` and predicted to the time of the measurements ys (k,
    m). `detection` is the probability that a target is measured, `clutter` the density of false measurements in
    a unit of the space of y, `gate` the probability that a target's own measurement is inside its gate.

    Raises FilterError, NotPositiveDefiniteError.
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
    """The probabilities (targets, k + 1) of each target's measurements, by weights of the same shape: the
    likelihood ratio of each, and last the weight of none, which must be positive. A measurement is of one target
    at most.

    The sum over joint events goes from target to target. What it must know of those before is only which of the
    measurements that others may still take are taken (Maskell, Briers & Wright 2004), so targets that are apart
    cost no more together than each alone.

    Raises FilterError for targets that compete for so many measurements that the sum is too long.
    """
    targets, count = weights.shape[0], weights.shape[1] - 1
    scaled = weights / weights.max(axis=1, keepdims=True)
    options = [[(int(j), 1 << int(j) if j < count else 0) for j in np.flatnonzero(row)] for row in scaled]
    later = [0] * (targets + 1)  # measurements that this target or one after it may take
    for t in reversed(range(targets)):
        later[t] = later[t + 1] | sum(bit for _, bit in options[t])
    ways = [{0: 1.0}]  # before each target: the weight of each set of measurements that are taken
    for t in range(targets):
        after: dict[int, float] = {}
        for taken, weight in ways[t].items():
            for j, bit in options[t]:
                if not taken & bit:
                    left = (taken | bit) & later[t + 1]
                    after[left] = after.get(left, 0.0) + weight * scaled[t, j]
        if len(after) > MOST:
            raise FilterError(f"ys: targets compete for them in more than {MOST:,} ways; make the gate narrower")
        total = sum(after.values())
        ways.append({left: weight / total for left, weight in after.items()})
    found, rest = np.zeros(weights.shape), {0: 1.0}  # the weight of all that may follow a set
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
    """A state of a batch of `count` that are alike."""
    if isinstance(state, tuple):
        each = [_repeated(part, count) for part in state]
        return type(state)(*each) if hasattr(state, "_fields") else tuple(each)
    return np.repeat(state[None], count, axis=0) if isinstance(state, np.ndarray) else state


def _mixed(method: Method, state: Any, updated: Any, weights: Array, angular_states: Indices) -> Any:
    """The mixture of the states by each measurement, and of the prediction."""
    prior, after = method.belief(state), method.belief(updated)
    means = beside(np.concatenate([after.mean, prior.mean[None]]), prior.mean, angular_states)
    all_ = Belief(means, np.concatenate([after.covariance, prior.covariance[None]]))
    (mixed,) = mixture(all_, weights[:, None].astype(means.dtype))
    return with_belief(method, state, mixed)
