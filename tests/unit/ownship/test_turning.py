"""Attitudes in plain numbers, held to those of arrays."""

import numpy as np
import pytest

from onboard.geometry.rotations import quaternion_from_vector, quaternion_product, slerp
from onboard.messages import Quaternion, Vec3
from onboard.ownship.turning import between, turned, unit

NEAR = 1e-13  # an angle's cosine near 1 loses some digits


def some(rng: np.random.Generator) -> Quaternion:
    w, x, y, z = rng.standard_normal(4).tolist()
    return unit((w, x, y, z))


@pytest.mark.parametrize("size", [0.0, 1e-12, 1e-5, 0.3, 40.0])
def test_turned_by_rates(size: float) -> None:
    rng = np.random.default_rng(5)
    for dt in (0.0, 1e-3, 0.2):
        q, (a, b, c) = some(rng), (size * rng.standard_normal(3)).tolist()
        omega: Vec3 = (a, b, c)
        expected = quaternion_product(q, quaternion_from_vector(np.array(omega) * dt))
        np.testing.assert_allclose(turned(q, omega, dt), expected, rtol=0, atol=NEAR)


@pytest.mark.parametrize("apart", [0.0, 1e-9, 1e-5, 0.3, 3.0])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_between_two(apart: float, sign: float) -> None:
    rng = np.random.default_rng(6)
    for fraction in (0.0, 0.3, 1.0):
        q = some(rng)
        w, x, y, z = (sign * quaternion_product(q, quaternion_from_vector([0.0, apart, 0.0]))).tolist()
        np.testing.assert_allclose(
            between(q, (w, x, y, z), fraction), slerp(q, (w, x, y, z), fraction), rtol=0, atol=NEAR
        )
