"""Our arctangent against the C library's in extended precision, and at the corners."""

import math

import numba
import numpy as np
import pytest

from onboard.arrays import Array
from onboard.geometry.arctangent import MAX_POLYNOMIAL_RATIO, arctan2

compiled = numba.njit(error_model="numpy", fastmath={"contract"})(arctan2)


@numba.njit(error_model="numpy")
def over(y, x):  # type: ignore[no-untyped-def]
    """In a loop, as models call it."""
    angles = np.empty(y.shape)
    for i in range(y.shape[0]):
        angles[i] = compiled(y[i], x[i])
    return angles


def units(y: Array, x: Array) -> Array:
    """Errors in units in the last place."""
    expected = np.arctan2(y.astype(np.longdouble), x.astype(np.longdouble))
    return np.abs((over(y, x) - expected) / np.spacing(np.abs(expected.astype(float)))).astype(float)


def test_it_is_exact_to_the_last_digit_or_two_seed_41() -> None:
    rng = np.random.default_rng(41)
    y, x = (rng.normal(0, 1, 200_000) * 10.0 ** rng.uniform(-9, 9, 200_000) for _ in range(2))
    assert units(y, x).max() < 2.5
    turn = np.linspace(-np.pi, np.pi, 100_001)
    assert units(np.sin(turn), np.cos(turn)).max() < 2.5


def test_it_does_not_jump_where_one_formula_follows_another() -> None:
    for tangent in (MAX_POLYNOMIAL_RATIO, 1.0, 1.0 / MAX_POLYNOMIAL_RATIO):
        beside = tangent * (1.0 + np.arange(-50, 51) * 2e-16)
        for sign in (1.0, -1.0):
            angles = over(beside, np.full_like(beside, sign))
            assert (sign * np.diff(angles) >= -2e-16).all()
            assert units(beside, np.full_like(beside, sign)).max() < 2.5


@pytest.mark.parametrize("x", [0.0, -0.0, 1.0, -1.0, 1e-300, -1e300, 5e-324, math.inf, -math.inf])
@pytest.mark.parametrize("y", [0.0, -0.0, 1.0, -1.0, 1e-300, -1e300, 5e-324])
def test_it_has_the_c_librarys_corners(y: float, x: float) -> None:
    got, expected = arctan2(y, x), math.atan2(y, x)
    assert got == pytest.approx(expected, rel=5e-16, abs=0)
    assert math.copysign(1, got) == math.copysign(1, expected)


def test_what_is_not_a_number_stays_so() -> None:
    assert all(math.isnan(arctan2(y, x)) for y, x in ((math.nan, 1.0), (1.0, math.nan), (math.inf, math.inf)))
