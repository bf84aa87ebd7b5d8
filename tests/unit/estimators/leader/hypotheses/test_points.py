"""What an image shows of a leader's shape, against plain geometry and a plain Kalman filter."""

import math
from typing import Any

import numpy as np
import pytest

from onboard.arrays import Array
from onboard.estimators.leader.hypotheses import view as model
from onboard.estimators.leader.hypotheses.motion import ACCELERATION, LOG_SIZE, POSITION, TILT, N
from onboard.estimators.leader.image.measurement import HIGHEST, LOWEST, Rows, measured_spread
from onboard.estimators.leader.image.shape import Posture
from onboard.geometry.rotations import matrix_from_euler

SIZE = 2.0
POINTS = np.array([[0.36, 0.0, 0.02], [-0.4, 0.05, -0.1], [0.0, -0.5, 0.0], [0.0, 0.5, 0.0]])
SIGMA = 1 / 500
G = 9.80665  # m/s^2, standard (CGPM 1901)
EXACT = Posture(1.0, 0.0, 0.0)


def drawn(seed: int) -> tuple[Array, Array, float, Array]:
    """A state, its covariance, its heading and an attitude of the camera."""
    rng = np.random.default_rng(seed)
    x = rng.normal(size=N) * np.repeat([1.0, 3.0, 1.0, 0.05, 1.0, 0.02], [3, 3, 3, 1, 2, 2])
    x[POSITION] += [25.0, 4.0, -3.0]
    x[LOG_SIZE] += math.log(SIZE)
    L = 0.1 * np.tril(rng.normal(size=(N, N))) + 0.1 * np.eye(N)
    L[12] = L[:, 12] = 0.0  # the wing scale error is of the wing alone
    return x, L @ L.T, rng.uniform(-0.8, 0.8), matrix_from_euler(0.05, -0.1, 0.2).T


def coordinates(x: Array, heading: float, axes_n: Array) -> Array:
    """Coordinates (k, 2) of POINTS of a multirotor that tilts as its thrust demands."""
    force = x[ACCELERATION] + np.append(x[TILT], 0.0)
    c, s = math.cos(heading), math.sin(heading)
    bank = math.atan2(c * force[1] - s * force[0], G - x[8]) + x[9]
    pitch = math.atan2(-c * force[0] - s * force[1], G - x[8])
    q = x[POSITION] + math.exp(x[LOG_SIZE]) * POINTS @ matrix_from_euler(bank, pitch, heading).T
    return 2.0 * q @ axes_n[1:].T / (np.linalg.norm(q, axis=1) + q @ axes_n[0])[:, None]


def axes_of(x: Array, R_cn: Array) -> Array:
    """Axes (3, 3) in c about the direction of the center."""
    ahead, right, down = R_cn @ x[POSITION]
    u, v = right / ahead, down / ahead
    first = np.array([1.0, u, v]) / math.sqrt(1 + u * u + v * v)
    second = np.array([-u, 1.0, 0.0]) / math.sqrt(1 + u * u)
    return np.array([first, second, np.cross(first, second)])


def named(y: Array, *, named: bool = True, posture: Posture = EXACT) -> Rows:
    """The rows of all points at coordinates (k, 2)."""
    k = len(POINTS)
    of, axis = np.repeat(np.arange(k), 2), np.tile([0, 1], k)
    names = tuple("abcd") if named else ()
    return rows_of(y.ravel(), of, axis, names=names, posture=posture)


def rows_of(y: Array, of: Array, axis: Array, **more: Any) -> Rows:
    """Rows of single coordinates of POINTS."""
    shares = np.tile([1.0, 0.0], (len(y), 1))
    more = {"posture": EXACT} | more
    return Rows(y, SIGMA**2 * np.eye(len(y)), POINTS, np.column_stack([of, of]), shares, axis, **more)


