"""Smoothed particles: against Rauch, Tung & Striebel on a line, and what they alone can."""

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
    particle,
    run,
    simulate,
    smooth,
    smooth_particles,
)

ONE = np.eye(1)
F, Q = np.array([[1.0, 0.5], [0.0, 0.9]]), np.diag([0.1, 0.2])
LINE = LinearModel(F, Q, np.eye(1, 2), 0.3 * ONE)


@pytest.mark.parametrize("lead", [(3,)], ids=["batch"])
def test_on_a_line_they_are_the_smoother_s_seed_1(lead: tuple[int, ...]) -> None:
    start = Belief(np.zeros((*lead, 2)), np.broadcast_to(np.eye(2), (*lead, 2, 2)).copy())
    _, ys = simulate(LINE, start, 30, np.random.default_rng(1))
    ys[10:14] = np.nan
    want = smooth(run("kalman", LINE, start, ys))
    paths = smooth_particles(run("particle", LINE, start, ys), 400, seed=1)
    assert paths.shape == (30, *lead, 400, 2)
    sigma = np.sqrt(np.diagonal(want.covariance, axis1=-2, axis2=-1))
    off = (paths.mean(axis=-2) - want.mean) / sigma
    assert np.sqrt(np.mean(off**2)) < 0.25
    assert 0.8 < np.mean(paths.std(axis=-2) / sigma) < 1.2
    filtered = run("particle", LINE, start, ys).beliefs.mean
    assert np.sqrt(np.mean(off**2)) < 0.5 * np.sqrt(np.mean(((filtered - want.mean) / sigma) ** 2))
    # a path is one: its steps have the noise of the process
    steps = paths[1:] - paths[:-1] @ F.T
    np.testing.assert_allclose(steps.reshape(-1, 2).var(axis=0), np.diag(Q), rtol=0.3)


def test_two_hypotheses_are_decided_backwards_and_a_seed_draws_again_seed_2() -> None:
    """The square leaves the sign open until the fourth measurement, which is of the state itself."""

    def at(step: Step) -> Model:
        square = step.k < 3
        return Model(lambda r: r.copy(), 0.01 * ONE, lambda r: r**2 if square else r.copy(), 0.01 * ONE)

    fine = particle.METHOD._replace(start=lambda mean, P: particle.start(mean, P, bandwidth=0.1))
    found = run(fine, at, Belief(np.zeros(1), 4 * ONE), np.array([[4.0], [4.0], [4.0], [-2.0]]))
    assert (found.states[1].particles > 0).mean() > 0.2
    paths = smooth_particles(found, 200, seed=1)
    assert (paths < 0).all()
    np.testing.assert_array_equal(paths, smooth_particles(found, 200, seed=1))
    assert not np.array_equal(paths, smooth_particles(found, 200, seed=2))


def test_a_heading_is_smoothed_across_the_seam_and_a_time_may_repeat_seed_3() -> None:
    def turn(rows: Array) -> Array:
        return np.asarray((rows + 0.3 + np.pi) % (2 * np.pi) - np.pi)

    model = Model(turn, 0.01 * ONE, lambda r: r.copy(), 0.01 * ONE, (0,), (0,))
    start, ts = Belief(np.array([2.0]), 0.01 * ONE), np.array([0.0, 1, 2, 3, 3, 4, 5, 6])
    truth, ys = simulate(model, start, ts, np.random.default_rng(3))
    paths = smooth_particles(run("particle", model, start, ys, ts), 300)
    off = (paths.mean(axis=1) - truth + np.pi) % (2 * np.pi) - np.pi
    assert np.abs(np.angle(np.exp(1j * (paths - truth[:, None])))).max() < 0.6
    assert np.sqrt(np.mean(np.angle(np.exp(1j * off)) ** 2)) < 0.15
    np.testing.assert_array_equal(paths[3], paths[4])


def test_what_has_no_particles_or_no_density_is_refused() -> None:
    start, ys = Belief(np.zeros(2), np.eye(2)), np.zeros((4, 1))
    with pytest.raises(FilterError, match="smooth_particles: kalman has no particles; `smooth` smooths it"):
        smooth_particles(run("kalman", LINE, start, ys))
    found = run("particle", LINE, start, ys)
    with pytest.raises(FilterError, match="smooth: takes a Gaussian filter; a cloud of particles has"):
        smooth(found)
    with pytest.raises(FilterError, match="paths: must be at least 1, not 0"):
        smooth_particles(found, 0)
    with pytest.raises(NotPositiveDefiniteError, match="Q: must be positive definite to smooth particles"):
        smooth_particles(run("particle", LINE._replace(Q=np.diag([0.0, 1.0])), start, ys))
