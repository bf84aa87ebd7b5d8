"""Sigma-point filters that carry the covariance's lower factor S, P = S S^T.

De Vivo et al., eqs 19-32, and others. Three updates share one prediction:

- `update`: S+ = tria[sqrt(w) (dX - K dZ), K S_R]. No Jacobian, no inverse, no downdate; the unscented filter's
  numbers with the same weights, as long as the centre's weight is not negative. Use this one.
- `update_joseph`: the paper's, with the Jacobian at the posterior mean (eqs 17, 32).
- `update_classical`: van der Merwe & Wan (2001), S+ by rank-one downdates, which fail when rounding exceeds them.

With a negative centre weight `update_classical` fails, as the unscented filter does,
when the prior is wide and the measurement sharp: the centre subtracts more than the sum of the other points.

kappa(S) = sqrt(kappa(P)): this saves half the digits lost in an ill-conditioned covariance, and gives no other
accuracy. Q and R may be singular. Batches as in `unscented`; a batched Q or R is allowed.
"""

from collections.abc import Callable
from typing import Any, Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.filters import belief as beliefs
from onboard.filters import extended, stepping
from onboard.filters.angles import beside_first, check_spread
from onboard.filters.belief import Belief, Indices, Method, Rows, Update, Weights, check_weights, images_of
from onboard.filters.cubature import weights as cubature_weights
from onboard.filters.errors import FilterError, NotPositiveDefiniteError
from onboard.filters.kernels import factors
from onboard.filters.kernels import square_root as kernels
from onboard.filters.kernels.calls import call, masks
from onboard.filters.stepping import Rule, StepResult
from onboard.filters.unscented_transform import julier_weights


class SquareRoot(NamedTuple):
    """A belief by its mean and the factor of its covariance.

    Attributes
    ----------
    mean : (..., n)
        Mean.
    factor : (..., n, n)
        Lower triangular factor.
    """

    mean: Array
    factor: Array


def start(mean: Array, covariance: Array) -> SquareRoot:
    """Return a belief with the Cholesky factor of its covariance (..., n, n).

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    NotPositiveDefiniteError
        If a covariance is not positive definite, or not finite.
    """
    beliefs.start(mean, covariance)
    (lower,) = call(factors.factor, covariance=covariance)
    return SquareRoot(mean, lower)


def belief(state: SquareRoot) -> Belief:
    """Return mean and covariance S S^T."""
    (covariance,) = call(factors.square, factor=state.factor)
    return Belief(state.mean, covariance)


def predict(
    state: SquareRoot, process: Rows, Q: Array, weights: Weights, angular_states: Indices = ()
) -> SquareRoot:
    """Time update (eqs 19-22, with f(X) in 21 and 22, where X is printed).

    A negative centre weight makes eq 22 a downdate, which can fail. Parameters are those of `unscented.predict`.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    NotPositiveDefiniteError
        If a covariance is not positive definite, or not finite.
    """
    _, images = _images(state, process, weights, None, angular_states)
    moved = beside_first(images, angular_states)
    mean, factor = call(kernels.gather, weights.covariance, weights.other, process=moved, Q=Q)
    return SquareRoot(mean, factor)


def update(
    state: SquareRoot,
    y: Array,
    measure: Rows,
    R: Array,
    weights: Weights,
    angular: Indices = (),
    considered: Indices = (),
    angular_states: Indices = (),
) -> Update:
    """Measurement update by triangularisation.

    Parameters are those of `unscented.update`.

    Raises
    ------
    FilterError
        If an argument cannot be used, or for a negative centre weight.
    NotPositiveDefiniteError
        If a covariance is not positive definite, or not finite.

    Notes
    -----
    Opposite points are rotated pairwise, which leaves the product S S^T and halves the columns: their differences
    give S - K H S, with H S the slope of the measurement over the points, their sums and R the factor of the
    noise.
    """
    _require_centre(weights)
    mean, factor, _, _, *rest = _correct(state, y, measure, R, weights, angular, considered, angular_states)
    return _update(SquareRoot(mean, factor), *rest)


def rule(
    weights: Weights,
    n: int,
    m: int,
    angular: tuple[int, ...] = (),
    considered: tuple[int, ...] = (),
    angular_states: Indices = (),
) -> Rule:
    """Return the rule of `predict` and `update` for `step`.

    Parameters
    ----------
    n, m
        Numbers of states and of measured components.
    weights, angular, considered, angular_states
        As in `update`.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    """
    _require_centre(weights)
    _require_scale(weights)
    return stepping.rule(weights, n, m, angular, considered, KERNELS, angular_states)


def sigma_points(state: SquareRoot | StepResult, weights: Weights, angular_states: Indices = ()) -> Array:
    """Return sigma points (..., 2n+1, n), the mean first (eqs 19, 23).

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    """
    if isinstance(state, StepResult):
        state = start(state.mean, state.covariance)
    check_weights(weights, state.mean.shape[-1])
    (points,) = call(kernels.spread, weights.spread, mean=state.mean, factor=state.factor)
    if angular_states:
        check_spread(points, angular_states)
    return np.asarray(points)


