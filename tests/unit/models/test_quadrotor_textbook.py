"""The quadrotor study's cubature Kalman filter beside one written from the textbook, for this test alone."""

import math

import numpy as np
import pytest

from onboard.arrays import Array
from onboard.models.quadrotor import VELOCITY
from studies.csvsf_quadrotor.cases import NAMED, Case, simulate
from studies.csvsf_quadrotor.filters import WIDE, track
from studies.csvsf_quadrotor.scores import make_row, score

WIDER = 300.0
M, IXX, IYY, IZZ, ARM, G, T = 0.468, 4.856e-3, 4.856e-3, 8.801e-3, 0.225, 9.81, 0.01


def euler_step(x: Array, inputs: Array) -> Array:
    """One step of the quadrotor's equations for one state (12,)."""
    u, roll, pitch, yaw = inputs
    _, xd, _, yd, _, zd, phi, p, theta, q, psi, r = x
    cphi, sphi, cth, sth, cpsi, spsi = (f(a) for a in (phi, theta, psi) for f in (math.cos, math.sin))
    rate = np.array(
        [
            xd,
            -u / M * (cphi * sth * cpsi + sphi * spsi),
            yd,
            -u / M * (cphi * sth * spsi - sphi * cpsi),
            zd,
            G - u / M * cphi * cth,
            p + (q * sphi + r * cphi) * math.tan(theta),
            (IYY - IZZ) / IXX * q * r + ARM / IXX * roll,
            q * cphi - r * sphi,
            (IZZ - IXX) / IYY * p * r + ARM / IYY * pitch,
            (q * sphi + r * cphi) / cth,
            (IXX - IYY) / IZZ * p * q + yaw / IZZ,
        ]
    )
    return np.asarray(x + T * rate)


def cubature_points(mean: Array, P: Array) -> Array:
    root = np.sqrt(len(mean)) * np.linalg.cholesky(P)
    return np.concatenate([mean + root.T, mean - root.T])


def textbook(case: Case, steps: int) -> Array:
    """Means (steps, 12) of the first flight: Arasaratnam & Haykin's filter, points drawn anew for the update."""
    Q = np.diag([1e-8, WIDER * 4e-6] * 3 + [1e-8, WIDER * 2.5e-5] * 3)
    mean, P, found = case.start[0], 4.0 * case.R, []
    for k in range(steps):
        points = np.array([euler_step(x, case.inputs[k, 0]) for x in cubature_points(mean, P)])
        mean = points.mean(axis=0)
        P = (points - mean).T @ (points - mean) / len(points) + Q
        points = cubature_points(mean, P)
        z = points.mean(axis=0)
        Pzz = (points - z).T @ (points - z) / len(points) + case.R
        K = (points - mean).T @ (points - z) / len(points) @ np.linalg.inv(Pzz)
        mean = mean + K @ (case.measurements[k, 0] - z)
        P = P - K @ Pzz @ K.T
        found.append(mean)
    return np.array(found)


def test_the_wide_filter_is_the_textbook_s_seed_3() -> None:
    case = simulate(NAMED["none"], (3,), steps=300)
    np.testing.assert_allclose(track(case, NAMED["none"], WIDE).mean[:, 0], textbook(case, 300), rtol=0, atol=1e-9)


def test_with_a_wide_noise_the_velocity_error_is_a_scalar_filter_s_seeds_1_to_8() -> None:
    """Each axis a random walk of step variance q, believed to be 300 q, and measured with variance r: the steady
    gain is k, the error's variance v = (1 - k)^2 (v + q) + k^2 r. Position and attitude hardly add information."""
    case = simulate(NAMED["none"], range(1, 9))
    variance = 0.0
    for r in np.diag(case.R)[list(VELOCITY)]:
        q = 4e-6
        prior = 0.5 * (WIDER * q + math.sqrt((WIDER * q) ** 2 + 4 * WIDER * q * r))
        k = prior / (prior + r)
        variance += ((1 - k) ** 2 * q + k**2 * r) / (1 - (1 - k) ** 2)
    assert math.sqrt(variance) == pytest.approx(0.0349, abs=5e-5)
    scores = score(range(1, 9), case, track(case, NAMED["none"], WIDE))
    measured = make_row("none", WIDE.name, scores).quantities["velocity_m_s"].value
    assert measured == pytest.approx(math.sqrt(variance), rel=0.015)
