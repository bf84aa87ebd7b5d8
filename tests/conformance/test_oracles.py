"""Our filters against filterpy's to 1e-9 and Stone Soup's to a centimetre, on the same data.

The radar problem of De Vivo et al. and Varaprasad et al.: nine states, constant acceleration per axis, elevation,
azimuth and range ten times a second. Stone Soup 1.9.1 has no posterior-linearisation filter (it iterates only the
extended one), so the oracle of ours is the paper's recursion, written out below with explicit inverses.
"""

from collections.abc import Callable
from datetime import datetime, timedelta
from itertools import accumulate
from typing import Any

import filterpy.kalman as peers
import numpy as np
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.measurement.nonlinear import CartesianToElevationBearingRange
from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, ConstantAcceleration
from stonesoup.predictor import kalman as predictors
from stonesoup.types.detection import Detection
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.state import GaussianState
from stonesoup.updater import kalman as updaters

from onboard.arrays import Array
from onboard.filters import (
    Belief,
    cubature,
    extended,
    kalman,
    methods,
    multiple_model,
    posterior_linearisation,
    smoothing,
    unscented,
)
from onboard.geometry.rotations import wrap_angle
from tests.conformance.problems import in_sigmas
from tests.support.filter_problems import rows

DT, N, STEPS = 0.1, 9, 300
F = np.kron(np.eye(3), np.array([[1.0, DT, 0.5 * DT**2], [0.0, 1.0, DT], [0.0, 0.0, 1.0]]))
Q = np.kron(
    np.eye(3),
    [[DT**5 / 20, DT**4 / 8, DT**3 / 6], [DT**4 / 8, DT**3 / 3, DT**2 / 2], [DT**3 / 6, DT**2 / 2, DT]],
)
H = np.eye(N)[[0, 3, 6]]
moves, position = rows(F), rows(H)
R_RADAR, R_POSITION = np.diag([2e-4, 2e-4, 10.0]) ** 2, np.diag([30.0, 25.0, 20.0]) ** 2
START = Belief(
    np.array([-6000.0, 110.0, -0.2, 4500.0, -60.0, 0.3, 1000.0, 8.0, -0.05]),
    np.diag(np.tile([300.0, 30.0, 3.0], 3) ** 2),
)
ANGULAR = (0, 1)
WEIGHTS = unscented.julier_weights(N)
EXACT = 1e-9
ABOUT_ZERO = 1e-8  # filterpy's cubature sums squares about zero, kilometres from the mean
INVERTED = 1e-7  # filterpy inverts S, whose condition number is 1e9 here: rad beside m


def radar(states: Array) -> Array:
    x, y, z = states[:, 0], states[:, 3], states[:, 6]
    across = np.hypot(x, y)
    return np.column_stack([np.arctan2(z, across), np.arctan2(y, x), np.hypot(across, z)])


def radar_slope(states: Array) -> Array:
    x, y, z = states[0, [0, 3, 6]]
    across2, total2 = x * x + y * y, x * x + y * y + z * z
    across = np.sqrt(across2)
    slope = np.zeros((1, 3, N))
    slope[0, 0, [0, 3, 6]] = [-x * z / (across * total2), -y * z / (across * total2), across / total2]
    slope[0, 1, [0, 3]] = [-y / across2, x / across2]
    slope[0, 2, [0, 3, 6]] = np.array([x, y, z]) / np.sqrt(total2)
    return slope


def flight(seed: int, measure: Any, R: Array) -> Array:
    rng = np.random.default_rng(seed)
    x = np.random.default_rng(seed + 1000).multivariate_normal(*START)
    seen = np.empty((STEPS, 3))
    for k in range(STEPS):
        x = F @ x + rng.multivariate_normal(np.zeros(N), Q)
        seen[k] = measure(x[None])[0] + rng.multivariate_normal(np.zeros(3), R)
    return seen


def difference(a: Array, b: Array) -> Array:
    made = a - b
    made[:2] = wrap_angle(made[:2])
    return np.asarray(made)


def agrees(ours: Belief, mean: Array, covariance: Array, tolerance: float = EXACT) -> None:
    assert np.all(np.array(in_sigmas(ours, np.ravel(mean), covariance)) <= tolerance)


def prepared(peer: Any, noise: Array, R: Array) -> Any:
    peer.x, peer.P, peer.Q, peer.R = START.mean.copy(), START.covariance.copy(), noise, R
    return peer


def linear_peer(noise: Array = Q) -> Any:
    peer = prepared(peers.KalmanFilter(N, 3), noise, R_POSITION)
    peer.F, peer.H = F, H
    return peer


