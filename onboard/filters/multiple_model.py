"""Interacting multiple model estimator (Blom & Bar-Shalom 1988).

    imm = (method, method, method)                                   # any of `filters.methods()`, a mode each
    state = start(imm, mean, covariance, probabilities)
    state = predict(imm, state, processes, noises, transition)       # one process and one Q for each mode
    state = update(imm, state, y, measures, R).belief

Several filters, each with its own model, are mixed before every prediction, by the probabilities of a transition
from one mode to another. All modes have the same states. A filter that carries more than a belief keeps it through
the mixing if its state has fields `mean` and `covariance`; any other is restarted from the mixed belief. With a
leading batch axis each filter of the batch has its own probabilities.
"""

from collections.abc import Callable, Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.filters import unscented
from onboard.filters.angles import beside
from onboard.filters.belief import Belief, Indices, Method, Rows, Update, mask
from onboard.filters.errors import FilterError, raise_status
from onboard.filters.kernels import multiple_model as kernels


class ModesState(NamedTuple):
    """The state of an interacting multiple model.

    Attributes
    ----------
    states
        Filter state of each mode.
    probabilities : (..., r)
        Probabilities of the modes.
    angular_states
        Indices of states that are angles.
    """

    states: tuple[Any, ...]
    probabilities: Array
    angular_states: Indices = ()


class ModesUpdate(NamedTuple):
    """The five fields of `belief.Update` for the mixture, and each mode's log-likelihood.

    The log-likelihood is (..., r).
    """

    belief: ModesState
    innovation: Array
    innovation_covariance: Array
    predicted: Array
    nis: Any
    log_likelihood: Array


def start(
    methods: Sequence[Method],
    mean: Array,
    covariance: Array,
    probabilities: Array,
    angular_states: Indices = (),
) -> ModesState:
    """Return the state of all modes with one belief.

    Parameters
    ----------
    methods
        One filter for each of r modes.
    mean : (..., n)
        Mean.
    covariance : (..., n, n)
        Covariance.
    probabilities : (r,) or (..., r)
        Probabilities of the modes.
    angular_states
        Indices of states that are angles (`angles`): modes are mixed by differences that wrap.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    """
    states = tuple(method.start(mean, covariance) for method in methods)
    mask(angular_states, mean.shape[-1])
    weights = np.asarray(probabilities, float)
    if weights.shape[-1:] != (len(methods),) or not _sum_to_one(weights):
        raise FilterError(f"probabilities: must be {len(methods)} that are not negative and sum to one")
    return ModesState(states, np.broadcast_to(weights, (*mean.shape[:-1], len(methods))).copy(), angular_states)


def predict(
    methods: Sequence[Method],
    state: ModesState,
    processes: Sequence[Rows],
    noises: Sequence[Array],
    transition: Array,
) -> ModesState:
    """Mix the modes, then predict each with its process and Q.

    A mode that no transition leads to has probability zero and nothing to mix; it keeps its own belief.

    Parameters
    ----------
    methods
        The filters, as in `start`.
    processes, noises
        A process and its Q for each mode.
    transition : (r, r)
        Row i has the probabilities of the transitions from mode i to each mode.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    NotPositiveDefiniteError
        If a covariance is not positive definite, or not finite.
    """
    r = len(methods)
    if np.shape(transition) != (r, r) or not _sum_to_one(np.asarray(transition)):
        raise FilterError(f"transition: must be ({r}, {r}), not negative, with rows that sum to one")
    if len(processes) != r or len(noises) != r:
        raise FilterError(f"processes, noises: must be {r} each, not {len(processes)} and {len(noises)}")
    joint = state.probabilities[..., :, None] * np.asarray(transition)
    ahead = joint.sum(axis=-2)
    possible = ahead[..., None, :] > 0
    mixing = np.where(possible, joint / np.where(possible, ahead[..., None, :], 1), np.eye(r))
    mixed = mixture(_beliefs(methods, state, _carried), mixing)
    states = [
        method.predict(with_belief(method, old, belief), process, Q, state.angular_states)
        for method, old, belief, process, Q in zip(methods, state.states, mixed, processes, noises, strict=True)
    ]
    return ModesState(tuple(states), ahead / ahead.sum(axis=-1, keepdims=True), state.angular_states)


