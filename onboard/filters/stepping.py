"""A prediction and an update in one call, by a sigma-point filter's `rule`.

    rule = unscented.rule(weights, n, m)               # or square_root.rule
    state = step(belief, process, Q, y, measure, R, rule)
    state = step(state, process, Q, y, measure, R, rule)

It is for where microseconds count. Each step also draws the sigma points of the next one. It returns the belief
and the NIS, and no innovation.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.filters.angles import beside_first, check_spread
from onboard.filters.belief import Rows, Weights, check_weights, mask
from onboard.filters.errors import FilterError, array_error, raise_status, require_plain


class Kernels(NamedTuple):
    """The compiled functions of a filter.

    Attributes
    ----------
    draw
        `draw(belief, weights)` returns the points (2n+1, n) of a belief.
    redraw, correct_and_redraw
        Fill a step's `StepResult.storage`, with `scratch_size(n, m)` numbers of scratch.
    factored
        Whether the filter carries the covariance's lower factor instead of the covariance.
    """

    draw: Callable[[Any, Weights], Array]
    redraw: Callable[..., int]
    correct_and_redraw: Callable[..., tuple[int, float]]
    factored: bool
    scratch_size: Callable[[int, int], int] | None = None


class Rule(NamedTuple):
    """Everything that stays the same from step to step.

    Attributes
    ----------
    weights, numbers
        Weights, and the same as an array (4,).
    masks : (m + n,)
        Masks of angular components and of considered states.
    shape
        Shape of a step's storage.
    kernels
        The filter's kernels.
    angular_states
        Indices of states that are angles.
    """

    weights: Weights
    numbers: Array
    masks: Array
    shape: tuple[int, int]
    kernels: Kernels
    angular_states: tuple[int, ...]


class StepResult(NamedTuple):
    """The result of `step`: a belief, and the sigma points of the next step. Read-only.

    Attributes
    ----------
    points : (2n+1, n)
        Sigma points of the next step by `rule`; the first is the mean.
    storage : (3n+1 or more, n)
        Points, then the covariance or its factor, then scratch.
    nis
        Normalised innovation squared of the update.
    rule
        The rule of the step.
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
    kernels: Kernels,
    angular_states: tuple[int, ...],
) -> Rule:
    """Return the rule of a filter with n states and m measured components.

    The filters' own `rule` calls it.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    """
    check_weights(weights, n)
    try:
        masks = np.concatenate([mask(angular, m), mask(considered, n)])
    except FilterError as error:
        raise FilterError(f"angular {angular}, considered {considered}: must be below {m} and {n}") from error
    size = kernels.scratch_size(n, m) if kernels.scratch_size else 0
    rows = 3 * n + 1 + -(-size // n)
    return Rule(weights, np.array(weights), masks, (rows, n), kernels, angular_states)


def step(belief: Any, process: Rows, Q: Array, y: Array, measure: Rows, R: Array, rule: Rule) -> StepResult:
    """Predict and update in one call: the same belief and NIS as two calls, in half the time.

    Parameters
    ----------
    belief
        The belief to start from, or the last step's result.
    process, Q, y, measure, R
        As in the filter's `predict` and `update`, for one filter. The rows passed to `measure` are overwritten
        after it returns.
    rule
        The filter's rule.

    Raises
    ------
    FilterError
        If an argument cannot be used.
    NotPositiveDefiniteError
        If the prior, the innovation or the posterior has a covariance that is not positive definite.
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
    storage = np.empty(rule.shape)
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
