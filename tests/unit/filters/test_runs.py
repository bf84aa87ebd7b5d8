"""Whole records: the compiled loop, missing measurements, changing models, and what is refused."""

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

from onboard.arrays import Array
from onboard.filters import (
    Belief,
    FilterError,
    LinearModel,
    Model,
    NotPositiveDefiniteError,
    Step,
    consistency,
    expectation_maximisation,
    extended,
    families,
    kalman,
    log_likelihood,
    methods,
    multiple_model,
    run,
    simulate,
    smooth,
    unscented,
)
from onboard.filters.belief import Method
from onboard.filters.discretisation import white_acceleration
from onboard.filters.kernels import records
from tests.conformance.problems import cases
from tests.support import kernels
from tests.support.filter_problems import spd
from tests.support.nile import FLOW

ONE = np.eye(1)
N, M, T, B = 3, 2, 12, 4
EVERY = pytest.mark.parametrize("method", cases(methods()))


def problem(seed: int) -> tuple[LinearModel, Belief, Array]:
    """A model, a first belief, and measurements (T, B, m), every third component of which is missing."""
    rng = np.random.default_rng(seed)
    F = np.eye(N) + 0.1 * rng.normal(0, 1, (N, N))
    model = LinearModel(F, 0.1 * spd(rng, N), rng.normal(0, 1, (M, N)), spd(rng, M), rng.normal(0, 1, (T - 1, N)))
    ys = rng.normal(0, 2, (T, B, M))
    ys[rng.random(ys.shape) < 0.3] = np.nan
    ys[5] = np.nan
    return model, Belief(rng.normal(0, 1, (B, N)), np.stack([spd(rng, N) for _ in range(B)])), ys


def by_hand(model: LinearModel, start: Belief, ys: Array) -> tuple[list[Belief], list[float]]:
    """Predict and update of the textbook, for one filter, by the rows of H and R that are measured."""
    belief, beliefs, logs = start, [], []
    assert model.inputs is not None
    for k, y in enumerate(ys):
        if k:
            moved = kalman.predict(belief, model.F, model.Q)
            belief = Belief(moved.mean + model.inputs[k - 1], moved.covariance)
        seen = np.flatnonzero(~np.isnan(y))
        logs.append(0.0)
        if len(seen):
            S = model.H[seen] @ belief.covariance @ model.H[seen].T + model.R[np.ix_(seen, seen)]
            e = y[seen] - model.H[seen] @ belief.mean
            logs[-1] = -0.5 * float(e @ np.linalg.solve(S, e) + np.log(np.linalg.det(2 * np.pi * S)))
            belief = kalman.update(belief, y[seen], model.H[seen], model.R[np.ix_(seen, seen)]).belief
        beliefs.append(belief)
    return beliefs, logs


def test_the_nile_s_log_likelihood_is_that_of_durbin_and_koopman() -> None:
    model = LinearModel(ONE, 1469.1 * ONE, ONE, 15099.0 * ONE)
    found = run("kalman", model, Belief(np.zeros(1), 1e7 * ONE), FLOW)
    assert found.log_likelihood.sum() == pytest.approx(-641.5856, abs=1e-4)
    assert found.beliefs.mean[-1, 0] == pytest.approx(798.3703, abs=1e-4)
    assert found.beliefs.covariance[-1, 0, 0] == pytest.approx(4032.1579, abs=1e-4)