def update(
    methods: Sequence[Method],
    state: ModesState,
    y: Array,
    measures: Sequence[Rows],
    R: Array,
    angular: tuple[int, ...] = (),
) -> ModesUpdate:
    """Update each mode with its measurement function, and its probability.

    Probabilities are weighed by the likelihood of y, in logarithms: they remain a distribution however unlikely y
    is under all modes.

    Parameters
    ----------
    methods
        The filters, as in `start`.
    y : (..., m)
        Measured values.
    measures
        A measurement function for each mode.
    R : (..., m, m)
        Covariance of the measurement noise.
    angular
        Components of y that are angles and wrap.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    NotPositiveDefiniteError
        If a covariance is not positive definite, or not finite.
    """
    if len(measures) != len(methods):
        raise FilterError(f"measures: must be {len(methods)}, not {len(measures)}")
    updates = [
        method.update(mode, y, measure, R, angular, state.angular_states)
        for method, mode, measure in zip(methods, state.states, measures, strict=True)
    ]
    innovations = np.stack([u.innovation for u in updates], axis=-2)
    S = np.stack([u.innovation_covariance for u in updates], axis=-3)
    nis = np.stack([u.nis for u in updates], axis=-1)
    arrays = (innovations, S, nis, state.probabilities)
    single = innovations.ndim == 2
    innovations, S, nis, prior = [array[None] for array in arrays] if single else arrays
    *outputs, status = kernels.weigh(innovations, S, nis, prior, mask(angular, y.shape[-1]))
    if status:
        raise_status(status, () if single else (len(innovations),))
    log_likelihood, posterior, e, S, mixed_nis = [output[0] for output in outputs] if single else outputs
    after = ModesState(tuple(u.belief for u in updates), posterior, state.angular_states)
    predicted = updates[0].predicted + (updates[0].innovation - e)
    return ModesUpdate(after, e, S, predicted, float(mixed_nis) if single else mixed_nis, log_likelihood)


def belief(methods: Sequence[Method], state: ModesState) -> Belief:
    """Return mean and covariance of the mixture of all modes."""
    return mixture(_beliefs(methods, state, _published), state.probabilities[..., None])[0]


def _sum_to_one(weights: Array) -> bool:
    return bool(weights.min() >= 0 and np.abs(weights.sum(axis=-1) - 1).max() < 1e-6)


def _beliefs(methods: Sequence[Method], state: ModesState, of: Callable[[Method, Any], Belief]) -> Belief:
    """Return the modes' beliefs, mean (..., r, n) and covariance (..., r, n, n).

    Angles are within pi of those of the most probable mode.
    """
    each = [of(method, mode) for method, mode in zip(methods, state.states, strict=True)]
    means = np.stack([b.mean for b in each], axis=-2)
    if state.angular_states:
        best = np.argmax(state.probabilities, axis=-1)[..., None, None]
        means = beside(means, np.take_along_axis(means, best, axis=-2), state.angular_states)
    return Belief(means, np.stack([b.covariance for b in each], axis=-3))


def _published(method: Method, mode: Any) -> Belief:
    """Return a mode's belief."""
    return method.belief(mode)


def _carried(method: Method, mode: Any) -> Belief:
    """Return the belief that a mode predicts from.

    It lacks additions that the mode's filter keeps apart.
    """
    return Belief(mode.mean, mode.covariance) if _carries_belief(mode) else method.belief(mode)