KERNELS: Final = stepping.Kernels(sigma_points, kernels.redraw, kernels.correct_and_redraw, factored=True)
step: Final = stepping.step  # of this filter, by its `rule`


def update_joseph(
    state: SquareRoot,
    y: Array,
    measure: Rows,
    R: Array,
    weights: Weights,
    angular: Indices = (),
    jacobian: extended.Jacobian | None = None,
    angular_states: Indices = (),
) -> Update:
    """Measurement update of De Vivo et al. (eqs 23-32).

    The gain is the unscented one, and S+ = tria[(I - K H_J) S, K S_R]. It is overconfident where the measurement
    is strongly curved over the prior: the gain takes account of how far h deviates from H_J, S+ does not.
    (Acquisition at 20 km, 1 m and .2 mrad: NEES 44 for 9 states.)

    Parameters
    ----------
    jacobian
        Jacobian at the posterior mean over rows, (k, n) -> (k, m, n); None: central differences.
    state, y, measure, R, weights, angular, angular_states
        As in `update`.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    NotPositiveDefiniteError
        If a covariance is not positive definite, or not finite.

    Notes
    -----
    Errata: eq 27 (and table 2) takes the deviations of the redrawn X_n|n-1, not f(X_n-1|n-1); eq 32's left side is
    transposed. For a negative centre weight eq 26 is a downdate.
    """
    mean, _, gain, _, *rest = _correct(state, y, measure, R, weights, angular, (), angular_states)
    # the step of the differences is scaled by the prior's deviations
    _, H = extended.tangent(Belief(mean, belief(state).covariance), measure, jacobian, y, angular)
    (factor,) = call(kernels.joseph, factor=state.factor, H=H, K=gain, R=R)
    return _update(SquareRoot(mean, factor), *rest)


def update_classical(
    state: SquareRoot,
    y: Array,
    measure: Rows,
    R: Array,
    weights: Weights,
    angular: Indices = (),
    angular_states: Indices = (),
) -> Update:
    """Measurement update of van der Merwe & Wan.

    S+ is a downdate of S with each column of K chol(P_zz).

    Raises
    ------
    FilterError
        If an argument cannot be used.
    NotPositiveDefiniteError
        If a covariance is not positive definite, or if a downdate fails.
    """
    mean, _, _, U, *rest = _correct(state, y, measure, R, weights, angular, (), angular_states)
    (factor,) = call(factors.downdate, factor=state.factor, U=U)
    return _update(SquareRoot(mean, factor), *rest)


def _images(
    state: SquareRoot, model: Rows, weights: Weights, y: Array | None, angular_states: Indices
) -> tuple[Array, Array]:
    _require_scale(weights)
    points = sigma_points(state, weights, angular_states)
    return points, images_of(model, points, y)


def _require_centre(weights: Weights) -> None:
    if weights.covariance < 0:
        raise FilterError("weights: the centre's must not be negative")


def _require_scale(weights: Weights) -> None:
    if abs(2 * weights.other * weights.spread**2 - 1) > 1e-6:
        raise FilterError("weights: twice the weight of a point times its squared spread must be one")


def _correct(
    state: SquareRoot,
    y: Array,
    measure: Rows,
    R: Array,
    weights: Weights,
    angular: Indices,
    considered: Indices,
    angular_states: Indices,
) -> list[Any]:
    points, images = _images(state, measure, weights, y, angular_states)
    options = weights.covariance, weights.other, *masks(y, angular, state.mean, considered)
    return call(kernels.correct, *options, points=points, factor=state.factor, measure=images, y=y, R=R)


def _update(state: SquareRoot, innovation: Array, S: Array, predicted: Array, nis: Any) -> Update:
    if not np.isfinite(state.factor).all():
        raise NotPositiveDefiniteError("covariance: the update left it not finite")
    return Update(state, innovation, S, predicted, nis if nis.ndim else float(nis))


def _unscented(n: int) -> Weights:
    """Return Julier's weights, with n + lambda = n beyond three states.

    The centre's weight would be negative there.
    """
    return julier_weights(n, max(float(n), 3.0))


def _method(name: str, correct: Callable[..., Update], rule: Callable[[int], Weights]) -> Method:
    def predict_(state: SquareRoot, process: Rows, Q: Array, angular_states: Indices = ()) -> SquareRoot:
        return predict(state, process, Q, rule(state.mean.shape[-1]), angular_states)

    def update_(
        state: SquareRoot, y: Array, measure: Rows, R: Array, angular: Indices = (), angular_states: Indices = ()
    ) -> Update:
        weights = rule(state.mean.shape[-1])
        return correct(state, y, measure, R, weights, angular, angular_states=angular_states)

    return Method(name, start, predict_, update_, belief, lambda state: state.factor)


METHODS: Final = (
    _method("square-root", update, _unscented),
    _method("square-root-cubature", update, cubature_weights),
    _method("square-root-joseph", update_joseph, _unscented),
    _method("square-root-downdated", update_classical, julier_weights),
)
