"""What every filter method does, whoever wrote it: the methods are found in onboard/filters, not listed here.

A method that a property does not fit says so in its `exempt`, with the reason; it must then fail (xfail, strict).
"""

from collections.abc import Collection

import numpy as np
import pytest

from onboard.arrays import Array
from onboard.filters import methods
from onboard.filters.belief import PROPERTIES, Method
from onboard.filters.gating import mean_bounds, normalised_squared
from tests.conformance.problems import (
    Linear,
    arrays_of,
    cases,
    ensemble,
    ill_conditioned,
    kalman,
    linear,
    locked,
    simulate,
    track,
)

METHODS = methods()
every = pytest.mark.parametrize("method", cases(METHODS))
LONG, SHORT, SHORTEST, SCATTERED = 100_000, 10_000, 2_000, 1_000
# These never come back to the bit, and share the update of a method that goes to the end. The short
# run is all of theirs.
ONLY_SHORT = {"augmented", "augmented-scaled-1", "csvsf-printed", "square-root-cubature"}
# Four of ten seconds of all methods go into these two, which neither fly by default nor stand in a paper: only the
# longest runs have them.
ONLY_LONG = {"ensemble", "gauss-hermite"}


def having(prop: str, *, but: Collection[str] = ()) -> pytest.MarkDecorator:
    chosen = {name: method for name, method in METHODS.items() if name not in but}
    return pytest.mark.parametrize("method", cases(chosen, prop))


def sound(method: Method, state: object) -> None:
    """Symmetric to the bit, finite, and with a Cholesky factor (a factor's product may round below what it is)."""
    P = np.asarray(method.belief(state).covariance, dtype=float)
    assert np.isfinite(P).all()
    assert np.array_equal(P, np.swapaxes(P, -1, -2))
    if method.factor is not None:
        S = np.asarray(method.factor(state), dtype=float)
        assert np.isfinite(S).all()
        assert np.all(np.abs(np.diagonal(S, axis1=-2, axis2=-1)) > 0)
        return
    variances = np.diagonal(P, axis1=-2, axis2=-1)
    assert np.all(variances > 0)
    sigma = np.sqrt(variances)
    assert np.all(np.linalg.eigvalsh(P / (sigma[..., None] * sigma[..., None, :])) > 0)


def test_methods_are_found() -> None:
    assert {"kalman", "extended", "unscented", "cubature", "square-root", "svsf"} <= set(METHODS)
    assert all(name == method.name for name, method in METHODS.items())
    assert any(method.factor is not None for method in METHODS.values())


def test_what_flies_is_exempt_from_nothing() -> None:
    """The forms for production: a square root by triangularisation, Joseph's form, and what is built on them."""
    for name in ("kalman", "extended", "square-root", "square-root-joseph"):
        assert not METHODS[name].exempt


@pytest.mark.parametrize("n", [1, 4, 9])
def test_svsf_with_zero_layer_is_the_measurement_when_all_is_measured_seed_10(n: int) -> None:
    rng, method = np.random.default_rng(10), METHODS["svsf-zero-layer"]
    problem = linear(rng, method, n)._replace(H=np.eye(n), R=np.eye(n))
    state = method.start(problem.mean, problem.P)
    for y in rng.normal(0, 3, (20, n)):
        state = method.predict(state, problem.process, problem.Q)
        state = method.update(state, y, problem.measure, problem.R, ()).belief
        np.testing.assert_allclose(method.belief(state).mean, y, rtol=0, atol=1e-12)


@every
def test_what_a_method_is_exempt_from_is_a_property_with_a_reason(method: Method) -> None:
    assert set(method.exempt) <= set(PROPERTIES)
    assert all(len(reason) > 20 for reason in method.exempt.values())


