"""NEES, NIS and errors of runs with their bounds, and the figures of them."""

import matplotlib as mpl
import numpy as np
import pytest

from onboard.filters import (
    Belief,
    FilterError,
    LinearModel,
    Model,
    consistency,
    discretisation,
    gating,
    plots,
    run,
    simulate,
    smooth,
)
from onboard.filters.runs import Run

RUNS, STEPS = 200, 40


@pytest.fixture(scope="module")
def flown() -> tuple[Run, np.ndarray]:
    """200 runs of the very model, of which half the measurements of the second half are missing; seed 1."""
    rng = np.random.default_rng(1)
    F, Q = discretisation.white_acceleration(1.0, 0.1, axes=1)
    x, truth, ys = rng.normal(0, 1, (RUNS, 2)), [], []
    for k in range(STEPS):
        x = x if k == 0 else x @ F.T + rng.multivariate_normal(np.zeros(2), Q, RUNS)
        truth.append(x)
        ys.append(x[:, :1] + rng.normal(0, 1, (RUNS, 1)))
    measured = np.stack(ys)
    measured[20:, ::2] = np.nan
    measured[30] = np.nan
    start = Belief(np.zeros((RUNS, 2)), np.tile(np.eye(2), (RUNS, 1, 1)))
    return run("kalman", LinearModel(F, Q, np.eye(1, 2), np.eye(1)), start, measured), np.stack(truth)


def test_a_filter_of_the_right_model_is_inside_and_a_sure_one_above(flown: tuple[Run, np.ndarray]) -> None:
    found, truth = flown
    nis, nees = consistency.nis(found), consistency.nees(found.beliefs, truth)
    assert nis.inside > 0.85
    assert nees.inside > 0.85
    np.testing.assert_allclose(nis.expected[[0, 25]], [1.0, 1.0])
    assert np.isnan([nis.mean[30], nis.low[30]]).all()
    low, high = gating.mean_bounds(2, RUNS)
    np.testing.assert_allclose([nees.low, nees.high], np.outer([low, high], np.ones(STEPS)))
    sure = Belief(found.beliefs.mean, 0.5 * found.beliefs.covariance)
    assert consistency.nees(sure, truth).inside == 0.0
    one = Belief(found.beliefs.mean[:, 0], found.beliefs.covariance[:, 0])
    assert consistency.nees(one, truth[:, 0]).inside > 0.7


def test_the_error_of_some_states(flown: tuple[Run, np.ndarray]) -> None:
    found, truth = flown
    error = found.beliefs.mean - truth
    np.testing.assert_allclose(
        consistency.rms(found.beliefs, truth)[3], np.sqrt(np.mean(np.sum(error[3] ** 2, -1)))
    )
    np.testing.assert_allclose(
        consistency.rms(found.beliefs, truth, (1,))[3], np.sqrt(np.mean(error[3, :, 1] ** 2))
    )
    with pytest.raises(FilterError, match="truth: must have the shape of the means"):
        consistency.rms(found.beliefs, truth[:, :1])


def test_errors_of_angles_wrap_everywhere_seed_3() -> None:
    """A heading near pi, whose estimate is on the other side of the seam: the NEES was 6577, for 1."""
    rng, P = np.random.default_rng(3), np.diag([1e-2, 0.25])
    model = Model(lambda r: r.copy(), 1e-6 * np.eye(2), lambda r: r.copy(), P, angular=(0,), angular_states=(0,))
    start = Belief(np.tile([np.pi, 1.0], (RUNS, 1)), np.tile(P, (RUNS, 1, 1)))
    truth, ys = simulate(model, start, STEPS, rng)
    truth[..., 0] = (truth[..., 0] + np.pi) % (2 * np.pi) - np.pi  # kept in [-pi, pi], as a log keeps it
    found = run("unscented", model, start, ys)
    named = {"angular_states": (0,)}
    assert consistency.nees(found, truth).inside > 0.8
    assert consistency.nees(found.beliefs, truth, **named).inside > 0.8
    assert consistency.nees(smooth(found), truth, **named).mean.max() < 3.0
    assert consistency.nees(found, truth, angular_states=()).mean.min() > 100.0  # as of any other state
    sigma = np.sqrt(found.beliefs.covariance[..., 0, 0].mean(axis=1))
    np.testing.assert_allclose(consistency.rms(found, truth, (0,)), sigma, rtol=0.25)
    np.testing.assert_array_equal(
        consistency.rms(found.beliefs, truth, (0,), **named), consistency.rms(found, truth, (0,))
    )
    mpl.use("agg")
    one = found._replace(beliefs=Belief(found.beliefs.mean[:, 0], found.beliefs.covariance[:, 0]))
    for axes in (plots.errors(one, truth[:, 0]), plots.errors(one.beliefs, truth[:, 0], **named)):
        assert np.abs(axes[0].lines[0].get_ydata()).max() < 1.0
    assert plots.nees(found, truth).lines[0].get_ydata().max() < 4.0
    assert plots.nees(found.beliefs, truth, **named).lines[0].get_ydata().max() < 4.0
    mpl.pyplot.close("all")


