"""The runs of the launch-vehicle study: the ascent measured by a radar, and the filters' results."""

from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.filters import unscented
from onboard.filters.discretisation import wiener_acceleration
from onboard.models import constant_acceleration, radar
from simlink.sensors.tracking_radar import TrackingRadar, track
from studies.tracking.batch import Measurement, Scene, run_batch
from studies.tracking.bound import position_variances
from studies.tracking.outcomes import POSITION, VELOCITY, Mask, Outcome, judge
from studies.tracking.textbook import EKF_PLAIN
from studies.tracking.trackers import EKF, UKF, sigma_point_tracker
from studies.tracking.trajectories import load

DT: Final = 0.1
DENSITY: Final = 1.0  # q, (m/s^3)^2/Hz, the reference's
MIN_DIVERGED_ERROR_M: Final = 2000.0  # ten times the error with three times the noise
START: Final = np.tile([100.0, 20.0, 3.0], 3)  # sigmas of P0, per axis
EVENTS: Final = (0, 0.5, 25, 49.5, 70, 74, 92, 102, 112, 112.5, 155, 260.5, 262, 263, 333)  # s, of the thrust
AROUND: Final = (0.5, 5.0)  # s before and after an event, left out as in the paper
WINDOWS: Final = ((10, 112), (112, 262), (262, 500))  # s
NAMES: Final = tuple(f"{begin}-{end} s" for begin, end in WINDOWS)
# the paper scales its process noise around stage separations, and does not say by how much
STAGED_DENSITY: Final = 0.1  # q between events ...
STAGED_FACTOR: Final = 300.0  # ... and how much more it is until STAGED_FOR s after one
STAGED_TIME_S: Final = 2.0

ALPHA: Final = sigma_point_tracker(
    "ukf-scaled", "UKF, α = 10⁻³, β = 2", lambda n: unscented.scaled_weights(n, 1e-3, 2.0)
)
TRACKERS: Final = {tracker.name: tracker for tracker in (EKF, UKF, ALPHA, EKF_PLAIN)}


class Results(NamedTuple):
    """The runs of several trackers on the same measurements.

    `gap` is the RMS distance, m, between the first two trackers' positions in the last window; `within`, by
    tracker, how often the error of a component of position or velocity was within one sigma. Of the first run:
    the measurements (T, 3), and by tracker the standard deviations (T, 9).
    """

    outcomes: dict[str, Outcome]
    gap: float
    within: dict[str, float]
    measured: Array
    sigma: dict[str, Array]


def times() -> Array:
    """Times of the measurements (T,), s."""
    return load("launch-vehicle").t[1:]


def calm(t: Array) -> Mask:
    """The mask (T,) of times with no event near."""
    return ~_after_events(t, AROUND[1])


def windows(t: Array) -> dict[str, Mask]:
    """The windows without events, by name."""
    quiet = calm(t)
    return {name: quiet & (t >= a) & (t <= b) for name, (a, b) in zip(NAMES, WINDOWS, strict=True)}


def scene(seeds: range, factor: float, q: float, staged: bool = False) -> Scene:
    """Return the ascent measured by a radar with `factor` times the paper's noise, a run a seed.

    The process noise is q, (m/s^3)^2/Hz; `staged` adds more after events.
    """
    trajectory = load("launch-vehicle")
    truth, sensor = trajectory.states[1:], TrackingRadar().times(factor)
    measured, start = np.empty((len(truth), len(seeds), 3)), np.empty((len(seeds), 9))
    for run, seed in enumerate(seeds):
        rng = np.random.default_rng([seed, 41])
        start[run] = trajectory.states[0] + START * rng.standard_normal(9)
        measured[:, run] = track(sensor, truth[:, POSITION], rng)
    R, Q = np.diag(np.square(sensor)), wiener_acceleration(DT, q, by_axis=True).Q
    disturbed = _after_events(trajectory.t[1:], STAGED_TIME_S)

    def noise(k: int, _: Array) -> Array:
        return Q * STAGED_FACTOR if staged and disturbed[k] else Q

    return Scene(
        truth=truth,
        start=start,
        covariance=np.diag(START**2),
        process=lambda rows: constant_acceleration.process(rows, DT),
        noise=noise,
        measurements=lambda k: Measurement(measured[k], R, radar.measure, radar.jacobian, radar.ANGULAR),
    )


def fly(seeds: range, factor: float, q: float, names: tuple[str, ...], staged: bool = False) -> Results:
    """Run the trackers of these names on one set of measurements."""
    made, t = scene(seeds, factor, q, staged), times()
    parts, quiet = windows(t), calm(t)
    outcomes, within, sigma, positions = {}, {}, {}, []
    for name in names:
        trace = run_batch(made, TRACKERS[name])
        outcomes[name] = judge(trace, made.truth, TRACKERS[name], t, parts, MIN_DIVERGED_ERROR_M)
        columns = [*POSITION, *VELOCITY]
        error = (trace.mean - made.truth[:, None])[quiet][..., columns]
        known = np.isfinite(error)
        within[name] = float(np.mean((np.abs(error) < trace.sigma[quiet][..., columns])[known]))
        sigma[name] = trace.sigma[:, 0]
        positions.append(trace.mean[parts[NAMES[-1]]][..., POSITION])
    gap = np.linalg.norm(positions[0] - positions[min(1, len(positions) - 1)], axis=-1)
    measured = [m.y[0] for k in range(len(t)) if (m := made.measurements(k)) is not None]
    return Results(outcomes, float(np.sqrt(np.mean(gap**2))), within, np.array(measured), sigma)


def bound(factor: float, q: float) -> dict[str, float]:
    """Return the posterior Cramér-Rao bound of the position, m, RMS over each window.

    It is the least error of any filter that knows the motion except for process noise q.
    """
    trajectory, t = load("launch-vehicle"), times()
    F, Q = wiener_acceleration(DT, q, by_axis=True)
    R = np.diag(np.square(TrackingRadar().times(factor)))
    variances = position_variances(np.diag(START**2), F, Q, R, radar.jacobian(trajectory.states[1:]))
    return {name: float(np.sqrt(variances[at].mean())) for name, at in windows(t).items()}


def _after_events(t: Array, seconds: float) -> Mask:
    """Return the mask (T,) of times from just before an event to some seconds after it."""
    return np.asarray(np.any([(t >= e - AROUND[0]) & (t <= e + seconds) for e in EVENTS], axis=0))
