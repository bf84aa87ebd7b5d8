"""The axes of a path: by hand, against simlink's own accelerations, and there and back."""

import numpy as np
import pytest

from onboard.geometry.path_axes import MIN_COURSE_SPEED_M_S, path_axes
from simlink.world.truth import path_accelerations


def test_a_climb_that_gains_speed_has_none_of_it_across() -> None:
    climb = np.radians(30.0)
    ahead = np.array([np.cos(climb), 0.0, -np.sin(climb)])  # north and up
    assert path_axes(12.0 * ahead, 0.0) @ (2.0 * ahead) == pytest.approx([0.0, 0.0, 2.0], abs=1e-12)
    up = np.array([-np.sin(climb), 0.0, -np.cos(climb)])
    assert path_axes(12.0 * ahead, 0.0) @ (3.0 * up) == pytest.approx([0.0, 3.0, 0.0], abs=1e-12)
    assert path_axes(12.0 * ahead, 0.0) @ np.array([0.0, 1.5, 0.0]) == pytest.approx([1.5, 0.0, 0.0], abs=1e-12)


def test_they_are_simlinks_and_orthogonal_seed_1() -> None:
    rng = np.random.default_rng(1)
    for v, a in zip(rng.normal(0.0, 6.0, (50, 3)), rng.normal(0.0, 3.0, (50, 3)), strict=True):
        axes = path_axes(v, 0.0)
        if np.hypot(v[0], v[1]) > MIN_COURSE_SPEED_M_S:
            assert (axes @ a)[:2] == pytest.approx(path_accelerations(tuple(v.tolist()), tuple(a.tolist())))
        assert axes @ axes.T == pytest.approx(np.eye(3), abs=1e-12)
        assert axes.T @ (axes @ a) == pytest.approx(a)


def test_a_slow_one_has_level_axes_along_its_heading() -> None:
    axes = path_axes(np.array([0.5, -0.8, 3.0]), np.pi / 2)  # looks east
    assert axes @ np.array([1.0, 2.0, -3.0]) == pytest.approx([-1.0, 3.0, 2.0])