def test_figures_are_drawn_in_a_line_each(flown: tuple[Run, np.ndarray]) -> None:
    mpl.use("agg")
    found, truth = flown
    one = Belief(found.beliefs.mean[:, 0], found.beliefs.covariance[:, 0])
    assert len(plots.track(one, truth[:, 0]).lines) == 2 + STEPS // 5
    assert "% inside" in plots.nis(found).get_legend_handles_labels()[1][1]
    assert plots.nees(found.beliefs, truth).get_ylabel() == "NEES"
    assert len(plots.errors(one, truth[:, 0])) == 2
    with pytest.raises(FilterError, match="beliefs: must be of one run"):
        plots.track(found.beliefs)
    mpl.pyplot.close("all")


def test_an_ellipse_holds_its_share_seed_2() -> None:
    P = np.array([[4.0, 1.0, 0.5], [1.0, 2.0, 0.0], [0.5, 0.0, 1.0]])
    belief = Belief(np.array([1.0, 2.0, 3.0]), P)
    points = plots.outline(belief, (2, 0), 0.9)
    off = points - belief.mean[[2, 0]][:, None]
    chosen = P[np.ix_([2, 0], [2, 0])]
    np.testing.assert_allclose(
        np.sum(off * np.linalg.solve(chosen, off), axis=0), gating.chi_square_threshold(0.9, 2), rtol=1e-9
    )


def test_the_bound_of_a_linear_model_is_the_kalman_filters_covariance(flown: tuple[Run, np.ndarray]) -> None:
    found, truth = flown
    start = Belief(np.zeros(2), np.eye(2))
    bound = consistency.cramer_rao(found.model, start, truth[:30])
    np.testing.assert_allclose(bound[:20], found.beliefs.covariance[:20], rtol=1e-9)
    assert bound.shape == (30, RUNS, 2, 2)
    alone = consistency.cramer_rao(found.model, start, truth[:30, 0])
    np.testing.assert_allclose(alone, bound[:, 0])
    with_gap = consistency.cramer_rao(found.model, start, truth[:2, 0], np.array([0.0, 0.0]))
    assert with_gap[1, 0, 0] == pytest.approx(1 / 3)


def test_no_filter_is_better_than_the_bound_seed_3() -> None:
    """Ranges to two beacons: 300 runs of the unscented filter reach the bound, but for chance."""
    F, Q = discretisation.white_acceleration(1.0, 1e-3, axes=2)
    beacons = np.array([[0.0, 0.0], [30.0, 0.0]])
    model = Model(
        lambda rows: rows @ F.T,
        Q,
        lambda rows: np.linalg.norm(rows[:, None, :2] - beacons, axis=2),
        0.25 * np.eye(2),
    )
    rng = np.random.default_rng(3)
    begin, P0 = np.array([20.0, 15.0, -1.0, 0.0]), np.diag([4.0, 4.0, 0.1, 0.1])
    x, truth, ys = begin + rng.multivariate_normal(np.zeros(4), P0, 300), [], []
    for k in range(20):
        x = x if k == 0 else x @ F.T + rng.multivariate_normal(np.zeros(4), Q, 300)
        truth.append(x)
        ys.append(model.measure(x) + rng.normal(0, 0.5, (300, 2)))
    path = np.stack(truth)
    start = Belief(np.tile(begin, (300, 1)), np.tile(P0, (300, 1, 1)))
    found = run("unscented", model, start, np.stack(ys))
    bound = np.trace(consistency.cramer_rao(model, Belief(begin, P0), path).mean(axis=1)[-1])
    reached = float(consistency.rms(found, path)[-1] ** 2)
    assert 0.85 < reached / bound < 1.2
