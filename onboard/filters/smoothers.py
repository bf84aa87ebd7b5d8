"""Smoothing of a run, by the whole record or with a fixed lag.

    found = run("unscented", model, start, ys, ts)
    smoothed = smooth(found)                  # Rauch, Tung & Striebel, by the family's own linearisation
    delayed = smooth(found, lag=5)            # a filter's knowledge five measurements later

Gaussian families: "kalman" by its matrices, "extended" by Jacobians, and all that draw points by the regression of
the process over them. Several modes: `mode_smoothing`; particles: `particle_smoothing`.
"""

from typing import Any, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.filters import cubature, extended, kalman, turns
from onboard.filters.belief import Belief, FilterError, Indices, Weights
from onboard.filters.errors import SpreadError
from onboard.filters.multiple_model import ModesState
from onboard.filters.posterior_linearisation import regression
from onboard.filters.runs import Run
from onboard.filters.smoothing import rauch_tung_striebel
from onboard.filters.state_space import AnyModel, LinearModel, Model


class Transitions(NamedTuple):
    """Transitions x' = F x + inputs + noise Q of (T-1, ...) steps."""

    F: Array
    Q: Array
    inputs: Array


def smooth(found: Run, lag: int | None = None, weights: Weights | None = None) -> Belief:
    """Return smoothed beliefs of all times, mean (T, ..., n) and covariance (T, ..., n, n).

    Parameters
    ----------
    found
        A run.
    lag
        Maximum number of later measurements that each belief uses; None: the whole record.
    weights
        Sigma-point weights of filters that draw points; None: those of the cubature filter.

    Raises
    ------
    FilterError
        For a filter that is not Gaussian, or of modes (`smooth_modes`).
    NotPositiveDefiniteError
        If a covariance is not positive definite, or not finite.
    """
    if found.states and isinstance(found.states[0], ModesState):
        raise FilterError("smooth: takes one filter; that of several modes has `smooth_modes`")
    if found.method.name == "particle":
        raise FilterError("smooth: takes a Gaussian filter; a cloud of particles has `smooth_particles`")
    reason = found.method.exempt.get("kalman")
    if reason:
        raise FilterError(f"smooth: {found.method.name} cannot be smoothed by its covariance: {reason}")
    steps = len(found.ts)
    if steps < 2:
        return found.beliefs
    if found.lost:
        return _of_those_left(found, lag, weights)
    transitions = transitions_of(found, weights)
    if lag is None or lag >= steps - 1:
        return rauch_tung_striebel(found.beliefs, *transitions, found.angular_states)
    if lag < 0:
        raise FilterError(f"lag: must be 0 or more measurements, not {lag}")
    return found.beliefs if lag == 0 else _fixed_lag(found, transitions, lag)


def _of_those_left(found: Run, lag: int | None, weights: Weights | None) -> Belief:
    """Smooth a batch in which filters were lost, each of these up to its last measurement."""
    made = Belief(*(np.full_like(part, np.nan) for part in found.beliefs))
    gone = [one.member for one in found.lost]
    parts: list[tuple[Any, int]] = [(np.setdiff1d(np.arange(made.mean.shape[1]), gone), len(found.ts))]
    for at, upto in parts + [(np.array([one.member]), one.k) for one in found.lost]:
        beliefs = Belief(*(part[:upto, at] for part in found.beliefs))
        # The model of a step depends on the ends of the record.
        alone = found._replace(beliefs=beliefs, ts=found.ts[:upto], model=_upto(found.model, upto), lost=())
        for array, part in zip(made, smooth(alone, lag, weights), strict=True):
            array[:upto, at] = part
    return made


def _upto(model: AnyModel, steps: int) -> AnyModel:
    """Return the model of the first steps of a record."""
    if not isinstance(model, LinearModel):
        return model
    F, Q = (a[: steps - 1] if a.ndim == 3 else a for a in (model.F, model.Q))
    H, R = (a[:steps] if a.ndim == 3 else a for a in (model.H, model.R))
    return model._replace(F=F, Q=Q, H=H, R=R, inputs=None if model.inputs is None else model.inputs[: steps - 1])


