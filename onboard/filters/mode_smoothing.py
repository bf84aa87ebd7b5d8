"""Smoothing of a run of several modes: `multiple_model.interacting` over a whole record.

Going back, mode i of a time and mode j of the next share a belief of the next state: the prediction of i by the
model of j, updated by the later record under j. That update is the quotient of the smoothed belief of mode j and
its prediction, a Gaussian likelihood; it also weighs i against the other modes. Rauch, Tung and Striebel's step
leads each pair back, and the pairs of one mode i are merged. The only approximation is that each mode has one
Gaussian, as in the filter. (Kim 1994 takes the smoothed belief of j for every i: where a mode hardly moves, its
errors grow going back.)
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.filters.angles import beside
from onboard.filters.belief import Belief, FilterError, Indices, Method
from onboard.filters.multiple_model import ModesState
from onboard.filters.runs import Run
from onboard.filters.smoothers import transition_of


class SmoothedModes(NamedTuple):
    """A smoothed mixture.

    Attributes
    ----------
    mean : (T, ..., n)
        Mean.
    covariance : (T, ..., n, n)
        Covariance.
    probabilities : (T, ..., r)
        Smoothed probabilities of the modes.
    """

    mean: Array
    covariance: Array
    probabilities: Array


def smooth_modes(found: Run, modes: Sequence[Method], transition: Array) -> SmoothedModes:
    """Return the smoothed mixture and mode probabilities of a run.

    Parameters
    ----------
    found
        A run of `multiple_model.interacting(_, modes, transition)`.
    modes, transition
        The same as in the run.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    """
    if not isinstance(found.states[0], ModesState):
        raise FilterError(f"smooth_modes: {found.method.name} has no modes; `smooth` smooths it")
    beliefs = [_of_modes(modes, state) for state in found.states]
    after, probabilities = beliefs[-1], found.states[-1].probabilities
    angles = found.angular_states
    smoothed = [(*_merged(*after, probabilities, angles), probabilities)]
    for k in range(len(beliefs) - 2, -1, -1):
        if found.ts[k + 1] > found.ts[k]:
            after, probabilities = _back(found, k, beliefs[k], after, probabilities, modes, transition)
        smoothed.append((*_merged(*after, probabilities, angles), probabilities))
    return SmoothedModes(*(np.stack(part[::-1]) for part in zip(*smoothed, strict=True)))


def _back(
    found: Run,
    k: int,
    now: Belief,
    after: Belief,
    probabilities: Array,
    modes: Sequence[Method],
    transition: Array,
) -> tuple[Belief, Array]:
    """Return the modes' smoothed beliefs and probabilities (..., r) of time k.

    They follow from those of the next time.
    """
    r, n = now.mean.shape[-2:]
    model, before, angles = found.at(k + 1), found.states[k].probabilities, found.angular_states
    flat = Belief(now.mean.reshape(-1, n), now.covariance.reshape(-1, n, n))
    pairs, weights = [], []
    for j in range(r):
        process, Q = (one[j] if isinstance(one, tuple) else one for one in (model.process, model.Q))
        linear = transition_of(modes[j].name, flat, model._replace(process=process, Q=Q))
        F, noise, inputs = (part.reshape(*now.mean.shape[:-1], *part.shape[1:]) for part in linear)
        later = Belief(after.mean[..., j, :], after.covariance[..., j, :, :])
        moved = beside(_times(F, now.mean) + inputs, later.mean[..., None, :], angles)
        predicted = Belief(moved, F @ now.covariance @ _t(F) + noise)
        prior = before * np.asarray(transition)[:, j]
        share = _normalised(prior)
        updated, log_likelihood = _updated(predicted, _merged(*predicted, share), later)
        gain = _t(np.linalg.solve(predicted.covariance, F @ now.covariance))
        mean = now.mean + _times(gain, updated.mean - predicted.mean)
        spread = gain @ (updated.covariance - predicted.covariance) @ _t(gain)
        pairs.append((mean, now.covariance + spread))
        scaled = np.exp(log_likelihood - log_likelihood.max(axis=-1, keepdims=True))
        weights.append(_normalised(share * scaled) * probabilities[..., j, None])
    joint = np.stack(weights, axis=-1)  # of mode i now and j next
    means, covariances = np.stack([m for m, _ in pairs], -2), np.stack([C for _, C in pairs], -3)
    return _merged(means, covariances, _normalised(joint), angles), _normalised(joint.sum(axis=-1))


def _updated(predicted: Belief, mixture: Belief, smoothed: Belief) -> tuple[Belief, Array]:
    """Return predictions (..., r, n) of one mode from each, updated by the later record.

    The update is the quotient of the mode's smoothed belief (..., n) and its prediction, the mixture (..., n).
    Also returns the log of its integral over each. It is computed in coordinates z in which the mixture has mean
    zero and covariance one, and the quotient is exp(h z - z w z / 2) with w diagonal. In a direction without later
    information w is zero, or below by rounding.
    """
    L = np.linalg.cholesky(mixture.covariance)
    info = _t(L) @ np.linalg.solve(smoothed.covariance, L)
    gained, V = np.linalg.eigh(0.5 * (info + _t(info)) - np.eye(L.shape[-1]))
    off = np.linalg.solve(smoothed.covariance, (smoothed.mean - mixture.mean)[..., None])
    h = np.where(gained > 0, (_t(L @ V) @ off)[..., 0], 0.0)[..., None, :]
    w = np.maximum(gained, 0.0)[..., None, :]
    axes = (L @ V)[..., None, :, :]
    z = np.linalg.solve(axes, (predicted.mean - mixture.mean[..., None, :])[..., None])[..., 0]
    C = np.linalg.solve(axes, _t(np.linalg.solve(axes, predicted.covariance)))
    root = np.sqrt(w)
    S = np.eye(L.shape[-1]) + root[..., :, None] * C * root[..., None, :]
    half = np.linalg.solve(S, root[..., :, None] * C)
    posterior = C - (C * root[..., None, :]) @ half
    pull = h - w * z
    moved = _times(posterior, pull)
    mean = mixture.mean[..., None, :] + _times(axes, z + moved)
    log_l = np.sum(h * z - 0.5 * w * z**2 + 0.5 * pull * moved, -1) - 0.5 * np.linalg.slogdet(S)[1]
    return Belief(mean, axes @ posterior @ _t(axes)), np.asarray(log_l)


def _of_modes(modes: Sequence[Method], state: ModesState) -> Belief:
    each = [method.belief(one) for method, one in zip(modes, state.states, strict=True)]
    return Belief(np.stack([b.mean for b in each], axis=-2), np.stack([b.covariance for b in each], axis=-3))


def _merged(means: Array, covariances: Array, weights: Array, angles: Indices = ()) -> Belief:
    """Return the mixture of means (..., r, n) and covariances, with weights (..., r).

    Angles are within pi of those of the first mean.
    """
    means = beside(means, means[..., :1, :], angles)
    mean = np.sum(weights[..., None] * means, axis=-2)
    off = means - mean[..., None, :]
    each = covariances + off[..., :, None] * off[..., None, :]
    total = np.sum(weights[..., None, None] * each, axis=-3)
    return Belief(mean, 0.5 * (total + _t(total)))


def _normalised(weights: Array) -> Array:
    """Scale weights to sum one over the last axis.

    They become equal if all are zero, of an impossible mode.
    """
    total = weights.sum(axis=-1, keepdims=True)
    return np.where(total > 0, weights / np.where(total > 0, total, 1), 1 / weights.shape[-1])


def _times(A: Array, x: Array) -> Any:
    return (A @ x[..., None])[..., 0]


def _t(A: Any) -> Any:
    return np.swapaxes(A, -1, -2)
