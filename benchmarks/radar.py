"""The radar problem, as its user would write it for each library.

It has nine states, constant acceleration per axis [x, v, a, y, v, a, z, v, a], and range, azimuth and elevation
ten times a second. One step is a prediction and an update.
"""

from datetime import datetime, timedelta
from functools import partial
from typing import Any, Final

import numpy as np
from filterpy.kalman import JulierSigmaPoints, UnscentedKalmanFilter
from numba import njit

from onboard.arrays import Array
from onboard.filters import Belief, unscented
from onboard.filters.belief import Weights
from onboard.models import constant_acceleration
from onboard.models.radar import ANGULAR, measure

N, DT, STEPS = 9, 0.1, 200
AXIS = np.array([[1.0, DT, 0.5 * DT**2], [0.0, 1.0, DT], [0.0, 0.0, 1.0]])
TRANSITION = np.kron(np.eye(3), AXIS)
DENSITY = 1.0  # of the acceleration's random walk, (m/s^2)^2/s
Q_AXIS = DENSITY * np.array(
    [[DT**5 / 20, DT**4 / 8, DT**3 / 6], [DT**4 / 8, DT**3 / 3, DT**2 / 2], [DT**3 / 6, DT**2 / 2, DT]]
)
Q: Array = np.asarray(np.kron(np.eye(3), Q_AXIS), float)
R = np.diag([10.0, 2e-4, 2e-4]) ** 2
START = Belief(
    np.array([-6000.0, 110.0, -0.2, 4500.0, -60.0, 0.3, 1000.0, 8.0, -0.05]),
    np.diag(np.tile([300.0, 30.0, 3.0], 3) ** 2),
)
WEIGHTS: Final = unscented.julier_weights(N)  # n + kappa = 3, as the peers use
RULE: Final = unscented.rule(WEIGHTS, N, 3, ANGULAR)


def measurements(seed: int = 1, steps: int = STEPS) -> Array:
    """Simulate measurements (steps, 3) of a flight on the model."""
    rng, x, rows = np.random.default_rng(seed), START.mean, []
    for _ in range(steps):
        x = TRANSITION @ x
        rows.append(numpy_measure(x[None])[0] + rng.normal(0, np.sqrt(np.diag(R))))
    return np.array(rows)


# --------------------------------- ours: the library's models over rows, a user's own, compiled or NumPy's


def process(rows: Array) -> Array:
    """Return rows (k, 9) after DT."""
    return constant_acceleration.process(rows, DT)


@njit(error_model="numpy")
def own_process(rows):  # type: ignore[no-untyped-def]
    """Advance rows like `process`, as a user would write it."""
    after = np.empty_like(rows)
    for s in range(rows.shape[0]):
        for i in range(0, 9, 3):
            x, v, a = rows[s, i], rows[s, i + 1], rows[s, i + 2]
            after[s, i] = x + DT * v + 0.5 * DT * DT * a
            after[s, i + 1] = v + DT * a
            after[s, i + 2] = a
    return after


@njit(error_model="numpy")
def own_measure(rows):  # type: ignore[no-untyped-def]
    """Return range, azimuth and elevation (k, 3) of rows (k, 9), as a user would write it."""
    images = np.empty((rows.shape[0], 3))
    for s in range(rows.shape[0]):
        x, y, z = rows[s, 0], rows[s, 3], rows[s, 6]
        across2 = x * x + y * y
        images[s, 0] = np.sqrt(across2 + z * z)
        images[s, 1] = np.arctan2(x, y)
        images[s, 2] = np.arctan2(z, np.sqrt(across2))
    return images


def numpy_process(rows: Array) -> Array:
    """Advance rows like `process`, in NumPy."""
    return np.asarray(rows @ TRANSITION.T)


def numpy_measure(rows: Array) -> Array:
    """Measure rows like `measure`, in NumPy."""
    x, y, z = rows[:, 0], rows[:, 3], rows[:, 6]
    across = np.hypot(x, y)
    return np.column_stack([np.hypot(across, z), np.arctan2(x, y), np.arctan2(z, across)])


MEASURED: Final = measurements()


def ours(steps: int, process: Any = process, measure: Any = measure) -> Belief:
    """Run the unscented filter, a step at a time, with the library's models."""
    belief: Any = START
    for k in range(steps):
        belief = unscented.step(belief, process, Q, MEASURED[k % STEPS], measure, R, RULE)
    return Belief(belief.mean, belief.covariance)


def ours_in_two_calls(steps: int) -> Belief:
    """Run it by a prediction and an update, which also returns innovation and covariance."""
    belief: Belief = in_two_calls(unscented, START, MEASURED, WEIGHTS, steps)
    return belief


