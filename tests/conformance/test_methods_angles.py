"""Angles in every method: measured ones that wrap, headings among the states, and beliefs too wide for either."""

from typing import Any

import numpy as np
import pytest

from onboard.arrays import Array
from onboard.filters import (
    Model,
    augmented,
    methods,
    multiple_model,
    run,
    smooth,
    smooth_modes,
    smoothing,
    square_root,
    unscented,
)
from onboard.filters.belief import Belief, FilterError, Method
from onboard.filters.errors import SpreadError
from onboard.filters.runs import Run
from onboard.filters.unscented_transform import julier_weights
from tests.conformance.problems import cases
from tests.support.filter_problems import identity

every = pytest.mark.parametrize("method", cases(methods()))
HEADING = (0,)
START = Belief(np.array([np.pi - 0.06, 0.5]), np.diag([0.01, 0.01]))  # heading, and its rate
Q = 1e-6 * np.eye(2)


def wrap(angles: Array) -> Array:
    return np.asarray((angles + np.pi) % (2 * np.pi) - np.pi)


def turning(rows: Array) -> Array:
    """A tenth of a second later, the heading in [-pi, pi]."""
    return np.stack([wrap(rows[:, 0] + 0.1 * rows[:, 1]), rows[:, 1]], 1)


def off(angle: Any, wanted: Any) -> Any:
    return np.abs(wrap(np.asarray(angle) - wanted))


@every
@pytest.mark.parametrize("lead", [(), (3,)], ids=["one", "batch"])
def test_a_heading_is_predicted_across_the_seam(method: Method, lead: tuple[int, ...]) -> None:
    """Without `angular_states` 1.037 +- 2.90, for 3.132 +- 0.10."""
    mean, P = (np.broadcast_to(a, (*lead, *a.shape)).copy() for a in START)
    after = method.belief(method.predict(method.start(mean, P), turning, Q, HEADING))
    assert np.all(off(after.mean[..., 0], 3.1316) < 1e-3)
    np.testing.assert_allclose(np.sqrt(after.covariance[..., 0, 0]), 0.1005, atol=1e-3)


@every
def test_a_heading_that_turns_many_times_is_that_of_a_filter_that_counts_turns_seed_1(method: Method) -> None:
    """200 steps of 0.35 rad, the heading measured: as the same filter with a heading that is never wrapped."""
    rng, F = np.random.default_rng(1), np.array([[1.0, 0.1], [0.0, 1.0]])
    wrapped = counted = method.start(np.array([3.0, 3.5]), np.diag([0.04, 0.01]))
    noise, R = np.diag([1e-4, 1e-4]), np.array([[0.01]])
    for k in range(1, 201):
        y = np.array([3.0 + 0.35 * k + 0.1 * rng.normal()])
        counted = method.predict(counted, lambda rows: rows @ F.T, noise)
        counted = method.update(counted, y, lambda rows: rows[:, :1].copy(), R, (0,)).belief
        wrapped = method.predict(wrapped, turning, noise, HEADING)
        update = method.update(wrapped, wrap(y), lambda rows: wrap(rows[:, :1]), R, (0,), HEADING)
        wrapped = update.belief
    ours, theirs = method.belief(wrapped), method.belief(counted)
    assert off(ours.mean[0], theirs.mean[0]) < 1e-9
    np.testing.assert_allclose(ours.mean[1], theirs.mean[1], atol=1e-9)
    np.testing.assert_allclose(ours.covariance, theirs.covariance, rtol=1e-6, atol=1e-12)


@every
@pytest.mark.parametrize("degrees", [120.0, 180.0, 360.0])
def test_a_heading_among_the_states_is_refused_at_any_width_or_right(method: Method, degrees: float) -> None:
    """Measured through a function that wraps, 180 degrees look narrow; of a declared state they do not."""
    wide, y = method.start(np.zeros(1), np.array([[np.radians(degrees) ** 2]])), np.array([0.3])
    try:
        update = method.update(wide, y, wrap, np.array([[1e-4]]), (0,), HEADING)
    except SpreadError:
        return
    if "considered" not in method.name:
        assert method.belief(update.belief).mean[0] == pytest.approx(0.3, abs=0.02)


