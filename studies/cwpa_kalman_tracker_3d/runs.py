"""Runs of the paper's tracker on its own model, with the printed and the right process noise.

States have the paper's order: positions, velocities, accelerations; its "relative dimensions" are read as m.
"""

from typing import Final, NamedTuple

import numpy as np
from scipy.linalg import expm

from onboard.arrays import Array
from onboard.filters.discretisation import wiener_acceleration
from onboard.filters.gating import chi_square_threshold, normalised_squared

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
    measured: Array  # (T, B, 3)
    mean: Array  # (T, B, 9)
    covariance: Array  # (T, 9, 9), the same in all runs
    gain: Array  # (T, 9, 3)


class Scores(NamedTuple):
    """Errors and consistency over all steps and runs, with standard errors by the scatter over runs.

    A negative NEES is that of an invalid covariance: the filter has failed.
    """

    position: float
    velocity: float
    acceleration: float
    raw: float
    bound: float
    nees: float
    inside: float
    position_error: float
    nees_error: float

    @property
    def failed(self) -> bool:
        """Return whether the covariance is not positive definite."""
        return self.nees < 0


def printed_noise(dt: float, q: float) -> Array:
    """Q (9, 9) of eq 14 as printed: t^5/20 for all variances of an axis."""
    a, b, c = dt**5 / 20, dt**4 / 8, dt**3 / 6
    return np.asarray(np.kron(q * np.array([[a, b, c], [b, a, b], [c, b, a]]), np.eye(3)), float)


def fraction_noise(dt: float, q: float) -> Array:
    """Q (9, 9) by the matrix fraction of eqs 5 and 7."""
    F, L = np.kron(np.eye(3, k=1), np.eye(3)), np.kron(np.array([[0.0], [0.0], [1.0]]), np.eye(3))
    both = expm(np.block([[F, q * L @ L.T], [np.zeros((9, 9)), -F.T]]) * dt)
    C, D = both[:9, 9:], both[9:, 9:]
    return np.asarray(C @ np.linalg.inv(D))


def fly(seed: int, runs: int, drawn: bool, noise: Array | None = None) -> Runs:
    """`runs` runs on the paper's model.

    They start at a draw from P0 if `drawn`, else, as in the paper, at rest at the origin. The filter is the
    paper's (eqs 16-19), with `noise` for its Q (None: the right one).
    """
    rng = np.random.default_rng([seed, 14])
    F, Q = wiener_acceleration(DT, DENSITY)
    x = rng.standard_normal((runs, 9)) * (np.sqrt(np.diag(P0)) if drawn else 0.0)
    covariance, gain = schedule(F, Q if noise is None else noise)
    root, mean = np.linalg.cholesky(Q), np.zeros((runs, 9))
    truth, measured, means = [], [], []
    for k in range(STEPS):
        x = x @ F.T + rng.standard_normal((runs, 9)) @ root.T
        y = x[:, :3] + rng.standard_normal((runs, 3)) * np.sqrt(np.diag(R))
        mean = mean @ F.T
        mean = mean + (y - mean[:, :3]) @ gain[k].T
        truth.append(x)
        measured.append(y)
        means.append(mean)
    return Runs(np.array(truth), np.array(measured), np.array(means), covariance, gain)


def schedule(F: Array, Q: Array) -> tuple[Array, Array]:
    """Return covariances (T, 9, 9) and gains (T, 9, 3) by eqs 17-19, independent of measurements."""
    P, covariances, gains = P0, [], []
    for _ in range(STEPS):
        P = F @ P @ F.T + Q
        S = H @ P @ H.T + R
        K = P @ H.T @ np.linalg.inv(S)
        P = P - K @ S @ K.T
        covariances.append(P)
        gains.append(K)
    return np.array(covariances), np.array(gains)


def score(seeds: range, drawn: bool, noise: Array | None) -> Scores:
    """The scores of all runs of these seeds; arguments as of `fly`.

    Of each run its means over the steps are kept, not its steps: ten thousand seeds are 200,000 runs.
    """
    position, velocity, acceleration, raw, nees, inside = np.concatenate(
        [_means(fly(seed, RUNS_PER_SEED, drawn, noise)) for seed in seeds], axis=1
    )
    F, Q = wiener_acceleration(DT, DENSITY)
    covariance, _ = schedule(F, Q if noise is None else noise)
    bound = np.trace(covariance[:, :3, :3], axis1=1, axis2=2)
    return Scores(
        position=_root(position),
        velocity=_root(velocity),
        acceleration=_root(acceleration),
        raw=_root(raw),
        bound=_root(bound),
        nees=float(nees.mean()),
        inside=float(inside.mean()),
        position_error=_error(position) / (2 * _root(position)),
        nees_error=_error(nees),
    )


def _means(runs: Runs) -> Array:
    """Return the means of each run (6, B) over its steps.

    They are the squared errors of position, velocity and acceleration and of the raw measurements, NEES, and
    whether the truth is inside the 95 % ellipsoid.
    """
    error, raw = runs.mean - runs.truth, runs.measured - runs.truth[..., :3]
    nees = normalised_squared(error, runs.covariance[:, None])
    squares = [np.sum(part**2, axis=-1) for part in (error[..., :3], error[..., 3:6], error[..., 6:], raw)]
    return np.asarray(np.mean([*squares, nees, nees < chi_square_threshold(0.95, 9)], axis=1))


def _error(values: Array) -> float:
    """The standard error of the mean of values (B,) of runs."""
    return float(np.std(values, ddof=1) / np.sqrt(len(values)))


def _root(squares: Array) -> float:
    return float(np.sqrt(squares.mean()))
