"""The coordinates in which an image is linear: against plain geometry, done by hand here."""

import math

import numpy as np
import pytest

from onboard.arrays import Array
from onboard.geometry.rotations import matrix_from_euler
from onboard.models import apparent_wing as model
from onboard.models.wing_line import from_points

SIZE = 2.0
F_PX = 500.0


def state(r_FL_n: Array, v_L: Array, a_L: Array, nose: float, axes: Array) -> Array:
    """The state row of a leader with a coordinated bank, from its position."""
    row = np.zeros(model.N)
    direction = r_FL_n / np.linalg.norm(r_FL_n)
    row[:2] = 2.0 * axes[1:] @ direction / (1.0 + axes[0] @ direction)
    row[model.V], row[model.A], row[model.NOSE] = v_L, a_L, nose
    row[model.LOG_SIZE] = math.log(SIZE)
    seen = math.sqrt(1.0 - (wing(a_L, nose) @ direction) ** 2 + model.LEAST_VISIBLE**2)
    row[model.LOG_LENGTH] = math.log(SIZE * seen / np.linalg.norm(r_FL_n))
    return row


def wing(a_L: Array, nose: float) -> Array:
    """From the left wingtip to the right one, of an aircraft whose lift carries its acceleration."""
    right = np.array([-math.sin(nose), math.cos(nose), 0.0])
    bank = math.atan2(float(a_L @ right), model.G - a_L[2])
    return math.cos(bank) * right + np.array([0.0, 0.0, math.sin(bank)])


@pytest.mark.parametrize("seed", range(5))
def test_position_and_image_are_those_of_plain_geometry_seed_0_to_4(seed: int) -> None:
    rng = np.random.default_rng(seed)
    r, v, a = np.array([25.0, 4.0, -3.0]) + rng.normal(size=3), rng.normal(size=3), rng.normal(size=3)
    nose, R_cn = rng.uniform(-3, 3), matrix_from_euler(0.05, -0.1, 0.2).T
    axes = model.axes_about(np.array([0.97, 0.2, -0.1]) / np.linalg.norm([0.97, 0.2, -0.1]))
    row = state(r, v, a, nose, axes)
    assert model.positions(row[None], axes)[0] == pytest.approx(r, abs=1e-9)
    half = 0.5 * SIZE * wing(a, nose)
    points = np.array([p[1:] / p[0] for p in (R_cn @ (r + k * half) for k in (0.0, -1.0, 1.0))])
    y, _, seen = from_points(points[None], np.full((1, 3), 1.0 / F_PX), 6)
    predicted = model.measure(row[None], axes, R_cn, np.zeros(3), seen[0], 6)[0]
    assert predicted == pytest.approx(y[0], abs=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_a_short_step_is_that_of_plain_kinematics_seed_0_to_4(seed: int) -> None:
    rng = np.random.default_rng(seed)
    r, v, a = np.array([25.0, 4.0, -3.0]), 6.0 * rng.normal(size=3), rng.normal(size=3)
    moved, own_error, dt = rng.normal(size=3), 0.1 * rng.normal(size=3), 1e-3
    axes = model.axes_about(r / np.linalg.norm(r))
    new_axes = model.axes_about(np.array([0.99, 0.1, 0.0]) / math.hypot(0.99, 0.1))
    row = state(r, v, a, 0.4, axes)
    row[model.OWN_VELOCITY] = own_error
    decay = model.Decay(1.0, 1.0, 1.0, 1.0, np.ones(1))
    after = model.process(row[None], dt, moved, axes, new_axes, decay)
    expected = r + dt * (v - own_error) - moved + 0.5 * dt * dt * a
    assert model.positions(after, new_axes)[0] == pytest.approx(expected, abs=1e-7)
    assert after[0, model.V] == pytest.approx(v + dt * a, abs=1e-4)


def test_a_misalignment_rotates_what_is_seen() -> None:
    """The believed attitude is yawed by 10 mrad to the right of the true one: the leader is seen to the left."""
    r = np.array([30.0, 0.0, 0.0])
    axes = model.axes_about(np.array([1.0, 0.0, 0.0]))
    row = state(r, np.zeros(3), np.zeros(3), 0.0, axes)
    row[model.MISALIGNMENT] = [0.0, 0.0, 0.01]
    seen = model.measure(row[None], axes, np.eye(3), np.zeros(3), np.eye(3), 4)[0]
    assert seen[0] == pytest.approx(0.01, abs=1e-5)
