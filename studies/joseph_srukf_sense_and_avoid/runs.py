"""The runs of the sense-and-avoid study: the trackers of each scene, and their results."""

import time
from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.filters import cubature, square_root, unscented
from onboard.filters.belief import Rows, Update
from onboard.filters.discretisation import rk4, wiener_acceleration
from onboard.filters.square_root import SquareRoot
from onboard.models import radar
from studies.joseph_srukf_sense_and_avoid import scenes
from studies.tracking.batch import Scene, Tracker, run_batch
from studies.tracking.bound import position_variances
from studies.tracking.outcomes import (
    ACCELERATION,
    POSITION,
    VELOCITY,
    Mask,
    Outcome,
    judge,
    outcomes_of,
)
from studies.tracking.textbook import EKF_PLAIN, EKF_PLAIN_NONLINEAR, SRUKF_TEXTBOOK
from studies.tracking.trackers import EKF, ITERATED, SRUKF, SRUKF_CLASSICAL, SRUKF_JOSEPH, UKF

JOSEPH: Final = SRUKF_JOSEPH.name
SYMMETRIC: Final = ("ekf", "ukf", "srukf", JOSEPH)
MIN_DIVERGED_ERROR_M: Final = 500.0
SHARP_STEPS: Final = 60
SETTLING_TIME_S: Final = 20.0  # of the validation: it does not count


class Results(NamedTuple):
    """Outcomes by tracker, with the errors of the raw measurements."""

    outcomes: dict[str, Outcome]  # by tracker
    raw: dict[str, float]  # m, RMS position error of the measurements, by window
    raw_axes: Array  # (T, 3), the same over runs by axis; NaN without a measurement
    gap: float  # m, the largest difference between positions of the unscented filter and of its square-root form
    extra: dict[str, float]


class AllResults(NamedTuple):
    """The results of all runs, in the order of the study's parts."""

    gnss: Results
    validation: Results
    radar: Results
    uncorrected: Results
    rain: Results
    sharp: Results
    extreme: Results
    acquisition: Results
    literal: Outcome
    alpha: Outcome
    durations: dict[str, float]


def fly_validation(seeds: range) -> Results:
    """Section 4.3."""
    made, t = scenes.validation(seeds), scenes.validation_times()
    windows = {"settled": t > SETTLING_TIME_S}
    trackers = (EKF_PLAIN, EKF, UKF, SRUKF, SRUKF_JOSEPH, SRUKF_CLASSICAL)
    traces = {tracker.name: run_batch(made, tracker, condition=True) for tracker in trackers}
    found = {x.name: judge(traces[x.name], made.truth, x, t, windows, MIN_DIVERGED_ERROR_M) for x in trackers}
    gap = np.abs(traces["ukf"].mean - traces["srukf"].mean)[..., POSITION]
    extra = {f"bound_{name}": bound(q, windows["settled"]) for name, q in (("model", None), ("still", 0.0))}
    return _results(found, measurement_errors(made), windows, float(np.nanmax(gap)), extra)


def fly_sharp(seeds: range, sigma: Array) -> Results:
    """The validation with sharper measurements: which filters fail."""
    made = scenes.validation(seeds, sigma, SHARP_STEPS)
    t = scenes.validation_times(SHARP_STEPS)
    trackers = (EKF_PLAIN, EKF, UKF, SRUKF_TEXTBOOK, SRUKF_CLASSICAL, SRUKF, SRUKF_JOSEPH, *NEGATIVE)
    return _results(outcomes_of(made, trackers, t, {"all": t > 0}, MIN_DIVERGED_ERROR_M))