def in_two_calls(family: Any, state: Any, measured: Array, weights: Weights, steps: int) -> Any:
    """Return the state of a filter or a batch, by its module, after `steps` steps."""
    for k in range(steps):
        state = family.predict(state, process, Q, weights)
        state = family.update(state, measured[k % STEPS], measure, R, weights, ANGULAR).belief
    return state


def ours_own_model(steps: int) -> Belief:
    """Run it with a user's own compiled models."""
    return ours(steps, own_process, own_measure)


def ours_numpy(steps: int) -> Belief:
    """Run it with models in plain NumPy."""
    return ours(steps, numpy_process, numpy_measure)


def batch(count: int) -> Any:
    """Return a run that advances `count` filters in one call."""
    return partial(in_two_calls, unscented, *tile_start(count), WEIGHTS)


def tile_start(count: int) -> tuple[Belief, Array]:
    """Return the start and the measurements of `count` equal filters."""
    start = Belief(np.tile(START.mean, (count, 1)), np.tile(START.covariance, (count, 1, 1)))
    return start, np.ascontiguousarray(np.tile(MEASURED[:, None], (1, count, 1)))


# ------------------------------------------------------------------------------------------ the peers


def difference(a: Array, b: Array) -> Array:
    """Return the difference of measurements, as filterpy's documentation writes it."""
    y = a - b
    y[1:] = (y[1:] + np.pi) % (2 * np.pi) - np.pi
    return y


def filterpy(steps: int) -> Belief:
    """Run filterpy with models for one point at a time, in NumPy."""

    def fx(x: Array, _: float) -> Array:
        return np.asarray(TRANSITION @ x)

    def hx(x: Array) -> Array:
        across = np.hypot(x[0], x[3])
        return np.array([np.hypot(across, x[6]), np.arctan2(x[0], x[3]), np.arctan2(x[6], across)])

    return _filterpy(steps, fx, hx)


def filterpy_compiled(steps: int) -> Belief:
    """Run filterpy with our compiled models."""
    return _filterpy(steps, lambda x, _: process(x[None])[0], lambda x: measure(x[None])[0])


def _filterpy(steps: int, fx: Any, hx: Any) -> Belief:
    points = JulierSigmaPoints(N, kappa=3.0 - N)
    peer: Any = UnscentedKalmanFilter(N, 3, DT, hx, fx, points, residual_z=difference)
    peer.x, peer.P, peer.Q, peer.R = START.mean.copy(), START.covariance.copy(), Q, R
    for k in range(steps):
        peer.predict()
        peer.update(MEASURED[k % STEPS])
    return Belief(peer.x, peer.P)


def stonesoup(steps: int) -> Belief:
    """Run Stone Soup as in its tutorials.

    Every step predicts from the last posterior, with its own detection, so that its caches answer nothing.
    """
    from stonesoup.models.measurement.nonlinear import CartesianToElevationBearingRange  # noqa: PLC0415 - seconds
    from stonesoup.models.transition.linear import (  # noqa: PLC0415
        CombinedLinearGaussianTransitionModel,
        ConstantAcceleration,
    )
    from stonesoup.predictor.kalman import UnscentedKalmanPredictor  # noqa: PLC0415
    from stonesoup.types.detection import Detection  # noqa: PLC0415
    from stonesoup.types.hypothesis import SingleHypothesis  # noqa: PLC0415
    from stonesoup.types.state import GaussianState  # noqa: PLC0415
    from stonesoup.updater.kalman import UnscentedKalmanUpdater  # noqa: PLC0415

    numpy_process = CombinedLinearGaussianTransitionModel([ConstantAcceleration(DENSITY) for _ in range(3)])
    # elevation, bearing from its first axis, which is our north, and range
    sees = CartesianToElevationBearingRange(N, (3, 0, 6), R[::-1, ::-1])
    rule = {"alpha": 1.0, "beta": 0.0, "kappa": 3.0 - N}
    predictor, updater = UnscentedKalmanPredictor(numpy_process, **rule), UnscentedKalmanUpdater(sees, **rule)
    time = datetime(2026, 1, 1)  # noqa: DTZ001 - simulated
    state = GaussianState(START.mean[:, None], START.covariance, timestamp=time)
    for k in range(steps):
        time += timedelta(seconds=DT)
        detection = Detection(MEASURED[k % STEPS][::-1, None], timestamp=time, measurement_model=sees)
        prediction = predictor.predict(state, timestamp=time)
        state = updater.update(SingleHypothesis(prediction, detection))
    return Belief(np.asarray(state.state_vector, dtype=float)[:, 0], np.asarray(state.covar, dtype=float))


def agree() -> bool:
    """Whether all of them agree to a millimetre over a few seconds."""
    expected = ours(50)
    others = (ours_in_two_calls, ours_own_model, ours_numpy, filterpy, filterpy_compiled, stonesoup)
    return all(np.allclose(run(50).mean[::3], expected.mean[::3], rtol=0, atol=1e-3) for run in others)
