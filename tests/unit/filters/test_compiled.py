"""Kernels that only fill arrays, as they are compiled: what makes arrays is refused, and slices live."""

import numpy as np
import pytest
from numba import njit, types
from numba.core.errors import NumbaError

from onboard.filters.compiled import FILLING

VECTOR = types.Array(types.float64, 1, "C")
ONCE = FILLING | {"cache": False}


def test_a_kernel_that_makes_an_array_is_refused() -> None:
    def making(a):  # type: ignore[no-untyped-def]
        b = np.empty(3)
        b[0] = a[0]
        a[1] = b[0]

    with pytest.raises(NumbaError, match="empty"):
        njit((VECTOR,), **ONCE)(making)


def test_slices_of_what_is_filled_live_as_long_as_they_are_used() -> None:
    def filling(a):  # type: ignore[no-untyped-def]
        tail = a[1:].reshape(-1, 2)
        for row in range(tail.shape[0]):
            tail[row, 0] = row
            tail[row, 1] = -row

    kernel = njit((VECTOR,), **ONCE)(filling)
    for _ in range(1000):
        a = np.empty(7)
        kernel(a)
        np.testing.assert_array_equal(a[1:], [0, 0, 1, -1, 2, -2])