def fly_radar(seeds: range, rain_mm_h: float = 0.0, only: str = "") -> Results:
    """Section 5.1.3: jammed for 15 s, without signal for 10 s.

    `only`: one tracker instead of all.
    """
    made, (t, _) = scenes.by_radar(seeds, rain_mm_h), scenes.intruder()
    looks, windows = scenes.looks(seeds[:1], rain_mm_h)[0], scenes.radar_windows(t)
    extra = {"snr_first_db": float(looks.snr_db[0]), "snr_jammed_db": float(np.min(looks.snr_db[looks.detected]))}
    return _results(_every(made, t, windows, only), measurement_errors(made), windows, extra=extra)


def fly_gnss(seeds: range, corrected: bool, only: str = "") -> Results:
    """Section 5.2.3: the clock degraded for 15 s, no satellites for 12 s.

    `only`: one tracker instead of all.
    """
    made, (t, _) = scenes.by_gnss(seeds, corrected), scenes.intruder()
    windows = scenes.gnss_windows(t)
    raw = scenes.snapshots(seeds, corrected) - made.truth[..., POSITION]
    satellites = [len(f.slots) for f in scenes.receptions(seeds[:1])[0].fixes if f is not None]
    extra = {"satellites_least": float(min(satellites)), "satellites_most": float(max(satellites))}
    return _results(_every(made, t, windows, only), raw, windows, extra=extra)


def fly_acquisition(seeds: range) -> Results:
    """A sharp radar and a wide prior, over which the measurement is strongly curved."""
    made = scenes.acquisition(seeds)
    t: Array = np.asarray(scenes.DT * np.arange(1, len(made.truth) + 1), float)
    windows = {"first": t < 1.5 * scenes.DT, "all": t > 0}
    return _results(outcomes_of(made, (EKF, UKF, SRUKF_JOSEPH, SRUKF, ITERATED), t, windows, MIN_DIVERGED_ERROR_M))


def fly_literal(seeds: range) -> Outcome:
    """The validation with eqs 21 and 22 as printed."""
    made, t = scenes.validation(seeds), scenes.validation_times()
    return outcomes_of(made, (LITERAL,), t, {"settled": t > SETTLING_TIME_S}, MIN_DIVERGED_ERROR_M)[LITERAL.name]


def fly_printed_alpha(seeds: range) -> Outcome:
    """The radar case with alpha = -v.a / |a|^2."""
    made, (t, _) = scenes.by_radar(seeds), scenes.intruder()
    with np.errstate(all="ignore"):  # it overflows
        printed = made._replace(process=lambda rows: rk4(_printed_turn, rows, scenes.DT))
        return outcomes_of(printed, (UKF,), t, scenes.radar_windows(t), MIN_DIVERGED_ERROR_M)[UKF.name]


def durations(runs: int = 100, steps: int = 20, repeats: int = 12) -> dict[str, float]:
    """Microseconds of a predict and update by tracker, many runs in one call.

    The trackers take turns, and the least of some turns counts, in time of this process: another study may run
    beside this one.
    """
    made = scenes.validation(range(runs), steps=steps)
    trackers = (EKF, UKF, SRUKF_CLASSICAL, SRUKF, SRUKF_JOSEPH)
    found = {tracker.name: np.inf for tracker in trackers}
    for _ in range(repeats):
        for tracker in trackers:
            state = tracker.start(made.start, np.broadcast_to(made.covariance, (runs, 9, 9)).copy())
            begun = time.process_time()
            for k in range(steps):
                state = tracker.predict(state, made.process, np.asarray(made.noise))
                measurement = made.measurements(k)
                state = state if measurement is None else tracker.update(state, measurement).belief
            taken = 1e6 * (time.process_time() - begun) / (steps * runs)
            found[tracker.name] = min(found[tracker.name], taken)
    return found


def bound(q: float | None, settled: Mask) -> float:
    """Return the posterior Cramér-Rao bound of the validation's position, m, RMS over settled steps.

    q None is a target with the filter's process noise; 0 is one without, like the true one.
    """
    made = scenes.validation(range(1))
    F, Q = wiener_acceleration(scenes.VALIDATION_DT, scenes.VALIDATION_DENSITY if q is None else q, by_axis=True)
    R = np.diag(scenes.VALIDATION_SIGMA**2)
    variances = position_variances(made.covariance, F, Q, R, radar.jacobian(made.truth))
    return float(np.sqrt(np.mean(variances[settled])))