def kalman_step(belief: Belief, y: Array) -> Belief:
    return kalman.update(kalman.predict(belief, F, Q), y, H, R_POSITION).belief


def unscented_step(belief: Belief, y: Array) -> Belief:
    belief = unscented.predict(belief, moves, Q, WEIGHTS)
    return unscented.update(belief, y, radar, R_RADAR, WEIGHTS, ANGULAR).belief


def cubature_step(belief: Belief, y: Array) -> Belief:
    return cubature.update(cubature.predict(belief, moves, Q), y, radar, R_RADAR, ANGULAR).belief


# ---------------------------------------------------------------------------------------- filterpy


def test_kalman_and_its_smoother_are_filterpy_s_seed_11() -> None:
    seen = flight(11, position, R_POSITION)
    peer = linear_peer()
    belief, kept = START, []
    for y in seen:
        peer.predict()
        peer.update(y)
        belief = kalman_step(belief, y)
        agrees(belief, peer.x, peer.P)
        kept.append(belief)
    filtered = Belief(np.array([b.mean for b in kept]), np.array([b.covariance for b in kept]))
    smoothed = smoothing.rauch_tung_striebel(filtered, F, Q)
    means, covariances, *_ = peer.rts_smoother(*filtered)
    for k in range(STEPS):
        agrees(Belief(smoothed.mean[k], smoothed.covariance[k]), means[k], covariances[k], 1e-7)


def test_extended_is_filterpy_s_seed_12() -> None:
    seen = flight(12, radar, R_RADAR)
    peer = prepared(peers.ExtendedKalmanFilter(N, 3), Q, R_RADAR)
    peer.F, belief = F, START
    for y in seen:
        peer.predict()
        slope = radar_slope(peer.x[None])[0]
        peer.update(y, lambda _, slope=slope: slope, lambda x: radar(x[None])[0], residual=difference)
        belief = kalman.predict(belief, F, Q)
        belief = extended.update(belief, y, radar, R_RADAR, ANGULAR, jacobian=radar_slope).belief
        agrees(belief, peer.x, peer.P)


def test_each_half_step_of_the_cubature_filter_is_filterpy_s_seed_14() -> None:
    """Half by half: filterpy updates with the points it has predicted, without Q in them; ours are drawn anew."""
    seen, none = flight(14, radar, R_RADAR), np.zeros((N, N))
    hx = lambda x: radar(x[None])[0]  # noqa: E731
    predicts = peers.CubatureKalmanFilter(N, 3, DT, hx, lambda x, _: F @ x)
    updates = peers.CubatureKalmanFilter(N, 3, DT, hx, lambda x, _: x, residual_z=difference)
    predicts.Q, updates.Q, updates.R = Q, none, R_RADAR
    belief = START
    for y in seen:
        predicts.x, predicts.P = belief.mean[:, None], belief.covariance.copy()
        predicts.predict()
        belief = cubature.predict(belief, moves, Q)
        agrees(belief, predicts.x, predicts.P, ABOUT_ZERO)
        updates.x, updates.P = belief.mean[:, None], belief.covariance.copy()
        updates.predict()
        updates.update(y[:, None])
        belief = cubature.update(belief, y, radar, R_RADAR, ANGULAR).belief
        agrees(belief, updates.x, updates.P, INVERTED)


def test_interacting_multiple_model_is_filterpy_s_seed_15() -> None:
    """A mode that is quiet and one that manoeuvres."""
    seen = flight(15, position, R_POSITION)
    noises, transition = (0.01 * Q, 30.0 * Q), np.array([[0.97, 0.03], [0.10, 0.90]])
    peer = peers.IMMEstimator([linear_peer(noise) for noise in noises], [0.6, 0.4], transition)
    linear = methods()["kalman"]
    ours = (linear, linear)
    state = multiple_model.start(ours, *START, np.array([0.6, 0.4]))
    for y in seen:
        peer.predict()
        peer.update(y)
        state = multiple_model.predict(ours, state, (moves, moves), noises, transition)
        state = multiple_model.update(ours, state, y, (position, position), R_POSITION).belief
        np.testing.assert_allclose(state.probabilities, peer.mu, rtol=0, atol=EXACT)
        agrees(multiple_model.belief(ours, state), peer.x, peer.P)


# -------------------------------------------------------------------------------------- Stone Soup

CENTIMETRE = 1e-2