def test_points_just_within_two_radians_are_taken() -> None:
    for sd, taken in ((1.9 / np.sqrt(3), True), (2.1 / np.sqrt(3), False)):
        belief = Belief(np.array([3.0]), np.array([[sd**2]]))
        if taken:
            after = unscented.update(belief, np.array([3.1]), wrap, np.eye(1), julier_weights(1), (0,)).belief
            assert after.mean[0] == pytest.approx(3.0 + 0.1 * sd**2 / (sd**2 + 1))
        else:
            with pytest.raises(FilterError, match="more than 2 rad from the centre's"):
                unscented.update(belief, np.array([3.1]), wrap, np.eye(1), julier_weights(1), (0,))


@every
def test_two_modes_of_one_heading_a_turn_apart_are_one(method: Method) -> None:
    """0 +- 3.13, for pi +- 0.014."""
    pair = (method, method)
    start = multiple_model.start(pair, np.zeros(1), np.eye(1), np.array([0.5, 0.5]), HEADING)
    P = np.array([[1e-4]])
    apart = tuple(method.start(np.array([mean]), P) for mean in (np.pi - 0.01, -np.pi + 0.01))
    mixed = multiple_model.belief(pair, start._replace(states=apart))
    assert off(mixed.mean[0], np.pi) < 1e-9
    assert np.sqrt(mixed.covariance[0, 0]) == pytest.approx(np.sqrt(2e-4), rel=1e-6)
    stay = np.array([[0.5, 0.5], [0.5, 0.5]])
    ahead = multiple_model.predict(pair, start._replace(states=apart), [identity] * 2, [0 * P] * 2, stay)
    for mode in ahead.states:
        assert off(method.belief(mode).mean[0], np.pi) < 1e-9
        assert np.sqrt(method.belief(mode).covariance[0, 0]) == pytest.approx(np.sqrt(2e-4), rel=1e-6)


def test_steps_and_whole_records_wrap_as_the_two_calls_do() -> None:
    weights = julier_weights(2)
    y, R, measure = np.array([-3.1]), np.array([[0.01]]), lambda rows: wrap(rows[:, :1])
    want = unscented.predict(START, turning, Q, weights, HEADING)
    want = unscented.update(want, y, measure, R, weights, (0,), (), HEADING).belief
    for family, start in ((unscented, START), (square_root, square_root.start(*START))):
        rule = family.rule(weights, 2, 1, (0,), angular_states=HEADING)
        made = family.step(start, turning, Q, y, measure, R, rule)
        np.testing.assert_allclose(made.mean, want.mean, atol=1e-12)
        np.testing.assert_allclose(made.covariance, want.covariance, atol=1e-12)
    one = augmented.step_augmented(
        START,
        augmented.additive(turning),
        Q,
        y,
        augmented.additive(measure),
        R,
        angular=(0,),
        angular_states=HEADING,
    )
    np.testing.assert_allclose(one.belief.mean, want.mean, atol=1e-6)