def corrected(
    x: Array, P: Array, heading: float, rows: Rows, R_cn: Array, bias: int = 0
) -> tuple[Array, Array, float, float]:
    """Mean, covariance, heading and NIS of one particle after an image."""
    means, covariances, headings = x[None].copy(), P[None].copy(), np.array([heading])
    seen = model.view_of(rows, (R_cn, np.zeros(3), axes_of(x[:N], R_cn)), np.zeros(1), bias)
    if rows.names:
        each = model.orient(means, covariances, headings, seen)
    else:
        *_, each = model.expect(means, covariances, headings, np.ones(1), seen)
    nis, _ = model.update(means, covariances, headings, seen, each)
    return means[0], covariances[0], float(headings[0]), float(nis[0])


@pytest.mark.parametrize("seed", range(5))
def test_an_update_is_that_of_a_plain_kalman_filter_seed_0_to_4(seed: int) -> None:
    x, P, heading, R_cn = drawn(seed)
    axes_n = axes_of(x, R_cn) @ R_cn
    predicted = coordinates(x, heading, axes_n).ravel()
    e = SIGMA * np.random.default_rng(seed).normal(size=len(predicted))
    J = np.empty((len(e), N))
    for i, step in enumerate(1e-5 * np.eye(N)):
        ahead, back = coordinates(x + step, heading, axes_n), coordinates(x - step, heading, axes_n)
        J[:, i] = (ahead - back).ravel() / 2e-5
    S = J @ P @ J.T + SIGMA**2 * np.eye(len(e))
    gain = P @ J.T @ np.linalg.inv(S)
    gain[LOG_SIZE:] = 0.0  # the size is considered, and not estimated
    left = np.eye(N) - gain @ J
    rows = named((predicted + e).reshape(-1, 2))
    mean, covariance, after, nis = corrected(x, P, heading, rows, R_cn)
    assert nis == pytest.approx(e @ np.linalg.solve(S, e), rel=1e-3)
    assert mean == pytest.approx(x + gain @ e, abs=2e-4)
    assert covariance == pytest.approx(left @ P @ left.T + SIGMA**2 * gain @ gain.T, abs=2e-4)
    assert after == heading


@pytest.mark.parametrize("seed", range(5))
def test_a_nose_where_the_tail_is_turns_round_and_the_bank_with_it_seed_0_to_4(seed: int) -> None:
    x, P, heading, R_cn = drawn(seed)
    rows = named(coordinates(x, heading, axes_of(x, R_cn) @ R_cn))
    right = corrected(x, P, heading, rows, R_cn)
    other, mirror = x.copy(), np.ones(N)
    other[9], mirror[9] = -x[9], -1.0
    turned = corrected(other, P * np.outer(mirror, mirror), heading - math.pi, rows, R_cn)
    assert turned[2] == pytest.approx(heading)
    assert turned[0] == pytest.approx(right[0], abs=1e-9)
    assert turned[1] == pytest.approx(right[1], abs=1e-9)
    unnamed = corrected(other, P, heading - math.pi, rows._replace(names=()), R_cn)
    assert unnamed[2] == heading - math.pi
    assert unnamed[3] > 50.0


@pytest.mark.parametrize("seed", range(5))
def test_the_sides_of_a_box_are_those_points_that_reach_farthest_seed_0_to_4(seed: int) -> None:
    x, P, heading, R_cn = drawn(seed)
    at = coordinates(x, heading, axes_of(x, R_cn) @ R_cn)
    y = np.array([at[:, 0].min(), at[:, 0].max(), at[:, 1].min(), at[:, 1].max()])
    which, axis = np.array([LOWEST, HIGHEST, LOWEST, HIGHEST]), np.array([0, 0, 1, 1])
    box = rows_of(y, which, axis)
    assert corrected(x, P, heading, box, R_cn)[3] == pytest.approx(0.0, abs=1e-9)
    ends = np.array([at[:, 0].argmin(), at[:, 0].argmax(), at[:, 1].argmin(), at[:, 1].argmax()])
    off = y + SIGMA * np.array([-2.0, 1.0, 0.5, 1.5])
    as_box, as_points = (corrected(x, P, heading, rows_of(off, w, axis), R_cn) for w in (which, ends))
    assert as_box[0] == pytest.approx(as_points[0])
    assert as_box[3] == pytest.approx(as_points[3])


