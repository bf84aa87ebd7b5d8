"""Problems for filters: random linear systems, a nonlinear process and a radar, with Jacobians."""

from collections.abc import Callable
from typing import Any

import numpy as np

from onboard.arrays import Array


def spd(rng: np.random.Generator, n: int, lead: tuple[int, ...] = ()) -> Array:
    """Covariances (*lead, n, n)."""
    A = rng.normal(0, 1, (*lead, n, n))
    return np.asarray(A @ np.swapaxes(A, -1, -2) + 0.1 * np.eye(n))


def rows(M: Array) -> Callable[[Array], Array]:
    """The linear model M x over rows of states."""
    return lambda x: np.asarray(x @ M.T)


def identity(x: Array) -> Array:
    """All states, as they are."""
    return x.copy()


def system(seed: int, n: int = 4, m: int = 2) -> tuple[Array, Array, Array, Array, Array, Array, Array]:
    """F, H, Q, R, mean, P and 15 measurements (15, m)."""
    rng = np.random.default_rng(seed)
    F, H = np.eye(n) + 0.1 * rng.normal(0, 1, (n, n)), rng.normal(0, 1, (m, n))
    return F, H, 0.1 * spd(rng, n), spd(rng, m), rng.normal(0, 3, n), spd(rng, n), rng.normal(0, 3, (15, m))


def near(seed: int, m: int = 4) -> tuple[Array, Array, Array, Array, Array]:
    """A prior and a measurement that is close to what it predicts: H, R, mean, P, y."""
    _, H, _, R, x, P, _ = system(seed, 4, m)
    return H, R, x, P, H @ x + 0.3 * np.random.default_rng(seed).normal(0, 1, m)


def bend(x: Any) -> Any:
    """A process with products and sines."""
    return x + 0.05 * np.sin(x) * x[:, ::-1]


def bend_slope(x: Any) -> Any:
    """Its Jacobians (B, n, n)."""
    n = x.shape[1]
    slope = np.tile(np.eye(n), (len(x), 1, 1))
    for i in range(n):
        slope[:, i, i] += 0.05 * np.cos(x[:, i]) * x[:, n - 1 - i]
        slope[:, i, n - 1 - i] += 0.05 * np.sin(x[:, i])
    return slope


def radar(x: Any) -> Any:
    """Range and bearing of the first two states."""
    return np.stack([np.hypot(x[:, 0], x[:, 1]), np.arctan2(x[:, 1], x[:, 0])], axis=1)


def radar_slope(x: Any) -> Any:
    """Its Jacobians (B, 2, n)."""
    a, b = x[:, 0], x[:, 1]
    r, slope = np.hypot(a, b), np.zeros((len(x), 2, x.shape[1]))
    slope[:, 0, 0], slope[:, 0, 1], slope[:, 1, 0], slope[:, 1, 1] = a / r, b / r, -b / r**2, a / r**2
    return slope