@every
def test_pure_and_deterministic_on_read_only_arrays_seed_1(method: Method) -> None:
    rng = np.random.default_rng(1)
    problem = locked(linear(rng, method))
    seen = locked(rng.normal(0, 3, (3, len(problem.H))))
    before = [array.tobytes() for array in (*problem, seen)]
    state = locked(method.start(problem.mean, problem.P))
    results = []
    for _ in range(2):
        predicted = locked(method.predict(state, problem.process, problem.Q))
        update = locked(method.update(predicted, seen[0], problem.measure, problem.R, ()))
        again = locked(method.predict(update.belief, problem.process, problem.Q))
        results.append([array.tobytes() for array in arrays_of((predicted, update, again))])
    assert results[0] == results[1]
    assert before == [array.tobytes() for array in (*problem, seen)]


@having("kalman")
@pytest.mark.parametrize("n", [1, 4, 9])
def test_equals_the_kalman_filter_on_linear_problems_seed_2(method: Method, n: int) -> None:
    rng = np.random.default_rng(2)
    problem = linear(rng, method, n)
    seen = rng.normal(0, 3, (20, len(problem.H)))
    state, updates = track(method, problem, seen)
    belief, expected = method.belief(state), kalman(problem, seen)
    np.testing.assert_allclose(belief.mean, expected.mean, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(belief.covariance, expected.covariance, rtol=1e-9, atol=1e-9)
    u = updates[-1]
    nis = float(u.innovation @ np.linalg.solve(u.innovation_covariance, u.innovation))
    assert u.nis == pytest.approx(nis, rel=1e-9)
    np.testing.assert_allclose(u.innovation, seen[-1] - u.predicted, atol=1e-12)


@having("partial")
def test_takes_fewer_measurements_than_states_seed_3(method: Method) -> None:
    rng = np.random.default_rng(3)
    H = np.eye(4)[:1]
    problem = linear(rng, method)._replace(H=H, R=np.array([[0.5]]))
    state, updates = track(method, problem, rng.normal(0, 1, (5, 1)))
    sound(method, state)
    assert updates[-1].innovation.shape == (1,)
    assert updates[-1].innovation_covariance.shape == (1, 1)


@having("consistent")
def test_nees_and_nis_keep_their_95_percent_bounds_seed_4(method: Method) -> None:
    """500 runs of the very model that the filter assumes."""
    rng, runs = np.random.default_rng(4), 500
    dt, m = 0.1, 4 if "partial" in method.exempt else 2
    problem = Linear(
        np.eye(4) + dt * np.eye(4, k=2),
        np.eye(m, 4),
        np.diag([1e-4, 1e-4, 0.01, 0.01]),
        np.diag([0.04, 0.09, 0.04, 0.09])[:m, :m],
        np.zeros(4),
        np.diag([1.0, 1.0, 4.0, 4.0]),
    )
    truths, seen = simulate(rng, problem, runs, 30)
    belief, nis = ensemble(method, problem, seen)
    nees = normalised_squared(belief.mean - truths[-1], belief.covariance)
    for figure, degrees in ((nees, 4), (nis, m)):
        low, high = mean_bounds(degrees, runs, 0.95)
        assert low < np.mean(figure) < high


@having("batch")
def test_a_batch_is_a_loop_seed_5(method: Method) -> None:
    rng, count = np.random.default_rng(5), 11  # odd, and more than one group of lanes
    problem = linear(rng, method)
    seen = rng.normal(0, 3, (4, count, len(problem.H)))
    together, updates = track(method, problem, seen)
    belief = method.belief(together)
    for b in range(count):
        alone, single = track(method, problem, np.ascontiguousarray(seen[:, b]))
        expected = method.belief(alone)
        np.testing.assert_allclose(belief.mean[b], expected.mean, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(belief.covariance[b], expected.covariance, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(updates[-1].innovation[b], single[-1].innovation, rtol=1e-12, atol=1e-12)
        assert updates[-1].nis[b] == pytest.approx(single[-1].nis, rel=1e-11)


def long_run(method: Method, steps: int) -> None:
    """Measurements that scatter, then one again and again. A step is then a function of the state alone: once a
    state comes back to the bit, all later ones are known."""
    rng = np.random.default_rng(7)
    problem = ill_conditioned(method)
    noise = np.sqrt(np.diag(problem.R)) * rng.normal(0, 1, (SCATTERED, len(problem.H)))
    last = np.full(len(problem.H), 1e-3)
    state, known = method.start(problem.mean, problem.P), set()
    for k in range(steps):
        state = method.predict(state, problem.process, problem.Q)
        y = noise[k] if k < SCATTERED else last
        state = method.update(state, y, problem.measure, problem.R, ()).belief
        if k < 100 or k % 500 == 499:
            sound(method, state)
        if k >= SCATTERED:
            bits = b"".join(array.tobytes() for array in arrays_of(state))
            if bits in known:
                break
            known.add(bits)
    sound(method, state)
    if "kalman" in method.exempt:
        return
    belief = method.belief(state)  # it still estimates: the millimetre is kept, and so is the mean
    assert np.sqrt(belief.covariance[0, 0]) < 1.5e-3
    assert abs(belief.mean[0]) < 0.01


@having("long_run", but=ONLY_LONG)
@pytest.mark.parametrize("steps", [SHORTEST, pytest.param(SHORT, marks=pytest.mark.slow)])
def test_sound_after_2_000_and_10_000_ill_conditioned_steps_seed_7(method: Method, steps: int) -> None:
    long_run(method, steps)


@pytest.mark.slow
@having("long_run", but=ONLY_SHORT)
def test_sound_after_100_000_ill_conditioned_steps_seed_7(method: Method) -> None:
    long_run(method, LONG)


@pytest.mark.parametrize("method", cases({name: m for name, m in METHODS.items() if m.factor is not None}))
def test_the_condition_number_of_a_factor_is_the_square_root_seed_8(method: Method) -> None:
    rng = np.random.default_rng(8)
    problem = linear(rng, method)
    state, _ = track(method, problem, rng.normal(0, 3, (20, len(problem.H))))
    assert method.factor is not None
    S, P = method.factor(state), method.belief(state).covariance
    np.testing.assert_allclose(S @ S.T, P, rtol=1e-12, atol=1e-12)
    assert np.linalg.cond(S) ** 2 == pytest.approx(np.linalg.cond(P), rel=1e-3)


@every
def test_an_outage_is_predicted_through_seed_9(method: Method) -> None:
    rng = np.random.default_rng(9)
    problem = linear(rng, method)._replace(F=np.eye(4) + 0.1 * np.eye(4, k=2))
    state, _ = track(method, problem, rng.normal(0, 1, (5, len(problem.H))))
    before = method.belief(state)
    x, P = before.mean, before.covariance
    for _ in range(200):
        state = method.predict(state, problem.process, problem.Q)
        x, P = problem.F @ x, problem.F @ P @ problem.F.T + problem.Q
    sound(method, state)
    after = method.belief(state)
    np.testing.assert_allclose(after.mean, x, rtol=1e-9, atol=1e-9)
    if "kalman" not in method.exempt:
        np.testing.assert_allclose(after.covariance, P, rtol=1e-9)
    found = method.update(state, np.zeros(len(problem.H)), problem.measure, problem.R, ())
    sound(method, found.belief)
    assert np.trace(method.belief(found.belief).covariance) < np.trace(after.covariance)


@having("angles")
@pytest.mark.parametrize("side", [1, -1])
def test_innovations_wrap_across_the_seam(method: Method, side: int) -> None:
    """An angle just before +-pi, measured just beyond; the sigma points' images lie on both sides."""
    mean = np.array([side * (np.pi - 0.01), 0.0])

    def measure(rows: Array) -> Array:
        wrapped = rows.copy()
        wrapped[:, 0] = (rows[:, 0] + np.pi) % (2 * np.pi) - np.pi
        return wrapped

    state = method.start(mean, np.diag([0.04, 0.01]))
    y = np.array([-side * (np.pi - 0.02), 0.0])
    update = method.update(state, y, measure, np.diag([0.04, 0.01]), (0,))
    assert update.innovation[0] == pytest.approx(side * 0.03, abs=1e-9)
    after = method.belief(update.belief).mean[0]
    assert 0 <= side * (after - mean[0]) <= 0.03 + 1e-12