def transitions_of(found: Run, weights: Weights | None = None) -> Transitions:
    """Return the process over each step as a linear transition.

    It is linearised where the filter was.
    """
    mean, P = found.beliefs.mean[:-1], found.beliefs.covariance[:-1]
    if callable(found.model):
        each = [_transition(found, Belief(mean[k], P[k]), k + 1, weights) for k in range(len(mean))]
        return Transitions(*(np.stack(part) for part in zip(*each, strict=True)))
    if isinstance(found.model, LinearModel):
        shape = (len(mean), *(1,) * (mean.ndim - 2))
        u = np.zeros(mean.shape[-1]) if found.model.inputs is None else found.model.inputs
        F, Q = (
            np.broadcast_to(a.reshape(-1 if a.ndim == 3 else 1, *shape[1:], *a.shape[-2:]), P.shape)
            for a in (found.model.F, found.model.Q)
        )
        u = np.broadcast_to(u.reshape(-1 if u.ndim == 2 else 1, *shape[1:], u.shape[-1]), mean.shape)
        return Transitions(F, Q, u)
    n = mean.shape[-1]
    flat = Belief(mean.reshape(-1, n), P.reshape(-1, n, n))
    made = transition_of(found.method.name, flat, found.model, weights)
    transitions = Transitions(*(part.reshape(*mean.shape[:-1], *part.shape[1:]) for part in made))
    again = np.flatnonzero(np.diff(found.ts) == 0)  # nothing is predicted where a time repeats
    transitions.F[again], transitions.Q[again], transitions.inputs[again] = np.eye(n), 0, 0
    return transitions


def _transition(found: Run, belief: Belief, k: int, weights: Weights | None = None) -> Transitions:
    if found.ts[k] == found.ts[k - 1]:
        P = belief.covariance
        return Transitions(np.zeros_like(P) + np.eye(P.shape[-1]), 0 * P, 0 * belief.mean)
    step = found.at(k)
    return transition_of(found.method.name, belief, step, weights)


def transition_of(name: str, belief: Belief, model: Model, weights: Weights | None = None) -> Transitions:
    """Return the linear transition of a model's process about beliefs (..., n).

    The linearisation is that of the filter `name`.
    """
    process, angles = model.process, model.angular_states
    if name == "kalman":
        (F, value), rest = kalman.affine(process, belief.mean, None, angles), 0 * belief.covariance
    elif name == "extended":
        value, F = extended.tangent(belief, process, model.process_jacobian, None, angles)
        rest = 0 * belief.covariance
    else:
        rule = weights or cubature.weights(belief.mean.shape[-1])
        F, value, rest = _regression(belief, process, rule, angles)
    return Transitions(F, model.Q + rest, value - (F @ belief.mean[..., None])[..., 0])


def _regression(belief: Belief, process: Any, rule: Weights, angles: Indices) -> tuple[Array, Array, Array]:
    """Return the process's regression over beliefs (..., n).

    It is by `turns` if an angle is too wide for points.
    """
    try:
        return regression(belief, process, rule, None, angles, angles)
    except SpreadError:
        if belief.mean.ndim == 1:
            if not turns.is_wide(belief, angles):
                raise
            return turns.transition(belief, process, angles)
        each = [_regression(Belief(*one), process, rule, angles) for one in zip(*belief, strict=True)]
        F, value, rest = (np.stack(part) for part in zip(*each, strict=True))
        return F, value, rest


def _fixed_lag(found: Run, transitions: Transitions, lag: int) -> Belief:
    """Smooth each window of lag + 1 times from its end, all at once as one batch.

    The last one gives the end.
    """
    filtered = found.beliefs
    shape, n = filtered.mean.shape, filtered.mean.shape[-1]
    windows = shape[0] - lag
    at = np.arange(lag + 1)[:, None] + np.arange(windows)

    def batch(array: Array, index: Any) -> Array:
        picked: Array = array[index]
        return picked.reshape(len(index), -1, *picked.shape[len(shape) :])

    mean, P = batch(filtered.mean, at), batch(filtered.covariance, at)
    F, Q, inputs = (batch(part, at[:-1]) for part in transitions)
    smoothed = rauch_tung_striebel(Belief(mean, P), F, Q, inputs, found.angular_states)
    parts = []
    for array, own in ((smoothed.mean, (n,)), (smoothed.covariance, (n, n))):
        apart = array.reshape(lag + 1, windows, *shape[1:-1], *own)
        parts.append(np.concatenate([apart[0], apart[1:, -1]]))
    return Belief(*parts)