@pytest.mark.parametrize("lead", [(), (2,)], ids=["one", "batch"])
def test_smoothers_wrap_seed_2(lead: tuple[int, ...]) -> None:
    """Against the record of a heading that is never wrapped."""
    rng, F, weights = np.random.default_rng(2), np.array([[1.0, 0.1], [0.0, 1.0]]), julier_weights(2)
    noise, R = np.diag([1e-3, 1e-2]), np.array([[0.01]])
    counted = Belief(*(np.broadcast_to(a, (*lead, *a.shape)).copy() for a in START))
    record = [counted]
    for k in range(1, 60):
        y = np.full((*lead, 1), 3.0 + 0.3 * k) + 0.1 * rng.normal(size=(*lead, 1))
        counted = unscented.predict(counted, lambda rows: rows @ F.T, noise, weights)
        counted = unscented.update(counted, y, lambda rows: rows[:, :1].copy(), R, weights).belief
        record.append(counted)
    filtered = Belief(*(np.stack(part) for part in zip(*record, strict=True)))
    want = smoothing.rauch_tung_striebel(filtered, F, noise)
    mean = filtered.mean.copy()
    mean[..., 0] = wrap(mean[..., 0])
    seamed = Belief(mean, filtered.covariance)
    found = smoothing.rauch_tung_striebel(seamed, F, noise, angular_states=HEADING)
    assert np.max(off(found.mean[..., 0], want.mean[..., 0])) < 1e-9
    np.testing.assert_allclose(found.mean[..., 1], want.mean[..., 1], atol=1e-9)
    np.testing.assert_allclose(found.covariance, want.covariance, rtol=1e-6, atol=1e-12)


@every
def test_an_angle_that_there_is_not_is_refused(method: Method) -> None:
    state = method.start(*START)
    with pytest.raises(FilterError, match=r"\(5,\)"):
        method.predict(state, turning, Q, (5,))
    with pytest.raises(FilterError, match="angular"):
        method.update(state, np.zeros(1), lambda rows: rows[:, :1].copy(), np.eye(1), (5,))


def counting(rows: Array) -> Array:
    return np.stack([rows[:, 0] + 0.1 * rows[:, 1], rows[:, 1]], 1)


def records(method: Method, seed: int) -> tuple[Run, Run]:
    """The same 60 measurements of a heading of 0.35 rad a step, wrapped and counted; some are missing."""
    rng, noise = np.random.default_rng(seed), np.diag([1e-4, 1e-4])
    ys = 3.0 + 0.35 * np.arange(60.0)[:, None] + 0.1 * rng.normal(size=(60, 1))
    ys[[10, 11, 30]] = np.nan
    start = Belief(np.array([3.0, 3.5]), np.diag([0.04, 0.01]))
    seamed = Model(turning, noise, lambda rows: wrap(rows[:, :1]), np.array([[0.01]]), (0,), HEADING)
    free = Model(counting, noise, lambda rows: rows[:, :1].copy(), np.array([[0.01]]))
    return run(method, seamed, start, wrap(ys)), run(method, free, start, ys)


def same_headings(got: Any, want: Any) -> None:
    assert np.max(off(got.mean[..., 0], want.mean[..., 0])) < 1e-8
    np.testing.assert_allclose(got.mean[..., 1], want.mean[..., 1], atol=1e-8)
    np.testing.assert_allclose(got.covariance, want.covariance, rtol=1e-5, atol=1e-12)


@every
def test_a_record_of_a_heading_is_that_which_counts_turns_and_so_is_it_smoothed_seed_3(method: Method) -> None:
    wrapped, counted = records(method, 3)
    same_headings(wrapped.beliefs, counted.beliefs)
    np.testing.assert_allclose(wrapped.log_likelihood, counted.log_likelihood, atol=1e-7)
    if "kalman" in method.exempt or method.name == "imm":
        return
    same_headings(smooth(wrapped), smooth(counted))
    same_headings(smooth(wrapped, lag=3), smooth(counted, lag=3))
    model = wrapped.model
    assert isinstance(model, Model)
    same_headings(smooth(wrapped._replace(model=lambda _: model)), smooth(counted))


@pytest.mark.parametrize("method", cases({name: one for name, one in methods().items() if not one.exempt}))
def test_modes_of_a_heading_are_smoothed_across_the_seam_seed_4(method: Method) -> None:
    if method.name == "imm":
        return
    transition, pair = np.array([[0.9, 0.1], [0.2, 0.8]]), (method, method)
    imm = multiple_model.interacting("two", pair, transition, factors=(1.0, 25.0))
    wrapped, counted = (smooth_modes(found, pair, transition) for found in records(imm, 4))
    same_headings(wrapped, counted)
    np.testing.assert_allclose(wrapped.probabilities, counted.probabilities, atol=1e-6)
