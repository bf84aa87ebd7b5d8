"""Estimation of a model's parameters from a record.

    def likelihood(theta):  # of the logarithms, so that variances stay positive
        Q, R = np.exp(theta)
        model = LinearModel(F, np.array([[Q]]), H, np.array([[R]]))
        return run("kalman", model, start, ys).log_likelihood.sum()

    found = maximum_likelihood(likelihood, guess)               # found.theta, its covariance, the likelihood
    fit = expectation_maximisation(model, start, ys)            # fit.model.Q, fit.model.R

Maximum likelihood works for any filter, expectation-maximisation for a linear model. If nothing is known of the
first state, start with a variance far above that of the record, and leave the first measurements, which the start
explains, out of the sum: `log_likelihood[1:]`.
"""

from collections.abc import Callable, Collection
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from onboard.arrays import Array
from onboard.filters.belief import Belief, FilterError, NotPositiveDefiniteError
from onboard.filters.runs import Run, run
from onboard.filters.smoothers import smooth
from onboard.filters.state_space import LinearModel

ESTIMATED_PARTS: Final = ("F", "Q", "R", "start")
LIKELIHOOD_TOLERANCE: Final = 1e-9  # relative rounding of a sum of log-likelihoods
DIFFERENCE_STEP: Final = 1e-3  # of second differences, in units of theta


class Maximum(NamedTuple):
    """The maximum of a likelihood.

    Attributes
    ----------
    theta : (p,)
        Parameters.
    covariance : (p, p)
        Their covariance by the curvature; NaN where the likelihood has no maximum in some direction.
    log_likelihood
        Log-likelihood at the maximum.
    converged
        Whether the search converged, to a maximum in each direction.
    """

    theta: Array
    covariance: Array
    log_likelihood: float
    converged: bool = True


class Fit(NamedTuple):
    """A fitted model and first belief.

    Attributes
    ----------
    log_likelihood
        Log-likelihood before each iteration, which never decreases.
    converged
        Whether the last iteration gained less than the tolerance. It is False if the iterations ran out, and if
        the model fits the record exactly: variances then fall towards zero, and the likelihood has no bound. The
        model is then the last one that a filter accepts.
    """

    model: LinearModel
    start: Belief
    log_likelihood: Array
    converged: bool = True


def maximum_likelihood(log_likelihood: Callable[[Array], float], guess: ArrayLike) -> Maximum:
    """Maximise a function of parameters (p,) from a guess, by SciPy's BFGS.

    Parameters should be of order one: take logarithms of variances. If a filter refuses its parameters, the
    likelihood counts as zero.

    Parameters
    ----------
    log_likelihood
        Function of the parameters (p,).
    guess : (p,)
        First parameters.

    Raises
    ------
    FilterError
        If it finds no maximum.
    """
    from scipy.optimize import minimize as search  # noqa: PLC0415 - half a second, for what is rarely called

    minimize: Any = search  # its many types know no function that may be anything

    def cost(theta: Array) -> float:
        try:
            value = float(log_likelihood(theta))
        except FilterError:
            return np.inf
        return -value if np.isfinite(value) else np.inf

    first = np.asarray(guess, float)
    if not np.isfinite(cost(first)):
        log_likelihood(first)  # raises what the filter says
        raise FilterError(f"guess: the log-likelihood is not finite at {first}")
    rough, fine = {"xatol": 1e-2, "fatol": 1e-2}, {"gtol": 1e-6 * max(1.0, abs(cost(first)))}
    coarse = minimize(cost, first, method="Nelder-Mead", options=rough)
    found = minimize(cost, coarse.x, method="BFGS", jac="3-point", options=fine)
    best = min((coarse, found), key=lambda one: float(one.fun))
    if not np.isfinite(best.fun) or not np.isfinite(best.x).all():
        raise FilterError(f"log_likelihood: no maximum found from {first}: {found.message}")
    covariance = _curvature(cost, best.x)
    is_maximum = bool(best.success) and bool(np.isfinite(covariance).all())
    return Maximum(best.x, covariance, -float(best.fun), is_maximum)


def _curvature(cost: Callable[[Array], float], theta: Array) -> Array:
    """Return the inverse of the matrix of second derivatives.

    NaN if it is not positive definite.
    """
    p = len(theta)
    offsets = DIFFERENCE_STEP * np.eye(p)
    hessian = np.empty((p, p))
    for i in range(p):
        for j in range(i + 1):
            corners = [cost(theta + a * offsets[i] + b * offsets[j]) for a in (1, -1) for b in (1, -1)]
            hessian[i, j] = hessian[j, i] = (corners[0] - corners[1] - corners[2] + corners[3]) / (
                4 * DIFFERENCE_STEP**2
            )
    if not np.isfinite(hessian).all() or np.linalg.eigvalsh(hessian)[0] <= 0:
        return np.full((p, p), np.nan)
    return np.asarray(np.linalg.inv(hessian))