def measurement_errors(made: Scene) -> Array:
    """Errors (T, B, 3), m, of radar measurements as positions; NaN without a measurement."""
    truth = made.truth[:, POSITION]
    errors = np.full((len(truth), len(made.start), 3), np.nan)
    for k in range(len(truth)):
        measurement = made.measurements(k)
        if measurement is not None:
            errors[k] = radar.cartesian(measurement.y) - truth[k]
    return errors


def _every(made: Scene, t: Array, windows: Mapping[str, Mask], only: str) -> dict[str, Outcome]:
    """All trackers that compete, or one of them."""
    trackers = (EKF_PLAIN_NONLINEAR, EKF, UKF, SRUKF, SRUKF_JOSEPH)
    return outcomes_of(
        made, (x for x in trackers if only in x.name), t, windows, MIN_DIVERGED_ERROR_M, condition=not only
    )


def _results(
    outcomes: dict[str, Outcome],
    errors: Array | None = None,
    windows: Mapping[str, Mask] | None = None,
    gap: float = float("nan"),
    extra: dict[str, float] | None = None,
) -> Results:
    """With the measurements' position errors (T, B, 3), m, where there are any."""
    if errors is None:
        return Results(outcomes, {}, np.empty((0, 3)), gap, {})
    squares = np.sum(errors**2, axis=-1)
    raw = {name: squares[at][np.isfinite(squares[at])] for name, at in (windows or {}).items()}
    rms = {name: float(np.sqrt(known.mean())) if known.size else np.nan for name, known in raw.items()}
    return Results(outcomes, rms, np.asarray(np.sqrt(np.mean(errors**2, axis=1))), gap, extra or {})


def _printed_turn(rows: Array) -> Array:
    v, a = rows[:, VELOCITY], rows[:, ACCELERATION]
    alpha = -np.sum(v * a, axis=1) / np.sum(a * a, axis=1)
    omega = np.linalg.norm(np.cross(v, a), axis=1) / np.sum(v * v, axis=1)
    slope = np.empty_like(rows)
    slope[:, POSITION], slope[:, VELOCITY] = v, a
    slope[:, ACCELERATION] = -2 * alpha[:, None] * a - (2 * alpha**2 + omega**2)[:, None] * v
    return slope


def _literal_predict(state: SquareRoot, process: Rows, Q: Array) -> SquareRoot:
    """Eqs 20-22 as printed: with deviations of X(n-1|n-1) from the predicted mean."""
    points = unscented.sigma_points(square_root.belief(state), cubature.weights(9))
    moved = np.stack([process(rows) for rows in points])
    mean = moved[:, 1:].mean(axis=1)
    d = points[:, 1:] - mean[:, None]
    return square_root.start(mean, cubature.weights(9).other * np.swapaxes(d, 1, 2) @ d + Q)


LITERAL: Final = SRUKF._replace(name="srukf-literal", label="eqs 21, 22 as printed", predict=_literal_predict)


def _negative(update: Callable[..., Update], name: str, label: str) -> Tracker:
    """A square-root filter with n + kappa = 3, whose centre weight is negative."""
    rule = unscented.julier_weights(9)
    return SRUKF._replace(
        name=name,
        label=label,
        predict=lambda state, process, Q: square_root.predict(state, process, Q, rule),
        update=lambda state, s: update(state, s.y, s.measure, s.R, rule, s.angular),
    )


NEGATIVE: Final = (
    _negative(square_root.update_classical, "negative-classical", "n + κ = 3, downdates"),
    _negative(square_root.update_joseph, "negative-joseph", "n + κ = 3, Joseph form of the paper"),
)