def soup(predictor: Any, updater: Any, sees: Any, seen: Array) -> Array:
    """Stone Soup's means (STEPS, 9); all states and times are new in every step."""
    time = datetime(2026, 1, 1)  # noqa: DTZ001 - simulated
    state = GaussianState(START.mean[:, None], START.covariance, timestamp=time)
    means = []
    for y in seen:
        time += timedelta(seconds=DT)
        prediction = predictor.predict(state, timestamp=time)
        detection = Detection(y[:, None], timestamp=time, measurement_model=sees)
        state = updater.update(SingleHypothesis(prediction, detection))
        means.append(np.asarray(state.state_vector, dtype=float)[:, 0])
    return np.array(means)


def transition() -> Any:
    return CombinedLinearGaussianTransitionModel([ConstantAcceleration(1.0) for _ in range(3)])


def within_a_centimetre(step: Callable[[Belief, Array], Belief], seen: Array, theirs: Array) -> None:
    """Positions of our filter, advanced by `step`, against means of theirs."""
    ours = np.array([belief.mean for belief in accumulate(seen, step, initial=START)][1:])
    np.testing.assert_allclose(ours[:, ::3], theirs[:, ::3], rtol=0, atol=CENTIMETRE)


def test_kalman_is_stone_soup_s_seed_16() -> None:
    seen = flight(16, position, R_POSITION)
    sees = LinearGaussian(N, (0, 3, 6), R_POSITION)
    theirs = soup(predictors.KalmanPredictor(transition()), updaters.KalmanUpdater(sees), sees, seen)
    within_a_centimetre(kalman_step, seen, theirs)


def test_unscented_is_stone_soup_s_seed_17() -> None:
    seen = flight(17, radar, R_RADAR)
    sees, rule = CartesianToElevationBearingRange(N, (0, 3, 6), R_RADAR), {"alpha": 1, "beta": 0, "kappa": 3 - N}
    theirs = soup(
        predictors.UnscentedKalmanPredictor(transition(), **rule),
        updaters.UnscentedKalmanUpdater(sees, **rule),
        sees,
        seen,
    )
    within_a_centimetre(unscented_step, seen, theirs)


class Floats(CartesianToElevationBearingRange):
    """Angles as plain numbers. Its own kind of angle wraps products too, which spoils the cubature updater's sums
    of squares (1.9.1); this flight keeps away from the seam."""

    def function(self, state: Any, noise: Any = False, **more: Any) -> Any:
        return super().function(state, noise, **more).astype(float)


def test_cubature_is_stone_soup_s_seed_18() -> None:
    seen = flight(18, radar, R_RADAR)
    sees = Floats(N, (0, 3, 6), R_RADAR)
    theirs = soup(
        predictors.CubatureKalmanPredictor(transition()), updaters.CubatureKalmanUpdater(sees), sees, seen
    )
    within_a_centimetre(cubature_step, seen, theirs)


# ------------------------------------------------------------- posterior linearisation, written out


def relinearised(prior: Belief, about: Belief, y: Array) -> Belief:
    """Garcia-Fernandez et al. 2015, eqs 5-10, with 2n cubature points and explicit inverses."""
    L = np.linalg.cholesky(about.covariance) * np.sqrt(N)
    points = about.mean + np.vstack([L.T, -L.T])
    images = radar(points)
    z_mean, x_offset = images.mean(axis=0), points - about.mean
    z_offset = images - z_mean
    Psi, Phi = x_offset.T @ z_offset / (2 * N), z_offset.T @ z_offset / (2 * N)
    A = Psi.T @ np.linalg.inv(about.covariance)
    Omega = Phi - A @ about.covariance @ A.T
    S = A @ prior.covariance @ A.T + Omega + R_RADAR
    K = prior.covariance @ A.T @ np.linalg.inv(S)
    mean = prior.mean + K @ difference(y, A @ (prior.mean - about.mean) + z_mean)
    return Belief(mean, prior.covariance - K @ S @ K.T)


def test_posterior_linearisation_is_the_papers_recursion_seed_19() -> None:
    seen = flight(19, radar, R_RADAR)
    ours = theirs = START
    for y in seen:
        ours = posterior_linearisation.predict(ours, moves, Q)
        ours = posterior_linearisation.update(ours, y, radar, R_RADAR, ANGULAR, iterations=4).belief
        prior = about = Belief(F @ theirs.mean, F @ theirs.covariance @ F.T + Q)
        for _ in range(4):
            about = relinearised(prior, about, y)
        theirs = about
        agrees(ours, theirs.mean, theirs.covariance, 1e-4)
        np.testing.assert_allclose(ours.mean[::3], theirs.mean[::3], rtol=0, atol=CENTIMETRE)