def mixture(beliefs: Belief, weights: Array) -> list[Belief]:
    """Return mean and covariance of a mixture for each column j of weights (..., r, j)."""
    arrays: list[Array] = [*beliefs, weights]
    if weights.ndim == 2:
        arrays = [array[None] for array in arrays]
    mix: Any = kernels.mix  # Numba's functions are not typed
    try:
        means, covariances = mix(*arrays)
    except TypeError as error:
        raise FilterError("mean, covariance: of different size among the modes") from error
    if weights.ndim == 2:
        means, covariances = means[0], covariances[0]
    return [Belief(means[..., j, :], covariances[..., j, :, :]) for j in range(weights.shape[-1])]


def with_belief(method: Method, state: Any, belief: Belief) -> Any:
    """Return the state with another belief.

    Its other fields are kept if it has fields for mean and covariance.
    """
    if _carries_belief(state):
        return state._replace(mean=belief.mean, covariance=belief.covariance)
    return method.start(*belief)


def _with_angles(state: ModesState, angular_states: Indices) -> ModesState:
    return state._replace(angular_states=angular_states) if angular_states else state


def _carries_belief(state: Any) -> bool:
    return {"mean", "covariance"} <= set(getattr(state, "_fields", ()))


# ------------------------------------------------------------------------------------- as a method


def interacting(
    name: str,
    modes: Sequence[Method],
    transition: Array,
    probabilities: Array | None = None,
    factors: Sequence[float] | None = None,
    **more: Any,
) -> Method:
    """Return modes as one method, for `runs.run`.

    Process, Q and measure are then tuples with one for each mode, or one for all.

    Parameters
    ----------
    name
        Name of the method.
    modes
        One filter for each of r modes.
    transition : (r, r)
        Row i has the probabilities of the transitions from mode i.
    probabilities : (r,)
        First probabilities; by default equal.
    factors
        Factor on Q for each mode.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    """
    r = len(modes)

    def each(given: Any) -> Sequence[Any]:
        return given if isinstance(given, tuple) else [given] * r

    def start_(mean: Array, covariance: Array) -> ModesState:
        return start(modes, mean, covariance, np.full(r, 1 / r) if probabilities is None else probabilities)

    def predict_(state: ModesState, process: Any, Q: Any, angular_states: Indices = ()) -> ModesState:
        state = _with_angles(state, angular_states)
        noises = [q if f == 1 else f * q for q, f in zip(each(Q), factors or [1.0] * r, strict=True)]
        return predict(modes, state, each(process), noises, transition)

    def update_(
        state: ModesState, y: Array, measure: Any, R: Array, angular: Indices = (), angular_states: Indices = ()
    ) -> Update:
        state = _with_angles(state, angular_states)
        found = update(modes, state, y, each(measure), R, angular)
        with np.errstate(divide="ignore"):  # a mode may be impossible
            each_log = np.log(state.probabilities) + found.log_likelihood
        return Update(*found[:5], log_evidence=np.logaddexp.reduce(each_log, axis=-1))

    return Method(name, start_, predict_, update_, lambda state: belief(modes, state), **more)


def as_method(
    name: str, modes: Sequence[Method], factors: Sequence[float], stay: float = 0.95, **more: Any
) -> Method:
    """Return modes that differ in their method and by a factor on Q, equally likely at first.

    A mode stays with probability `stay`, or else changes to any other with equal probability.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    """
    r = len(modes)
    if len(factors) != r or r < 2 or not 0 <= stay <= 1:
        raise FilterError(f"factors, stay: must be {r} (at least 2), and a probability, not {factors} and {stay}")
    transition = np.full((r, r), (1 - stay) / (r - 1))
    np.fill_diagonal(transition, stay)
    return interacting(name, modes, transition, factors=factors, **more)


# One model twice, which must equal the single filter: factors on Q depend on the manoeuvres of an application.
METHODS: Final[tuple[Method, ...]] = (as_method("imm", unscented.METHODS[:1] * 2, (1.0, 1.0)),)
