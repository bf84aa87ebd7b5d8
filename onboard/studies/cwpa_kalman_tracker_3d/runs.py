"""Runs of the paper's tracker on its own model, with the process noise as printed and right.

States as the paper orders them: positions, velocities, accelerations; "relative dimensions", read as m.
"""

from typing import Final, NamedTuple

import numpy as np
from scipy.linalg import expm

from onboard.arrays import Array
from onboard.filters.discretisation import wiener_acceleration

STEPS: Final = 50
DT: Final = 0.5  # s, assumed
DENSITY: Final = 0.2  # q, (m/s^3)^2/Hz
H: Final = np.eye(3, 9)
R: Final = np.diag([10.0, 8.0, 5.0])  # m^2
P0: Final = np.diag([0.1] * 6 + [0.5] * 3)
RUNS_PER_SEED: Final = 20  # a run takes a tenth of a millisecond


class Runs(NamedTuple):
    """B runs of one filter. Errors are estimate minus truth."""

    truth: Array  # (T, B, 9)
    seen: Array  # (T, B, 3)
    mean: Array  # (T, B, 9)
    covariance: Array  # (T, 9, 9), the same in all runs
    gain: Array  # (T, 9, 3)


def printed_noise(dt: float, q: float) -> Array:
    """Q (9, 9) of eq 14 as it stands: t^5/20 for all variances of an axis."""
    a, b, c = dt**5 / 20, dt**4 / 8, dt**3 / 6
    return np.asarray(np.kron(q * np.array([[a, b, c], [b, a, b], [c, b, a]]), np.eye(3)), float)


def fraction_noise(dt: float, q: float) -> Array:
    """Q (9, 9) by the matrix fraction of eqs 5 and 7."""
    F, L = np.kron(np.eye(3, k=1), np.eye(3)), np.kron(np.array([[0.0], [0.0], [1.0]]), np.eye(3))
    both = expm(np.block([[F, q * L @ L.T], [np.zeros((9, 9)), -F.T]]) * dt)
    C, D = both[:9, 9:], both[9:, 9:]
    return np.asarray(C @ np.linalg.inv(D))


def fly(seed: int, runs: int, drawn: bool, noise: Array | None = None) -> Runs:
    """`runs` runs on the paper's model, begun at a draw from P0 or, as in the paper, at rest at the origin. The
    filter is the paper's (eqs 16-19), with `noise` for its Q (None: the right one)."""
    rng = np.random.default_rng([seed, 14])
    F, Q = wiener_acceleration(DT, DENSITY)
    x = rng.standard_normal((runs, 9)) * (np.sqrt(np.diag(P0)) if drawn else 0.0)
    covariance, gain = schedule(F, Q if noise is None else noise)
    root, mean = np.linalg.cholesky(Q), np.zeros((runs, 9))
    truth, seen, means = [], [], []
    for k in range(STEPS):
        x = x @ F.T + rng.standard_normal((runs, 9)) @ root.T
        y = x[:, :3] + rng.standard_normal((runs, 3)) * np.sqrt(np.diag(R))
        mean = mean @ F.T
        mean = mean + (y - mean[:, :3]) @ gain[k].T
        truth.append(x)
        seen.append(y)
        means.append(mean)
    return Runs(np.array(truth), np.array(seen), np.array(means), covariance, gain)


def schedule(F: Array, Q: Array) -> tuple[Array, Array]:
    """Covariances (T, 9, 9) and gains (T, 9, 3) by eqs 17-19: they do not depend on what is seen."""
    P, covariances, gains = P0, [], []
    for _ in range(STEPS):
        P = F @ P @ F.T + Q
        S = H @ P @ H.T + R
        K = P @ H.T @ np.linalg.inv(S)
        P = P - K @ S @ K.T
        covariances.append(P)
        gains.append(K)
    return np.array(covariances), np.array(gains)