def expectation_maximisation(
    model: LinearModel,
    start: Belief,
    ys: Any,
    estimate: Collection[str] = ("Q", "R"),
    iterations: int = 100,
    tolerance: float = 1e-6,
) -> Fit:
    """Improve parts of a linear model by expectation-maximisation (Shumway & Stoffer 1982).

    Matrices are estimated in full, H is kept.

    Parameters
    ----------
    model, start, ys
        As in `run`, also with missing values; a batch is as many records of one model.
    estimate
        Parts to improve: "F", "Q", "R", "start" (the first belief).
    iterations
        Maximum number of iterations.
    tolerance
        Relative gain of the log-likelihood at which to stop.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    NotPositiveDefiniteError
        If a covariance is not positive definite, or not finite.
    """
    unknown = set(estimate) - set(ESTIMATED_PARTS)
    if unknown or any(np.ndim(a) != 2 for a in (model.F, model.Q, model.H, model.R)):
        wanted = f"must be of {', '.join(ESTIMATED_PARTS)}, of a model that does not change"
        raise FilterError(f"estimate: {wanted}, not {sorted(estimate)}")
    history: list[float] = []
    before, found = (model, start), None
    for _ in range(iterations):
        try:
            found = run("kalman", model, start, ys)
            assert isinstance(found.model, LinearModel)  # noqa: S101 - for mypy; its arrays fit the record
            after = _maximised(found, found.model, start, estimate)
        except NotPositiveDefiniteError:
            if not history:
                raise
            return Fit(*before, np.array(history), converged=False)
        value = float(found.log_likelihood.sum())
        if history and value < history[-1]:  # by rounding
            return Fit(
                *before, np.array(history), history[-1] - value < max(tolerance, LIKELIHOOD_TOLERANCE) * abs(value)
            )
        history.append(value)
        if len(history) > 1 and history[-1] - history[-2] < tolerance * abs(history[-1]):
            return Fit(model, start, np.array(history), converged=True)
        before, (model, start) = (model, start), after
    return Fit(model, start, np.array(history), converged=False)


def _maximised(
    found: Run, model: LinearModel, start: Belief, estimate: Collection[str]
) -> tuple[LinearModel, Belief]:
    """Return the model that maximises the expected likelihood, by the smoothed record."""
    mean, P = smooth(found)
    u = 0 if model.inputs is None else model.inputs.reshape(len(mean) - 1, *(1,) * (mean.ndim - 2), -1)
    if len(mean) < 2 and {"F", "Q"} & set(estimate):
        raise FilterError("ys: F and Q need at least two measurements")
    filtered, forecast = found.beliefs.covariance[:-1], found.predictions.covariance[1:]
    try:
        gain_t = np.linalg.solve(forecast, model.F @ filtered)  # the smoother's gain, transposed
    except np.linalg.LinAlgError as error:
        raise NotPositiveDefiniteError("Q: leaves a prediction without noise in some direction") from error
    second = P + mean[..., :, None] * mean[..., None, :]
    moved = mean[1:] - u
    axes = tuple(range(mean.ndim - 1))
    next_now = np.sum(P[1:] @ gain_t + moved[..., :, None] * mean[:-1, ..., None, :], axis=axes)
    now_now = np.sum(second[:-1], axis=axes)
    changes: dict[str, Any] = {}
    F = np.linalg.solve(now_now, next_now.T).T if "F" in estimate else model.F
    if "F" in estimate:
        changes["F"] = F
    if "Q" in estimate:
        # A sum of squares, which stays positive in rounding: of the motion of the means, and the smoother's error.
        gain, n = _t(gain_t), mean.shape[-1]
        off = moved - mean[:-1] @ F.T
        left, right = np.eye(n) - F @ gain, F @ (np.eye(n) - gain @ model.F)
        parts = left @ P[1:] @ _t(left) + right @ filtered @ _t(right) + F @ gain @ model.Q @ _t(F @ gain)
        total = np.sum(off[..., :, None] * off[..., None, :] + parts, axis=axes)
        changes["Q"] = _symmetric(total / moved[..., 0].size)
    if "R" in estimate:
        changes["R"] = _noise(found, model, Belief(mean, P))
    first = Belief(mean[0], P[0]) if "start" in estimate else start
    return model._replace(**changes), first


def _noise(found: Run, model: LinearModel, smoothed: Belief) -> Array:
    """Return the expected mean square of the measurements' errors.

    Missing components are expected as R has them, by the components that are there; a time without any does not
    count.
    """
    y = (found.innovation + found.predicted).reshape(-1, len(model.H))
    mean, P = (a.reshape(len(y), *a.shape[-k:]) for a, k in zip(smoothed, (1, 2), strict=True))
    error, spread = y - mean @ model.H.T, model.H @ P @ model.H.T
    total, count, R = np.zeros_like(model.R), 0, model.R
    present = ~np.isnan(y)
    for pattern in np.unique(present, axis=0):
        rows = np.flatnonzero((present == pattern).all(axis=1))
        if not pattern.any():
            continue
        seen = np.flatnonzero(pattern)
        fill = R[:, seen] @ np.linalg.inv(R[np.ix_(seen, seen)])
        e = error[rows][:, seen]
        known = e.T @ e + np.sum(spread[rows][:, seen][:, :, seen], axis=0)
        total = total + fill @ known @ fill.T + len(rows) * (R - fill @ R[seen])
        count += len(rows)
    if not count:
        raise FilterError("ys: nothing is measured")
    return _symmetric(total / count)


def _t(A: Any) -> Any:
    return np.swapaxes(A, -1, -2)


def _symmetric(A: Array) -> Array:
    return 0.5 * (A + A.T)
