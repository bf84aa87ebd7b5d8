"""The launch-vehicle study's runs: the ascent as its radar sees it, and what the filters make of it."""

from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.filters import unscented
from onboard.filters.discretisation import wiener_acceleration
from onboard.models import constant_acceleration, radar
from onboard.studies.tracking.outcomes import POSITION, VELOCITY, Mask, Outcome, judge
from onboard.studies.tracking.textbook import EKF_PLAIN
from onboard.studies.tracking.trackers import EKF, UKF, sigma_point_tracker
from onboard.studies.tracking.tracking import Scene, Sight, Tracker, follow
from onboard.studies.tracking.trajectories import load
from simlink.sensors.tracking_radar import TrackingRadar, track

DT: Final = 0.1
DENSITY: Final = 1.0  # q, (m/s^3)^2/Hz, the reference's
LOST: Final = 2000.0  # m: ten times what three times the noise gives
START: Final = np.tile([100.0, 20.0, 3.0], 3)  # sigmas of P0, per axis
EVENTS: Final = (0, 0.5, 25, 49.5, 70, 74, 92, 102, 112, 112.5, 155, 260.5, 262, 263, 333)  # s, of the thrust
AROUND: Final = (0.5, 5.0)  # s before and after an event that the paper excepts
WINDOWS: Final = ((10, 112), (112, 262), (262, 500))  # s
# the paper scales its process noise around stage separations, and does not say by how much
STAGED: Final = 0.1  # q between events ...
STAGED_FACTOR: Final = 300.0  # ... and how much more it is until STAGED_FOR s after one
STAGED_FOR: Final = 2.0

ALPHA: Final = sigma_point_tracker(
    "ukf-scaled", "UKF, α = 10⁻³, β = 2", lambda n: unscented.scaled_weights(n, 1e-3, 2.0)
)
TRACKERS: Final = {tracker.name: tracker for tracker in (EKF, UKF, ALPHA, EKF_PLAIN)}


class Flown(NamedTuple):
    """The runs of several trackers on the same measurements.

    `gap` is the rms distance, m, between the first two trackers' positions in the last window; `within`, by
    tracker, how often a component of position or velocity lay within one sigma. Of the first run: what was
    seen (T, 3), and by tracker its standard deviations (T, 9).
    """

    outcomes: tuple[Outcome, ...]
    gap: float
    within: dict[str, float]
    seen: Array
    sigma: dict[str, Array]


def times() -> Array:
    """Of the measurements (T,), s."""
    return load("launch-vehicle").t[1:]


def calm(t: Array) -> Mask:
    """Where no event is near (T,)."""
    before, after = AROUND
    near = [(t >= event - before) & (t <= event + after) for event in EVENTS]
    return np.asarray(~np.any(near, axis=0))


def windows(t: Array) -> dict[str, Mask]:
    """The windows without events, by name."""
    quiet = calm(t)
    return {f"{a}-{b} s": quiet & (t >= a) & (t <= b) for a, b in WINDOWS}


def scene(seeds: range, factor: float, q: float, staged: bool = False) -> Scene:
    """The ascent seen by a radar with `factor` times the paper's noise, a run for each seed."""
    trajectory = load("launch-vehicle")
    truth, sensor = trajectory.states[1:], TrackingRadar().times(factor)
    seen, start = np.empty((len(truth), len(seeds), 3)), np.empty((len(seeds), 9))
    for run, seed in enumerate(seeds):
        rng = np.random.default_rng([seed, 41])
        start[run] = trajectory.states[0] + START * rng.standard_normal(9)
        seen[:, run] = track(sensor, truth[:, POSITION], rng)
    R, Q = np.diag(np.square(sensor)), wiener_acceleration(DT, q, by_axis=True).Q
    stirred = _stirred(trajectory.t[1:])

    def noise(k: int, _: Array) -> Array:
        return Q * STAGED_FACTOR if staged and stirred[k] else Q

    return Scene(
        truth=truth,
        start=start,
        covariance=np.diag(START**2),
        process=lambda rows: constant_acceleration.process(rows, DT),
        noise=noise,
        sights=lambda k: Sight(seen[k], R, radar.measure, radar.jacobian, radar.ANGULAR),
    )


def fly(seeds: range, factor: float, q: float, names: tuple[str, ...], staged: bool = False) -> Flown:
    """The trackers of these names on one set of measurements."""
    made, t = scene(seeds, factor, q, staged), times()
    parts = windows(t)
    last = parts[f"{WINDOWS[-1][0]}-{WINDOWS[-1][1]} s"]
    outcomes, within, sigma, positions = [], {}, {}, []
    for name in names:
        tracker: Tracker = TRACKERS[name]
        trace = follow(made, tracker)
        outcomes.append(judge(trace, made.truth, tracker, t, parts, LOST))
        columns = [*POSITION, *VELOCITY]
        error = (trace.mean - made.truth[:, None])[calm(t)][..., columns]
        known = np.isfinite(error)
        within[name] = float(np.mean((np.abs(error) < trace.sigma[calm(t)][..., columns])[known]))
        sigma[name] = trace.sigma[:, 0]
        positions.append(trace.mean[last][..., POSITION])
    gap = np.linalg.norm(positions[0] - positions[min(1, len(positions) - 1)], axis=-1)
    first = made.sights
    seen = np.array([sight.y[0] for k in range(len(t)) if (sight := first(k)) is not None])
    return Flown(tuple(outcomes), float(np.sqrt(np.mean(gap**2))), within, seen, sigma)


def bound(factor: float, q: float) -> dict[str, float]:
    """Posterior Cramer-Rao bound of the position, m, rms over each window: the least error of any filter that
    knows as much of the motion as process noise q says, with measurements linearised at the truth."""
    trajectory, t = load("launch-vehicle"), times()
    truth = trajectory.states[1:]
    F, Q = wiener_acceleration(DT, q, by_axis=True)
    R = np.diag(np.square(TrackingRadar().times(factor)))
    P, variance = np.diag(START**2), np.empty(len(truth))
    slopes = radar.jacobian(truth)
    for k, H in enumerate(slopes):
        P = F @ P @ F.T + Q
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        left = np.eye(9) - K @ H
        P = left @ P @ left.T + K @ R @ K.T
        variance[k] = P[POSITION, POSITION].sum()
    return {name: float(np.sqrt(variance[at].mean())) for name, at in windows(t).items()}


def _stirred(t: Array) -> Mask:
    return np.asarray(np.any([(t >= e - AROUND[0]) & (t <= e + STAGED_FOR) for e in EVENTS], axis=0))
