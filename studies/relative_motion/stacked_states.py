"""States of many filters as tuples of arrays, perhaps nested, with one filter a row."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Indices = NDArray[np.intp]


def taken(state: Any, rows: Indices) -> Any:
    """These rows of the state alone."""
    return _map(lambda array: array[rows], state)


def put(state: Any, rows: Indices, new: Any) -> Any:
    """The state with these rows replaced."""

    def replaced(array: Any, values: Any) -> Any:
        copy = array.copy()
        copy[rows] = values
        return copy

    return _map(replaced, state, new)


def concatenated(states: Sequence[Any]) -> Any:
    """One state of all their rows."""
    return _map(lambda *arrays: np.concatenate(arrays), *states)


def _map(function: Callable[..., Any], *states: Any) -> Any:
    first = states[0]
    if isinstance(first, tuple):
        fields = (_map(function, *fields) for fields in zip(*states, strict=True))
        return type(first)(*fields) if hasattr(first, "_fields") else tuple(fields)
    return function(*states)
