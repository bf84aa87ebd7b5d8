"""A prediction and an update in one call, where microseconds count, by a sigma-point filter's `rule`.

    rule = unscented.rule(weights, n, m)               # or square_root.rule
    state = step(belief, process, Q, y, measure, R, rule)
    state = step(state, process, Q, y, measure, R, rule)

Each step also draws the sigma points of the next one. It returns the belief and the NIS, and no innovation.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.filters.angles import beside_first, check_spread
from onboard.filters.belief import Rows, Weights, check_weights, mask
from onboard.filters.errors import FilterError, array_error, raise_status, require_plain


class Kernels(NamedTuple):
    """A filter's arithmetic. `draw(belief, weights)` gives the points (2n+1, n) of a belief; the two compiled
    functions fill a step's `StepResult.storage`, in which they need `scratch_size(n, m)` numbers more. `factored`:
    the filter carries the covariance's lower factor in place of the covariance."""

    draw: Callable[[Any, Weights], Array]
    redraw: Callable[..., int]
    correct_and_redraw: Callable[..., tuple[int, float]]
    factored: bool
    scratch_size: Callable[[int, int], int] | None = None


class Rule(NamedTuple):
    """What stays the same from step to step: weights, and the same as an array (4,); the masks (m + n,) of angular
    components and of considered states; shape and precision of a step's storage; the filter's kernels; and the
    states that are angles."""

    weights: Weights
    numbers: Array
    masks: Array
    shape: tuple[int, int]
    dtype: Any
    kernels: Kernels
    angular_states: tuple[int, ...]


class StepResult(NamedTuple):
    """The result of `step`: a belief, and the sigma points (2n+1, n) of the next step by `rule`. Read-only.

    The rows of `storage` (3n+1 or more, n) hold the points, the first of which is the mean, then the covariance or
    its factor, then scratch.
    """

    points: Array
    storage: Array
    nis: float
    rule: Rule

    @property
    def mean(self) -> Array:
        """Mean (n,)."""
        mean: Array = self.points[0]
        return mean

    @property
    def covariance(self) -> Array:
        """Covariance (n, n)."""
        k, n = self.points.shape
        carried = self.storage[k : k + n]
        covariance = carried @ carried.T if self.rule.kernels.factored else carried
        covariance.setflags(write=False)
        return covariance


def rule(
    weights: Weights,
    n: int,
    m: int,
    angular: tuple[int, ...],
    considered: tuple[int, ...],
    dtype: Any,
    kernels: Kernels,
    angular_states: tuple[int, ...],
) -> Rule:
    """The rule of a filter with n states and m measured components; the filters' own `rule` calls it.

    Raises FilterError.
    """
    check_weights(weights, n)
    try:
        masks = np.concatenate([mask(angular, m), mask(considered, n)])
    except FilterError as error:
        raise FilterError(f"angular {angular}, considered {considered}: must be below {m} and {n}") from error
    size = kernels.scratch_size(n, m) if kernels.scratch_size else 0
    rows = 3 * n + 1 + -(-size // n)
    return Rule(weights, np.array(weights, dtype), masks, (rows, n), np.dtype(dtype), kernels, angular_states)


def step(belief: Any, process: Rows, Q: Array, y: Array, measure: Rows, R: Array, rule: Rule) -> StepResult:
    """The filter's `predict`, then its `update`, in one call: the same belief and NIS in half the time.

    `belief` is the belief to start from, or the last step's result; other arguments are those of the two calls,
    for one filter. The rows passed to `measure` are overwritten after it returns.

    Raises FilterError, NotPositiveDefiniteError (for the posterior, too).
    """
    _, redraw, correct_and_redraw, _, _ = rule.kernels
    if type(belief) is StepResult and belief.rule is rule:
        points = belief.points
    else:
        points = rule.kernels.draw(belief, rule.weights)
        if points.ndim > 2:
            raise FilterError("step: takes one filter; a batch takes predict and update")
        points.setflags(False)  # type: ignore[call-arg]  # NumPy takes it
    moved = process(points)
    if rule.angular_states:
        check_spread(points, rule.angular_states)
        moved = beside_first(moved, rule.angular_states)
    storage = np.empty(rule.shape, rule.dtype)
    if not (moved.__class__ is Q.__class__ is y.__class__ is R.__class__ is np.ndarray):
        require_plain(process=moved, Q=Q, y=y, R=R)
    try:
        status = redraw(moved, rule.numbers, Q, storage)
    except TypeError as error:
        raise array_error(points=points, process=moved, Q=Q) from error
    if status:
        raise_status(status, points=points, process=moved, Q=Q)
    points = storage[: 2 * rule.shape[1] + 1]
    # the parts depend on one another, and a model could write into its rows (by keyword it takes twice as long)
    points.setflags(False)  # type: ignore[call-arg]  # NumPy takes it
    images = measure(points)
    if images.__class__ is not np.ndarray:
        require_plain(measure=images)
    try:
        status, nis = correct_and_redraw(storage, images, y, R, rule.numbers, rule.masks)
    except TypeError as error:
        raise array_error(points=points, measure=images, y=y, R=R) from error
    if status:
        raise_status(status, points=points, measure=images, y=y, R=R)
    return StepResult(points, storage, nis, rule)
