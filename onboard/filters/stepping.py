"""A prediction and an update in one call, where microseconds count: of one sigma-point filter, made ready by its
`rule`.

    rule = unscented.rule(weights, n, m)               # or square_root.rule
    belief = step(belief, process, Q, y, measure, R, rule)

Each step draws the sigma points of the next one, and tells no more than the belief and the NIS.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.filters.belief import FilterError, Rows, Weights, flags, refuse, wrong_arrays


class Kernels(NamedTuple):
    """A filter's arithmetic: `draw(belief, weights)` gives points (2n+1, n) of a belief, the compiled ones fill
    the array of a step, `Drawn.room`, in which they may need `scratch_size(n, m)` numbers more. `factored`: it
    carries the covariance's lower factor in its place."""

    draw: Callable[[Any, Weights], Array]
    redraw: Callable[..., int]
    correct_and_redraw: Callable[..., tuple[int, float]]
    factored: bool
    scratch_size: Callable[[int, int], int] | None = None


class Rule(NamedTuple):
    """What stays the same from step to step: weights, also as an array (4,); the marks (m + n,) of angular
    components and of considered states; shape and precision of the array that a step fills; and the filter."""

    weights: Weights
    numbers: Array
    marks: Array
    room: tuple[int, int]
    dtype: Any
    kernels: Kernels


class Drawn(NamedTuple):
    """What `step` gives: a belief, with the sigma points (2n+1, n) of the next one drawn by `rule`. Read-only.

    `room` (3n+1 or more, n) holds the points, the first of which is the mean, the covariance or its factor, and
    scratch.
    """

    points: Array
    room: Array
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
        carried = self.room[k : k + n]
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
) -> Rule:
    """A filter for `step`; the filters' own `rule` calls it. Raises FilterError."""
    try:
        marks = np.concatenate([flags(angular, m), flags(considered, n)])
    except IndexError as error:
        raise FilterError(f"angular {angular}, considered {considered}: must be below {m} and {n}") from error
    size = kernels.scratch_size(n, m) if kernels.scratch_size else 0
    rows = 3 * n + 1 + -(-size // n)
    return Rule(weights, np.array(weights, dtype), marks, (rows, n), np.dtype(dtype), kernels)


def step(belief: Any, process: Rows, Q: Array, y: Array, measure: Rows, R: Array, rule: Rule) -> Drawn:
    """The filter's `predict`, and `update` of what that gave, in one call: the same belief and NIS in half the
    time.

    `belief` is what the filter starts from, or what the last step gave; other arguments as those of the two calls,
    of one filter. The rows that `measure` is given are written over when it has returned.

    Raises FilterError, NotPositiveDefiniteError (for the posterior, too).
    """
    _, redraw, correct_and_redraw, _, _ = rule.kernels
    if type(belief) is Drawn and belief.rule is rule:
        points = belief.points
    else:
        points = rule.kernels.draw(belief, rule.weights)
        if points.ndim > 2:
            raise FilterError("step: takes one filter; a batch takes predict and update")
    moved = process(points)
    room = np.empty(rule.room, rule.dtype)
    try:
        status = redraw(moved, rule.numbers, Q, room)
    except TypeError as error:
        raise wrong_arrays(mean=points, process=moved, Q=Q) from error
    if status:
        refuse(status)
    points = room[: 2 * rule.room[1] + 1]
    # the parts depend on one another, and a model could write into its rows (by keyword it takes twice as long)
    points.setflags(False)  # type: ignore[call-arg]  # NumPy takes it
    images = measure(points)
    try:
        status, nis = correct_and_redraw(room, images, y, R, rule.numbers, rule.marks)
    except TypeError as error:
        raise wrong_arrays(mean=points, measure=images, y=y, R=R) from error
    if status:
        refuse(status)
    return Drawn(points, room, nis, rule)