def test_a_pitch_that_is_open_leaves_up_and_down_open_and_a_misplaced_point_all() -> None:
    x, P, _, R_cn = drawn(1)
    x[ACCELERATION], x[TILT], x[9], x[LOG_SIZE] = 0.0, 0.0, 0.0, math.log(SIZE)
    heading = math.atan2(x[1], x[0]) + 0.5 * math.pi  # seen from the side
    at = coordinates(x, heading, axes_of(x, R_cn) @ R_cn)
    up = at.copy()
    up[:2, 1] += np.radians(12.0) * SIZE * np.array([-0.36, 0.4]) / np.linalg.norm(x[POSITION])

    def nis(y: Array, pitch: float, keypoint_bias: float) -> float:
        return corrected(x, 1e-6 * P, heading, named(y, posture=Posture(1.0, pitch, keypoint_bias)), R_cn)[3]

    assert nis(up, 0.0, 0.0) > 8.0
    assert nis(up, np.radians(12.0), 0.0) < 2.0
    bent = at.copy()  # nose and tail both higher: no pitch does that
    bent[:2, 1] -= np.radians(12.0) * SIZE * 0.38 / np.linalg.norm(x[POSITION])
    assert nis(bent, np.radians(12.0), 0.0) > 0.8 * nis(bent, 0.0, 0.0)
    aside = at + 0.05 * SIZE / np.linalg.norm(x[POSITION])
    share = 0.05 * SIZE / float(np.linalg.norm(x[POSITION])) / SIGMA
    assert nis(aside, 0.0, 0.0) / nis(aside, 0.0, 0.05) == pytest.approx(1.0 + share**2, rel=0.03)


def test_what_lasts_of_a_box_s_error_is_a_column_of_the_state() -> None:
    """A box that is larger by a bias is one of a leader that is as much larger, as far as an image shows it."""
    x, P, heading, R_cn = drawn(2)
    rows = named(coordinates(x, heading, axes_of(x, R_cn) @ R_cn), named=False)
    wider, more = np.append(x, 0.1), np.pad(1e-4 * P, ((0, 1), (0, 1)))
    more[-1, -1] = 0.04
    nis = []
    for mean, covariance, bias in ((wider, more, N), (np.append(x, 0.0), more, N), (wider, more, 0)):
        after, P_after, _, of_it = corrected(mean, covariance, heading, rows, R_cn, bias)
        nis.append(of_it)
        assert (after[N], P_after[N, N]) == (mean[N], 0.04)  # it is considered
    surer = more.copy()
    surer[-1, -1] = 1e-8
    assert corrected(wider, surer, heading, rows, R_cn, N)[3] > 5.0 * nis[0]
    assert nis[0] > 0.01
    assert max(nis[1:]) < 1e-6


def test_the_spread_of_a_distant_leader_is_what_its_coordinates_show() -> None:
    x, _, _, R_cn = drawn(2)
    x[POSITION] = [200.0, 10.0, -3.0]
    x[ACCELERATION], x[TILT], x[9], x[LOG_SIZE] = 0.0, 0.0, 0.0, math.log(SIZE)
    axes_n = axes_of(x, R_cn) @ R_cn
    headings = np.linspace(0.0, 3.0, 7)
    rows = named(np.zeros_like(POINTS[:, :2]))
    expected = [measured_spread(rows, coordinates(x, heading, axes_n).ravel()) for heading in headings]
    found = model.spread(rows, headings, axes_n) * SIZE / np.linalg.norm(x[POSITION])
    assert found == pytest.approx(expected, rel=0.01)