@EVERY
def test_each_filter_takes_a_batch_of_which_each_member_misses_something_else_seed_1(method: Method) -> None:
    model, start, ys = problem(1)
    if "partial" in method.exempt:
        with pytest.raises(FilterError, match=r"ys\[0\], t = 0: y: .* takes no partial measurement"):
            run(method, model, start, ys)
        ys[np.isnan(ys)] = 0.0
        ys[5] = np.nan
    together = run(method, model, start, ys)
    assert np.isfinite(together.log_likelihood).all()
    np.testing.assert_array_equal(together.degrees, np.sum(~np.isnan(ys), axis=-1))
    np.testing.assert_array_equal(np.isnan(together.innovation), np.isnan(ys))
    for b in range(B):
        alone = run(method, model, Belief(start.mean[b], start.covariance[b]), ys[:, b])
        np.testing.assert_allclose(alone.beliefs.mean, together.beliefs.mean[:, b], rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(alone.log_likelihood, together.log_likelihood[:, b], rtol=1e-9, atol=1e-9)
        if "kalman" in method.exempt:
            continue
        beliefs, logs = by_hand(model, Belief(start.mean[b], start.covariance[b]), ys[:, b])
        np.testing.assert_allclose(alone.beliefs.mean, [each.mean for each in beliefs], rtol=1e-8, atol=1e-8)
        np.testing.assert_allclose(alone.beliefs.covariance, [each.covariance for each in beliefs], atol=1e-8)
        np.testing.assert_allclose(alone.log_likelihood, logs, rtol=1e-8, atol=1e-8)


def test_a_masked_array_and_none_are_missing_seed_3() -> None:
    model, start, ys = problem(3)
    start, ys = Belief(start.mean[0], start.covariance[0]), ys[:, 0]
    want = run("kalman", model, start, ys)
    masked = np.ma.masked_array(np.where(np.isnan(ys), 7.0, ys), np.isnan(ys))
    listed = [None if np.isnan(y).all() else y for y in ys]
    for given in (masked, listed, [*masked]):
        np.testing.assert_array_equal(run("kalman", model, start, given).beliefs.mean, want.beliefs.mean)


def test_a_model_of_the_step_has_its_time_and_measures_what_it_will_seed_4() -> None:
    """Uneven times, and two sensors of different size: as predict and update of the same."""
    rng = np.random.default_rng(4)
    ts = np.array([0.0, 0.5, 2.0, 2.0, 5.0])
    ys = [rng.normal(0, 1, 1 + k % 2) for k in range(5)]
    steps: list[Step] = []

    def process(dt: float) -> Any:
        return lambda rows: np.stack([rows[:, 0] + dt * np.sin(rows[:, 1]), rows[:, 1]], 1)

    def at(step: Step) -> Model:
        steps.append(step)
        m = 1 + step.k % 2
        return Model(process(step.dt), step.dt * np.eye(2), lambda rows: rows[:, :m] ** 2, np.eye(m))

    start = Belief(np.array([1.0, 0.5]), np.eye(2))
    found = run("unscented", at, start, ys, ts)
    assert [(step.k, step.t) for step in steps] == [*enumerate(ts)]
    belief, weights = start, unscented.julier_weights(2)
    for k, y in enumerate(ys):
        if k and ts[k] > ts[k - 1]:
            dt = ts[k] - ts[k - 1]
            belief = unscented.predict(belief, process(dt), dt * np.eye(2), weights)
        update = unscented.update(belief, y, at(Step(k, 0.0, 1.0)).measure, np.eye(len(y)), weights)
        belief = update.belief
        np.testing.assert_array_equal(found.beliefs.mean[k], belief.mean)
        assert found.log_likelihood[k] == pytest.approx(log_likelihood(update), rel=1e-12)
    assert found.innovation.shape == (5, 2)
    np.testing.assert_array_equal(found.degrees, [1, 2, 1, 2, 1])


def test_late_measurements_in_the_order_of_their_times_seed_5() -> None:
    model, start, ys = problem(5)
    model, start, ys = model._replace(inputs=None), Belief(start.mean[0], start.covariance[0]), ys[:, 0]
    ts = np.arange(float(T))
    ts[[3, 4]] = ts[[4, 3]]
    with pytest.raises(FilterError, match=r"ts\[4\] = 3 is before ts\[3\] = 4: put the record in the order"):
        run("kalman", model, start, ys, ts)
    order = np.argsort(ts, kind="stable")
    late = run("extended", model, start, ys[order], ts[order])
    np.testing.assert_allclose(late.beliefs.mean[5], run("kalman", model, start, ys[order]).beliefs.mean[5])


def test_modes_with_a_model_each_and_their_mixture_s_likelihood_seed_6() -> None:
    rng = np.random.default_rng(6)
    transition = np.array([[0.9, 0.1], [0.3, 0.7]])
    slow, fast = 0.01 * np.eye(1), 4.0 * np.eye(1)
    imm = multiple_model.interacting("two", [methods()["kalman"]] * 2, transition, np.array([0.6, 0.4]))
    model = Model((lambda rows: rows, lambda rows: 0.5 * rows), (slow, fast), lambda rows: rows.copy(), np.eye(1))
    found = run(imm, model, Belief(np.zeros(1), np.eye(1)), rng.normal(0, 1, (2, 1)))
    # the second measurement's density, by hand: mixed, predicted and weighed
    y0, y1 = found.innovation[0, 0], found.innovation[1, 0] + found.predicted[1, 0]
    after = y0 / 2, 0.5  # both modes alike
    ahead = np.array([0.6, 0.4]) @ transition
    each = [(after[0], after[1] + 0.01), (0.5 * after[0], 0.25 * after[1] + 4.0)]
    density = sum(
        p * np.exp(-0.5 * (y1 - m) ** 2 / (v + 1)) / np.sqrt(2 * np.pi * (v + 1))
        for p, (m, v) in zip(ahead, each, strict=True)
    )
    assert found.log_likelihood[1] == pytest.approx(np.log(density), rel=1e-12)


def test_what_does_not_fit_is_refused_and_where() -> None:
    model, start, ys = LinearModel(ONE, ONE, ONE, ONE), Belief(np.zeros(1), ONE), np.zeros((3, 1))
    bad = Model(lambda rows: rows * np.nan, ONE, lambda rows: rows.copy(), ONE)
    wrong: list[tuple[Any, str]] = [
        (("kalman", model, start, np.zeros((3, 1, 1))), r"ys\[0\]: has shape \(1, 1\); ys must be \(T, m\)"),
        (("kalman", model, start, []), "ys: has no measurement"),
        (("kalman", model, start, ys, [0.0, 1.0]), "ts: must be 3 finite times"),
        (("kalman", model, start, ys, [0.0, 1.0, 1.0]), "ts: must increase for a LinearModel"),
        (("kalman", model._replace(F=np.eye(2)), start, ys), r"F: must be finite and \(1, 1\), or \(2, 1, 1\)"),
        (("kalman", model, start, np.full((3, 1), np.inf)), r"ys\[0\], t = 0: y: not finite"),
        (("kalman", model._replace(R=-ONE), start, ys), r"ys\[0\], t = 0: "),
        (("unscented", bad, start, ys), r"ys\[1\], t = 1: process: gave states"),
        (("unscented", model, Belief(np.zeros(1), np.eye(2)), ys), "mean"),
    ]
    for arguments, message in wrong:
        with pytest.raises(FilterError, match=message):
            run(*arguments)
    with pytest.raises(KeyError, match="no filter named 'kalmann'"):
        run("kalmann", model, start, ys)
    one = run("kalman", model, start, ys[:1])  # nothing leads anywhere
    np.testing.assert_allclose(one.beliefs.covariance, [[[0.5]]])
    assert extended.METHODS[0].name == run("extended", model, start, ys).method.name


PER_STEP = {"F": T - 1, "Q": T - 1, "H": T, "R": T, "inputs": T - 1}


def misfits(name: str, model: LinearModel) -> list[Any]:
    """What does not fit a record of T measurements, though a loop that takes what it needs step by step would not
    notice: one too many, too few, another shape, and what is no number."""
    given = np.asarray(getattr(model, name))
    one = given[0] if name == "inputs" else given
    each = np.repeat(one[None], PER_STEP[name], axis=0)
    wrong = [np.concatenate([each, each[:1]]), each[:-1], each[:, :1], each[..., :1], one[..., :1], each * np.nan]
    return [*wrong, np.ma.masked_array(each, each > 0), each.astype(complex), each[0].astype(str)]


@pytest.mark.parametrize("method", ["kalman", "extended", "unscented", "particle", "imm"])
@pytest.mark.parametrize("name", PER_STEP)
def test_every_loop_checks_a_linear_model_alike_seed_7(method: str, name: str) -> None:
    """Of inputs with a row too many NIS was 608 for 0 in all loops but one; a row too few was an IndexError."""
    model, start, ys = problem(7)
    start, ys = Belief(start.mean[0], start.covariance[0]), ys[:, 0]
    for wrong in misfits(name, model):
        with pytest.raises(FilterError, match=rf"^{name}: must be "):
            run(method, model._replace(**{name: wrong}), start, ys)
    with pytest.raises(FilterError, match="ts: must increase for a LinearModel"):
        run(method, model, start, ys, np.repeat(np.arange(T / 2), 2))
    with pytest.raises(FilterError, match="ys: must be of one size for a LinearModel"):
        run(method, model, start, [*ys[:-1], ys[-1, :1]])


@pytest.mark.parametrize("method", ["kalman", "extended", "unscented", "imm"])
def test_every_loop_takes_matrices_by_step_lists_and_integers_alike_seed_8(method: str) -> None:
    model, start, ys = problem(8)
    start, ys = Belief(start.mean[0], start.covariance[0]), ys[:, 0]
    F, Q, H, R = (np.rint(a) for a in (model.F, 9 * model.Q, 9 * model.H, 9 * model.R))
    whole = LinearModel(F, Q, H, R, np.ones(N))
    want = run("kalman", whole, start, ys)
    each = {name: np.repeat(getattr(whole, name)[None], count, axis=0) for name, count in PER_STEP.items()}
    for given in (
        whole,
        LinearModel(**each),
        LinearModel(**{name: a.astype(int) for name, a in each.items()}),
        LinearModel(**{name: a.tolist() for name, a in each.items()}),
    ):
        found = run(method, given, start, ys)
        np.testing.assert_allclose(found.beliefs.mean, want.beliefs.mean, rtol=1e-7, atol=1e-7)
        if method != "imm":
            np.testing.assert_allclose(smooth(found).mean, smooth(want).mean, rtol=1e-7, atol=1e-7)
        if method == "kalman":
            fit = expectation_maximisation(whole._replace(inputs=given.inputs), start, ys, iterations=2)
            assert np.isfinite(fit.model.Q).all()
    nowhere = {name: a[: count - T + 1] for (name, a), count in zip(each.items(), PER_STEP.values(), strict=True)}
    for given in (whole, LinearModel(**nowhere)):  # of one measurement, none leads to another
        one = run(method, given, start, ys[:1])
        np.testing.assert_allclose(one.beliefs.mean[0], want.beliefs.mean[0], rtol=1e-7)


def turning(rows: Array) -> Array:
    """A tenth of a second of x, y, speed, heading and its rate."""
    x, y, v, heading, rate = rows.T
    moved = [x + 0.1 * v * np.cos(heading), y + 0.1 * v * np.sin(heading), v, heading + 0.1 * rate, rate]
    return np.stack(moved, 1)


TURNING = Model(
    turning,
    np.diag([1e-4, 1e-4, 1e-3, 1e-4, 1e-3]),
    lambda rows: rows[:, [0, 1, 3]],
    np.diag([0.25, 0.25, 0.01]),
    angular=(2,),
    angular_states=(3,),
)


def gap(members: int, silent: tuple[int, ...]) -> tuple[Belief, Array, Array]:
    """Truth and measurements of a batch, of which some have none for 22 s after the tenth."""
    first = np.array([0.0, 0.0, 10.0, 0.0, 0.1])
    P = np.diag([0.01, 0.01, 0.01, 0.01, 0.01])
    start = Belief(np.tile(first, (members, 1)), np.tile(P, (members, 1, 1)))
    truth, ys = simulate(TURNING, start, 260, np.random.default_rng(9))
    ys[10:230, list(silent)] = np.nan
    return start, truth, ys


@pytest.mark.parametrize(
    "method",
    [
        *("unscented", "square-root", "ensemble", "augmented", "csvsf-robust", "imm"),
    ],
)
def test_a_heading_without_measurements_for_22_s_goes_on_and_is_found_again_seed_9(method: str) -> None:
    """It is too wide for sigma points: of members 1 and 3 alone."""
    start, truth, ys = gap(5, (1, 3))
    found = run(method, TURNING, start, ys)
    assert found.lost == ()
    np.testing.assert_array_equal(found.wide.any(axis=0), [False, True, False, True, False])
    assert found.wide[:, 1].sum() > 100
    assert not found.wide[:30].any()
    assert not found.wide[235:].any()
    off = consistency.errors(found, truth)
    assert np.abs(off[-1]).max() < 1.0
    within = np.abs(off) / np.sqrt(np.diagonal(found.beliefs.covariance, axis1=-2, axis2=-1))
    assert within[found.wide].max() < 4
    assert found.beliefs.covariance[229, 1, 3, 3] == pytest.approx(np.pi**2 / 3, rel=0.01)
    if method == "ensemble":  # each of a batch has its own numbers
        return
    for b in (0, 1):
        alone = run(method, TURNING, Belief(start.mean[b], start.covariance[b]), ys[:, b])
        np.testing.assert_array_equal(alone.wide, found.wide[:, b])
        for one, of_batch in (
            (alone.beliefs.mean, found.beliefs.mean),
            (alone.log_likelihood, found.log_likelihood),
        ):
            np.testing.assert_allclose(one, of_batch[:, b], rtol=1e-7, atol=1e-7)
        if "kalman" not in families.method(method).exempt and method != "imm":
            np.testing.assert_allclose(smooth(alone).mean, smooth(found).mean[:, b], rtol=1e-6, atol=1e-6)


def test_a_gap_of_22_s_is_as_uncertain_as_it_is_wrong_seed_9() -> None:
    """Where no filter of a batch is narrow. The extended filter goes on by its tangent: its NEES is 800."""
    start, truth, ys = gap(24, (*range(24),))
    found = run("gauss-hermite", TURNING, start, ys)
    for beliefs in (found.beliefs, smooth(found)):
        nees = consistency.nees(beliefs, truth, angular_states=(3,)).mean
        assert nees[[100, 150, 229]].max() < 6.5
        assert nees[[231, 245, 259]].max() < 7.5
        assert nees[[100, 150, 229, 231, 245, 259]].min() > 2.0


def exact(failing: tuple[int, ...]) -> tuple[LinearModel, Belief, Array]:
    """Of a batch of B some are known exactly, and measured exactly at the fifth measurement: their innovation has
    no width."""
    _, start, ys = problem(10)
    H, R = np.tile(np.eye(1, N), (T, 1, 1)), np.ones((T, 1, 1))
    F, Q = np.tile(np.eye(N), (T - 1, 1, 1)), np.zeros((T - 1, N, N))
    R[4] = 0
    P = start.covariance.copy()
    P[list(failing)] = 0
    return LinearModel(F, Q, H, R), Belief(start.mean, P), np.nan_to_num(ys[..., :1])


@pytest.mark.parametrize("method", ["kalman", "extended"])
def test_where_no_filter_is_left_the_good_steps_are_in_the_error_seed_10(method: str) -> None:
    model, start, ys = exact((*range(B),))
    with pytest.raises(NotPositiveDefiniteError, match="of the batch") as failed:
        run(method, model, start, ys)
    found = failed.value.found
    assert len(found.lost) == B - 1
    assert len(found.ts) == 4
    assert np.isfinite(found.beliefs.mean).all()


@pytest.mark.parametrize("method", ["kalman", "extended"])
def test_one_that_stands_in_for_others_may_fail_too_seed_10(method: str) -> None:
    """All but the last: each stood in for those before it."""
    model, start, ys = exact((*range(B - 1),))
    found = run(method, model, start, ys)
    assert sorted(one.member for one in found.lost) == [*range(B - 1)]
    assert np.isfinite(found.beliefs.mean[:, -1]).all()
    assert np.isnan(found.beliefs.mean[4:, :-1]).all()
    truth = np.zeros_like(found.beliefs.mean)
    assert consistency.nees(found, truth).expected[-1] == N  # those that were lost do not count
    assert np.isfinite(consistency.rms(found, truth)).all()
    assert consistency.nis(found).expected[-1] == 1.0


def test_the_compiled_loop_leaves_out_a_member_too_seed_10() -> None:
    """Known exactly and measured exactly, from the fourth measurement on: its innovation has no width."""
    model, (mean, P), ys = exact((2,))
    for method in ("kalman", "extended"):
        found = run(method, model, Belief(mean, P), ys)
        assert [(one.member, one.k) for one in found.lost] == [(2, 4)]
        assert np.isfinite(found.beliefs.mean[:4, 2]).all()
        assert np.isnan(found.beliefs.mean[4:, 2]).all()
        np.testing.assert_array_equal(found.beliefs.mean[:4, 2], np.tile(mean[2], (4, 1)))
        alone = run(method, model, Belief(mean[3], P[3]), ys[:, 3])
        np.testing.assert_allclose(alone.beliefs.mean, found.beliefs.mean[:, 3], atol=1e-9)
        with pytest.raises(NotPositiveDefiniteError, match=r"^ys\[4\], t = 4: ") as failed:
            run(method, model, Belief(mean[2], P[2]), ys[:, 2])
        assert len(failed.value.found.ts) == 4
    with pytest.raises(FilterError, match="R") as at_once:  # an argument, and no member's fault
        run("kalman", model._replace(R=-model.R[0]), Belief(mean, P), ys)
    assert at_once.value.found is None


def test_jacobians_of_one_s_own_are_taken_in_runs_and_smoothers_seed_11() -> None:
    calls = {"process": 0, "measure": 0}

    def of_process(rows: Array) -> Array:
        calls["process"] += 1
        v, heading, n = rows[:, 2], rows[:, 3], len(rows)
        slope = np.tile(np.eye(5), (n, 1, 1))
        slope[:, 0, 2], slope[:, 0, 3] = 0.1 * np.cos(heading), -0.1 * v * np.sin(heading)
        slope[:, 1, 2], slope[:, 1, 3] = 0.1 * np.sin(heading), 0.1 * v * np.cos(heading)
        slope[:, 3, 4] = 0.1
        return slope

    def of_measure(rows: Array) -> Array:
        calls["measure"] += 1
        return np.tile(np.eye(5)[[0, 1, 3]], (len(rows), 1, 1))

    start, _, ys = gap(3, (1,))
    ys = ys[:60]
    ys[7, 0, 1] = ys[30:40, 2, 0] = np.nan
    own = TURNING._replace(process_jacobian=of_process, measure_jacobian=of_measure)
    stepped = TURNING._replace(process_jacobian=extended.complex_step(turning))
    want = run("extended", TURNING, start, ys)
    for model in (own, stepped, lambda _: own):
        found = run("extended", model, start, ys)
        np.testing.assert_allclose(found.beliefs.mean, want.beliefs.mean, rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(found.log_likelihood, want.log_likelihood, rtol=1e-5, atol=1e-5)
        before = dict(calls)
        np.testing.assert_allclose(smooth(found).mean, smooth(want).mean, rtol=1e-5, atol=1e-5)
        assert model is stepped or calls["process"] > before["process"] > 0 < calls["measure"]
    with pytest.raises(FilterError, match=r"ys\[1\], t = 1: jacobian: gave"):
        run("extended", TURNING._replace(process_jacobian=lambda rows: rows), start, ys)


def test_complex_steps_are_the_derivatives_to_the_last_digits() -> None:
    rows = np.array([[0.3, 2.0], [1.0, 0.5]])
    found = extended.complex_step(lambda x: np.stack([np.sin(x[:, 0]) * x[:, 1], x[:, 1] ** 3], 1))(rows)
    want = [[[np.cos(a) * b, np.sin(a)], [0.0, 3 * b * b]] for a, b in rows]
    np.testing.assert_allclose(found, want, rtol=1e-15)
    with pytest.raises(FilterError, match="model: gave float64"):
        extended.complex_step(lambda x: x.real)(rows)


def test_times_with_a_unit_are_seconds_since_the_first() -> None:
    """Nanoseconds of datetime64 were taken for seconds without a word."""
    model = lambda step: Model(  # noqa: E731
        lambda rows: rows + step.dt, step.dt * np.eye(1), lambda rows: rows, np.eye(1)
    )
    start, ys, ts = Belief(np.zeros(1), np.eye(1)), np.array([0.0, 0.6, 0.9]), np.array([5.0, 5.5, 6.0])
    plain = run("unscented", model, start, ys, ts - ts[0])
    dated = np.datetime64("2026-11-29T00:00:00", "ns") + (1e9 * ts).astype("timedelta64[ns]")
    for times in (dated, dated - dated[0], dated.astype("datetime64[ms]")):
        found = run("unscented", model, start, ys, times)
        np.testing.assert_array_equal(found.ts, plain.ts)
        np.testing.assert_array_equal(found.beliefs.mean, plain.beliefs.mean)
    for bad in (np.array(["a", "b", "c"]), np.array([dated[0], "NaT", dated[2]], "datetime64[ns]")):
        with pytest.raises(FilterError, match=r"^ts: must be"):
            run("unscented", model, start, ys, bad)


def test_a_function_may_return_a_linear_model_of_the_closed_forms_and_nothing_else() -> None:
    """Also where the first step, or a repeated time, leads nowhere."""
    H = np.eye(1, 2)
    start, ts = Belief(np.zeros(2), np.eye(2)), np.array([0.0, 1.0, 1.0, 2.5])
    by_step = lambda step: LinearModel(*white_acceleration(step.dt, 0.1, axes=1), H, np.eye(1))  # noqa: E731
    found = run("kalman", by_step, start, np.array([0.0, 1.0, 1.2, 2.4]), ts)
    assert found.beliefs.mean[-1] == pytest.approx([2.4, 0.9], abs=0.4)
    with pytest.raises(FilterError, match="must return its Model, not tuple"):
        run("kalman", lambda _: (H, H), start, np.zeros(4), ts)


@pytest.mark.skipif(not kernels.are_compiled(), reason="WINGLINE_KERNELS: nothing is compiled")
def test_the_loop_over_a_record_lets_other_threads_run() -> None:
    """A thread counts on while another filters a record of a second."""
    count, steps = 0, 200_000
    F, R, one = np.eye(4)[None], np.eye(4)[None], np.ones((1, 4))
    record = one, F, F, F, 0.0 * one, F, R, np.ones((steps, 1, 4)), np.zeros(4, bool)
    with ThreadPoolExecutor(1) as pool:
        done = pool.submit(records.filter_record, *record)
        while not done.done():
            count += 1
    assert done.result()[-1] == 0
    assert count > 100
