"""The problems that every filter method is held to, and how to run one on them."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest

from onboard.arrays import Array
from onboard.filters.belief import Belief, FilterError, Method, Rows
from tests.support.filter_problems import spd


class Linear(NamedTuple):
    """x' = F x + noise Q, y = H x + noise R, from mean and covariance P."""

    F: Array
    H: Array
    Q: Array
    R: Array
    mean: Array
    P: Array

    def process(self, rows: Array) -> Array:
        return np.asarray(rows @ self.F.T)

    def measure(self, rows: Array) -> Array:
        return np.asarray(rows @ self.H.T)


def linear(rng: np.random.Generator, method: Method, n: int = 4) -> Linear:
    """A well-conditioned problem; all states are measured where the method asks for that."""
    m = n if "partial" in method.exempt else 2
    H = np.eye(n) if m == n else rng.normal(0, 1, (m, n))
    F = np.eye(n) + 0.1 * rng.normal(0, 1, (n, n))
    return Linear(F, H, 0.01 * spd(rng, n), spd(rng, m), rng.normal(0, 3, n), spd(rng, n))


def ill_conditioned(method: Method) -> Linear:
    """Two axes (x, v_x, y, v_y) known at first to a kilometre, then measured to a millimetre and to ten metres."""
    axis = np.array([[1.0, 0.1], [0.0, 1.0]])
    F = np.kron(np.eye(2), axis)
    H, R = np.eye(4)[[0, 2]], np.diag([1e-6, 1e2])
    if "partial" in method.exempt:
        H, R = np.eye(4), np.diag([1e-6, 1e-4, 1e2, 1e-1])
    noise = np.array([[1e-3 / 3, 1e-2 / 2], [1e-2 / 2, 1e-1]])  # of a velocity's random walk over 0.1 s
    Q = np.kron(np.diag([1e-6, 1.0]), noise)
    return Linear(F, H, Q, R, np.zeros(4), np.diag([1e6, 1e2, 1e6, 1e2]))


def simulate(rng: np.random.Generator, problem: Linear, runs: int, steps: int) -> tuple[Array, Array]:
    """Truths (steps, runs, n) and measurements (steps, runs, m) drawn from the very model."""
    n, m = len(problem.F), len(problem.H)
    x = rng.multivariate_normal(problem.mean, problem.P, runs)
    truths, seen = np.empty((steps, runs, n)), np.empty((steps, runs, m))
    for k in range(steps):
        x = problem.process(x) + rng.multivariate_normal(np.zeros(n), problem.Q, runs)
        truths[k] = x
        seen[k] = problem.measure(x) + rng.multivariate_normal(np.zeros(m), problem.R, runs)
    return truths, seen


def track(method: Method, problem: Linear, seen: Array, angular: tuple[int, ...] = ()) -> tuple[Any, list[Any]]:
    """The last state and all updates over measurements (steps, m), or (steps, B, m) with a batch axis."""
    mean, P = problem.mean, problem.P
    if seen.ndim == 3:
        mean, P = np.tile(mean, (seen.shape[1], 1)), np.tile(P, (seen.shape[1], 1, 1))
    state, updates = method.start(mean, P), []
    for y in seen:
        state = method.predict(state, problem.process, problem.Q)
        updates.append(method.update(state, y, problem.measure, problem.R, angular))
        state = updates[-1].belief
    return state, updates


def ensemble(method: Method, problem: Linear, seen: Array) -> tuple[Belief, Array]:
    """Beliefs and NIS (B,) after measurements (steps, B, m), in a loop where a method takes no batch."""
    if "batch" not in method.exempt:
        state, updates = track(method, problem, seen)
        return method.belief(state), np.asarray(updates[-1].nis)
    each = [track(method, problem, np.ascontiguousarray(seen[:, b])) for b in range(seen.shape[1])]
    beliefs = [method.belief(state) for state, _ in each]
    stacked = Belief(np.array([b.mean for b in beliefs]), np.array([b.covariance for b in beliefs]))
    return stacked, np.array([updates[-1].nis for _, updates in each])


def kalman(problem: Linear, seen: Array) -> Belief:
    """The textbook's filter, with an explicit inverse."""
    x, P = problem.mean, problem.P
    for y in seen:
        x, P = problem.F @ x, problem.F @ P @ problem.F.T + problem.Q
        K = P @ problem.H.T @ np.linalg.inv(problem.H @ P @ problem.H.T + problem.R)
        x, P = x + K @ (y - problem.H @ x), (np.eye(len(x)) - K @ problem.H) @ P
    return Belief(x, P)


def in_sigmas(a: Belief, mean: Array, covariance: Array) -> tuple[float, float]:
    """Largest difference of means and of covariances, in standard deviations of each state, since the states
    differ by orders of magnitude."""
    sigma = np.sqrt(np.diag(a.covariance))
    return (
        float(np.max(np.abs(a.mean - mean) / sigma)),
        float(np.max(np.abs(a.covariance - covariance) / np.outer(sigma, sigma))),
    )


def cases(methods: dict[str, Method], prop: str | None = None) -> list[Any]:
    """Parameters of a test over all methods; those exempt from `prop` must fail it, for the reason they give."""

    def marks(method: Method) -> tuple[Any, ...]:
        if prop not in method.exempt:
            return ()
        reason = method.exempt[prop]
        return (pytest.mark.xfail(reason=reason, raises=(AssertionError, FilterError), strict=True),)

    return [pytest.param(method, id=name, marks=marks(method)) for name, method in methods.items()]


def arrays_of(state: Any) -> list[Array]:
    """All arrays in nested tuples."""
    if isinstance(state, np.ndarray):
        return [state]
    return [array for part in state for array in arrays_of(part)] if isinstance(state, tuple) else []


def locked(state: Any) -> Any:
    """The same, its arrays made read-only."""
    for array in arrays_of(state):
        array.flags.writeable = False
    return state


def broken(rows_of: Rows, value: float) -> Callable[[Array], Array]:
    """A model one of whose numbers is not one."""

    def model(rows: Array) -> Array:
        made = rows_of(rows).copy()
        made[-1, 0] = value
        return made

    return model
