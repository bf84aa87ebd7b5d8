"""Square-root filters against the unscented filter and dense formulas, and where float64 has too few digits."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import expm

from onboard.filters import square_root, unscented
from onboard.filters.belief import Belief, FilterError, NotPositiveDefiniteError, Weights
from onboard.filters.cubature import weights as cubature_weights
from onboard.filters.square_root import SquareRoot
from tests.support.filter_problems import bend, radar, radar_slope, spd

N = 5
CENTRED = Weights(np.sqrt(8.0), 1 - N / 8, 1 - N / 8, 1 / 16)  # centre 3/8
RULES = {"cubature": cubature_weights(N), "centred": CENTRED, "beta": unscented.scaled_weights(N, 1.0, 2.0)}
every_rule = pytest.mark.parametrize("rule", RULES.values(), ids=RULES)


def problem(seed: int, lead: tuple[int, ...] = ()) -> tuple[Belief, Any, Any, Any]:
    """A belief, Q, R and y, read-only."""
    rng = np.random.default_rng(seed)
    mean = rng.normal(0, 3, (*lead, N)) + 30 * np.eye(N)[0]  # so far off that its bearing is known
    made = (
        mean,
        spd(rng, N, lead),
        spd(rng, N),
        0.1 * spd(rng, 2),
        radar(mean.reshape(-1, N)).reshape(*lead, 2) + 0.3,
    )
    for array in made:
        array.flags.writeable = False
    return Belief(*made[:2]), *made[2:]


def close(a: Any, b: Any, tolerance: float = 1e-9) -> None:
    np.testing.assert_allclose(a, b, rtol=tolerance, atol=tolerance)


@every_rule
@pytest.mark.parametrize("considered", [(), (1, 3)])
@pytest.mark.parametrize("lead", [(), (4,)], ids=["one", "batch"])
def test_production_is_the_unscented_filter_seed_1(rule: Weights, considered: Any, lead: tuple[int, ...]) -> None:
    belief, Q, R, y = problem(1, lead)
    dense, state = belief, square_root.start(*belief)
    for _ in range(5):
        dense, state = unscented.predict(dense, bend, Q, rule), square_root.predict(state, bend, Q, rule)
        close(state.mean, dense.mean)
        close(square_root.belief(state).covariance, dense.covariance)
        assert not np.triu(state.factor, 1).any()
        assert np.all(np.diagonal(state.factor, axis1=-2, axis2=-1) > 0)
        want = unscented.update(dense, y, radar, R, rule, (1,), considered)
        found = square_root.update(state, y, radar, R, rule, (1,), considered)
        for a, b in zip(found[1:-1], want[1:-1], strict=True):
            close(a, b)
        dense, state = want.belief, found.belief
        close(state.mean, dense.mean)
        close(square_root.belief(state).covariance, dense.covariance)
        assert not np.triu(state.factor, 1).any()


@every_rule
def test_classical_is_the_unscented_filter_too_seed_2(rule: Weights) -> None:
    belief, Q, R, y = problem(2)
    want = unscented.update(unscented.predict(belief, bend, Q, rule), y, radar, R, rule, (1,))
    state = square_root.predict(square_root.start(*belief), bend, Q, rule)
    found = square_root.update_classical(state, y, radar, R, rule, (1,))
    close(found.belief.mean, want.belief.mean)
    close(square_root.belief(found.belief).covariance, want.belief.covariance)


def test_a_negative_centre_is_a_downdate_seed_3() -> None:
    belief, Q, R, y = problem(3)
    rule = unscented.julier_weights(N)
    assert rule.covariance < 0
    dense = unscented.predict(belief, bend, Q, rule)
    state = square_root.predict(square_root.start(*belief), bend, Q, rule)
    close(square_root.belief(state).covariance, dense.covariance)
    want = unscented.update(dense, y, radar, R, rule, (1,))
    found = square_root.update_classical(state, y, radar, R, rule, (1,))
    close(found.innovation_covariance, want.innovation_covariance)
    close(square_root.belief(found.belief).covariance, want.belief.covariance)
    with pytest.raises(FilterError, match="weights"):
        square_root.update(state, y, radar, R, rule, (1,))


@pytest.mark.parametrize("jacobian", [radar_slope, None], ids=["given", "differences"])
def test_joseph_is_equation_18_at_the_posterior_mean_seed_4(jacobian: Any) -> None:
    belief, _, R, y = problem(4)
    found = square_root.update_joseph(square_root.start(*belief), y, radar, R, CENTRED, (1,), jacobian)
    want = unscented.update(belief, y, radar, R, CENTRED, (1,))
    close(found.belief.mean, want.belief.mean)  # the gain is the unscented one
    points = unscented.sigma_points(belief, CENTRED)
    d = radar(points) - want.predicted
    d[:, 1] -= 2 * np.pi * np.rint(d[:, 1] / (2 * np.pi))
    K = CENTRED.other * (points[1:] - belief.mean).T @ d[1:] @ np.linalg.inv(want.innovation_covariance)
    G = np.eye(N) - K @ radar_slope(found.belief.mean[None])[0]
    close(square_root.belief(found.belief).covariance, G @ belief.covariance @ G.T + K @ R @ K.T, 1e-7)


def test_joseph_is_overconfident_where_the_measurement_is_curved_seed_5() -> None:
    """20 km away known to 1 km, seen to 1 m and 10 mrad: one update of each form, NEES of two states."""
    rng = np.random.default_rng(5)
    R, P, rule = np.diag([1.0, 1e-4]), np.diag([1e6, 1e6]), unscented.julier_weights(2)
    nees: dict[str, list[float]] = {"joseph": [], "production": []}
    for _ in range(300):
        truth = np.array([20e3, 5e3])
        state = square_root.start(truth + 1e3 * rng.normal(0, 1, 2), P)
        y = radar(truth[None])[0] + np.sqrt(np.diag(R)) * rng.normal(0, 1, 2)
        for name, update in (("joseph", square_root.update_joseph), ("production", square_root.update)):
            after = square_root.belief(update(state, y, radar, R, rule, (1,)).belief)
            error = after.mean - truth
            nees[name].append(error @ np.linalg.solve(after.covariance, error))
    assert np.mean(nees["joseph"]) > 8
    assert 1.7 < np.mean(nees["production"]) < 2.4  # 2, with 99.9 % of chi-square


def test_singular_noise_has_a_root_seed_8() -> None:
    belief, _, _, y = problem(8)
    g = np.linspace(1, 2, N)
    for Q in (np.zeros((N, N)), np.outer(g, g), 1e-18 * np.outer(g, g), np.diag([0.0, 1, 0, 1e-9, 2])):
        state = square_root.predict(square_root.start(*belief), bend, Q, CENTRED)
        close(square_root.belief(state).covariance, unscented.predict(belief, bend, Q, CENTRED).covariance, 1e-12)
    found = square_root.update(square_root.start(*belief), y, radar, np.diag([0.0, 1.0]), CENTRED, (1,))
    assert np.isfinite(found.belief.factor).all()


# ------------------------------------------------------------------------------- too few digits


def accelerated(dt: float = 0.5, q: float = 0.01) -> tuple[Any, Any]:
    """F and Q of three axes of white jerk, by Van Loan."""
    A = np.diag([1.0, 1.0], 1)
    block = np.zeros((6, 6))
    block[:3, :3], block[3:, 3:], block[2, 5] = -A, A.T, q
    E = expm(block * dt)
    return np.kron(np.eye(3), E[3:, 3:].T), np.kron(np.eye(3), E[3:, 3:].T @ E[:3, 3:])


def sighting(rows: Any) -> Any:
    """Range, azimuth (De Vivo et al. eq 36, atan2(x, y)) and elevation."""
    x, y, z = rows[:, 0], rows[:, 3], rows[:, 6]
    level = np.hypot(x, y)
    return np.stack([np.hypot(level, z), np.arctan2(x, y), np.arctan2(z, level)], axis=1)


def validation(seed: int, R: Any, advance: Callable[..., Any], steps: int = 60) -> float:
    """De Vivo et al. section 4 with sharper measurements at 2 Hz. The last position error, m."""
    rng = np.random.default_rng(seed)
    F, Q = accelerated()
    truth = np.array([-6000, 110, -0.2, 4500, -60, 0.3, 1000, 8, -0.05])
    sigma = np.tile([300.0, 30.0, 3.0], 3)
    state = truth + sigma * rng.normal(0, 1, 9), np.diag(sigma**2)
    started = None
    for _ in range(steps):
        truth = F @ truth
        y = sighting(truth[None])[0] + np.sqrt(np.diag(R)) * rng.normal(0, 1, 3)
        started = advance(started, state, F, Q, y, R)
    assert started is not None
    return float(np.linalg.norm((started[0] - truth)[[0, 3, 6]]))


def rooted(update: Callable[..., Any], rule: Weights) -> Callable[..., Any]:
    def advance(state: Any, first: Any, F: Any, Q: Any, y: Any, R: Any) -> Any:
        state = square_root.start(*first) if state is None else state
        state = square_root.predict(state, lambda rows: rows @ F.T, Q, rule)
        return update(state, y, sighting, R, rule, (1, 2)).belief

    return advance


def failures(R: Any, advance: Callable[..., Any]) -> tuple[int, float]:
    """Of 50 seeds, how many end in a covariance without a factor, and the worst error of the others."""
    failed, errors = 0, [0.0]
    for seed in range(50):
        try:
            errors.append(validation(seed, R, advance))
        except NotPositiveDefiniteError:
            failed += 1
    return failed, max(errors)


CUBATURE = cubature_weights(9)
CENTIMETRES = np.diag([1e-4, 1e-10, 1e-10])  # m^2, rad^2


@pytest.mark.slow
@pytest.mark.parametrize("update", [square_root.update, square_root.update_joseph], ids=["production", "joseph"])
def test_a_millionth_of_a_centimetre_survives_seeds_0_to_49(update: Callable[..., Any]) -> None:
    failed, worst = failures(1e-12 * CENTIMETRES, rooted(update, CUBATURE))
    assert failed == 0
    assert worst < 0.5


def test_a_negative_centre_fails_in_any_square_root_seeds_0_to_49() -> None:
    """Not rounding: 300 m against 1 cm, the weight of -2 takes more from the posterior than there is."""
    classical = rooted(square_root.update_classical, unscented.julier_weights(9))
    assert failures(CENTIMETRES, classical)[0] > 45
    assert failures(CENTIMETRES, rooted(square_root.update_classical, CUBATURE))[0] == 0


def test_downdates_fail_by_rounding_where_triangularisation_does_not() -> None:
    """A kilometre measured to a nanometre: 1 - 1e-24 has no float64."""
    state = SquareRoot(np.zeros(2), np.array([[1e3, 0], [3.0, 10.0]]))
    y, R, rule = np.zeros(1), np.array([[1e-18]]), cubature_weights(2)
    with pytest.raises(NotPositiveDefiniteError, match="downdate"):
        square_root.update_classical(state, y, lambda rows: rows[:, :1], R, rule)
    found = square_root.update(state, y, lambda rows: rows[:, :1], R, rule).belief
    assert found.factor[0, 0] == pytest.approx(1e-9, rel=0.1)
    assert found.factor[1, 1] == pytest.approx(10, rel=1e-4)


# ---------------------------------------------------------------------------------- refusals


def test_a_centre_without_weight_need_not_be_finite() -> None:
    def hollow(rows: Any) -> Any:  # not a number at the mean
        return rows + 0 / np.hypot(rows[:, :1], rows[:, 1:])

    rule, state = cubature_weights(2), square_root.start(np.zeros(2), np.eye(2))
    with np.errstate(invalid="ignore"):
        state = square_root.predict(state, hollow, np.eye(2), rule)
        found = square_root.update(state, np.zeros(2), hollow, np.eye(2), rule)
    assert_allclose(square_root.belief(found.belief).covariance, 2 / 3 * np.eye(2), rtol=1e-9, atol=1e-9)


def test_weights_that_do_not_belong_together_are_refused() -> None:
    state = square_root.start(np.ones(2), np.eye(2))
    with pytest.raises(FilterError, match="weights"):
        square_root.predict(state, lambda rows: rows, np.eye(2), Weights(1.0, 0.0, 0.0, 0.25))
