"""What a filter may postpone: a prediction until it is needed, a computation until an estimate is published."""

from collections.abc import Callable
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from onboard.arrays import Array
from onboard.ownship import Step

T = TypeVar("T")


class Pending(NamedTuple):
    """Our own motion since some time: seconds, displacement (3,) in m and newest velocity (3,), in n."""

    dt: float
    moved: Array
    v_F_n: Array

    def after(self, step: Step) -> "Pending":
        """After another step."""
        moved = self.moved + step.dt * step.v0 + (0.5 * step.dt**2) * step.a
        return Pending(self.dt + step.dt, moved, step.v1)


def standing(v_F_n: Array) -> Pending:
    """No motion yet, at v_F_n (3,) m/s."""
    return Pending(0.0, np.zeros(3), v_F_n)


class Postponed(Generic[T]):
    """The value of a pure function, computed once, when it is first asked for."""

    def __init__(self, compute: Callable[[], T]) -> None:
        self._compute: Callable[[], T] | None = compute
        self._found: T | None = None

    def value(self) -> T:
        """The value. An exception of the function passes through, and the next call tries again."""
        if self._compute is not None:
            self._found, self._compute = self._compute(), None  # with it goes what it was computed from
        found: T = self._found  # type: ignore[assignment]  # computed above, or before
        return found
