"""The runs of the sense-and-avoid study: which trackers fly which scene, and what comes of it."""

import time
from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.filters import square_root, unscented
from onboard.filters.belief import Rows, Update
from onboard.filters.discretisation import rk4, wiener_acceleration
from onboard.filters.square_root import SquareRoot
from onboard.models import radar
from onboard.studies.joseph_srukf_sense_and_avoid import scenes
from onboard.studies.tracking.outcomes import ACCELERATION, POSITION, VELOCITY, Mask, Outcome, judge, outcome
from onboard.studies.tracking.textbook import EKF_PLAIN, EKF_PLAIN_BENT, SRUKF_TEXTBOOK
from onboard.studies.tracking.trackers import EKF, ITERATED, SRUKF, SRUKF_CLASSICAL, SRUKF_JOSEPH, UKF, centred
from onboard.studies.tracking.tracking import Scene, Tracker, follow

LOST: Final = 500.0  # m: a run that ends further off has diverged
SHARP_STEPS: Final = 60
SETTLED: Final = 20.0  # s of the validation that do not count


class Flown(NamedTuple):
    """Outcomes by tracker; `raw`, by window, the rms error in m of what is measured, made a position; `raw_axes`
    (T, 3), that over runs by axis, NaN where nothing was seen; `gap`, the largest difference, m, between positions
    of the unscented filter and of its square-root form; `extra`, single numbers."""

    outcomes: dict[str, Outcome]
    raw: dict[str, float]
    raw_axes: Array
    gap: float
    extra: dict[str, float]


def fly_validation(seeds: range) -> Flown:
    """Section 4.3."""
    made, t = scenes.validation(seeds), scenes.validation_times()
    windows = {"settled": t > SETTLED}
    trackers = (EKF_PLAIN, EKF, UKF, SRUKF, SRUKF_JOSEPH, SRUKF_CLASSICAL)
    traces = {tracker.name: follow(made, tracker, condition=True) for tracker in trackers}
    found = {x.name: judge(traces[x.name], made.truth, x, t, windows, LOST) for x in trackers}
    gap = np.abs(traces["ukf"].mean - traces["srukf"].mean)[..., POSITION]
    raw = _measured(made)
    extra = {f"bound_{name}": bound(q, windows["settled"]) for name, q in (("model", None), ("still", 0.0))}
    return Flown(found, _raw(raw, windows), _axes(raw), float(np.nanmax(gap)), extra)


def fly_sharp(seeds: range, single: bool) -> Flown:
    """The validation with 1 cm and 10 urad, in single or double precision: who survives."""
    made = scenes.validation(seeds, scenes.SHARP_SIGMA, SHARP_STEPS, np.float32 if single else np.float64)
    t = scenes.validation_times(SHARP_STEPS)
    trackers = (EKF_PLAIN, EKF, UKF, SRUKF_TEXTBOOK, SRUKF_CLASSICAL, SRUKF, SRUKF_JOSEPH, *NEGATIVE)
    found = {x.name: outcome(made, x, t, {"all": t > 0}, LOST) for x in trackers}
    return Flown(found, {}, np.empty((0, 3)), np.nan, {})


def fly_radar(seeds: range, rain_mm_h: float = 0.0, only: str = "") -> Flown:
    """Section 5.1.3: jammed for 15 s, without signal for 10 s."""
    made, (t, _) = scenes.by_radar(seeds, rain_mm_h), scenes.intruder()
    windows = scenes.radar_windows(t)
    found = _every(made, t, windows, only)
    looks = scenes.looks(seeds[:1], rain_mm_h)[0]
    raw = _measured(made)
    extra = {"snr_first_db": float(looks.snr_db[0]), "snr_jammed_db": float(np.min(looks.snr_db[looks.detected]))}
    return Flown(found, _raw(raw, windows), _axes(raw), np.nan, extra)


def fly_gnss(seeds: range, corrected: bool = True, only: str = "") -> Flown:
    """Section 5.2.3: the clock degraded for 15 s, no satellites for 12 s."""
    made, (t, _) = scenes.by_gnss(seeds, corrected), scenes.intruder()
    windows = scenes.gnss_windows(t)
    raw = scenes.snapshots(seeds, corrected) - made.truth[..., POSITION]
    satellites = [len(f.slots) for f in scenes.receptions(seeds[:1])[0].fixes if f is not None]
    extra = {"satellites_least": float(min(satellites)), "satellites_most": float(max(satellites))}
    return Flown(_every(made, t, windows, only), _raw(raw, windows), _axes(raw), np.nan, extra)


def fly_acquisition(seeds: range) -> Flown:
    """A sharp radar and a wide prior: the measurement bends over it."""
    made = scenes.acquisition(seeds)
    t: Array = np.asarray(scenes.DT * np.arange(1, len(made.truth) + 1), float)
    windows = {"first": t < 1.5 * scenes.DT, "all": t > 0}
    found = {x.name: outcome(made, x, t, windows, LOST) for x in (EKF, UKF, SRUKF_JOSEPH, SRUKF, ITERATED)}
    return Flown(found, {}, np.empty((0, 3)), np.nan, {})


def fly_literal(seeds: range) -> Outcome:
    """The validation with eqs 21 and 22 as printed."""
    made, t = scenes.validation(seeds), scenes.validation_times()
    return outcome(made, LITERAL, t, {"settled": t > SETTLED}, LOST)


def fly_printed_alpha(seeds: range) -> Outcome:
    """The radar case with alpha = -v.a / |a|^2."""
    made, (t, _) = scenes.by_radar(seeds), scenes.intruder()
    with np.errstate(all="ignore"):  # it overflows
        bent = made._replace(process=lambda rows: rk4(_printed_turn, rows, scenes.DT))
        return outcome(bent, UKF, t, scenes.radar_windows(t), LOST)


def durations(runs: int = 100, steps: int = 20, repeats: int = 12) -> dict[str, float]:
    """Microseconds of a predict and update by tracker, many runs in one call. The trackers take turns, and of some
    turns the least counts, by what the processor did for us: another study may be flying beside this one."""
    made = scenes.validation(range(runs), steps=steps)
    found = {x.name: np.inf for x in (EKF, UKF, SRUKF_CLASSICAL, SRUKF, SRUKF_JOSEPH)}
    for _ in range(repeats):
        for tracker in (EKF, UKF, SRUKF_CLASSICAL, SRUKF, SRUKF_JOSEPH):
            state = tracker.start(made.start, np.broadcast_to(made.covariance, (runs, 9, 9)).copy())
            begun = time.process_time()
            for k in range(steps):
                state = tracker.predict(state, made.process, np.asarray(made.noise))
                sight = made.sights(k)
                state = state if sight is None else tracker.update(state, sight).belief
            taken = 1e6 * (time.process_time() - begun) / (steps * runs)
            found[tracker.name] = min(found[tracker.name], taken)
    return found


def bound(q: float | None, settled: Mask) -> float:
    """Posterior Cramer-Rao bound of the validation's position, m, rms over settled steps. q None: of a target with
    the filter's process noise; 0: of one that has none, as the truth."""
    made = scenes.validation(range(1))
    F, Q = wiener_acceleration(scenes.VALIDATION_DT, scenes.VALIDATION_DENSITY if q is None else q, by_axis=True)
    P, R, variance = made.covariance, np.diag(scenes.VALIDATION_SIGMA**2), []
    for H in radar.jacobian(made.truth):
        P = F @ P @ F.T + Q
        P = np.linalg.inv(np.linalg.inv(P) + H.T @ np.linalg.inv(R) @ H)
        variance.append(P[POSITION, POSITION].sum())
    return float(np.sqrt(np.mean(np.array(variance)[settled])))


def _every(made: Scene, t: Array, windows: Mapping[str, Mask], only: str) -> dict[str, Outcome]:
    """All trackers that compete, or one of them."""
    trackers = (EKF_PLAIN_BENT, EKF, UKF, SRUKF, SRUKF_JOSEPH)
    return {x.name: outcome(made, x, t, windows, LOST, condition=not only) for x in trackers if only in x.name}


def _measured(made: Scene) -> Array:
    """Errors (T, B, 3), m, of radar measurements made positions; NaN where nothing was seen."""
    truth, runs = made.truth[:, POSITION], len(made.start)
    found = np.full((len(truth), runs, 3), np.nan)
    for k in range(len(truth)):
        sight = made.sights(k)
        if sight is not None:
            found[k] = radar.cartesian(sight.y) - truth[k]
    return found


def _raw(error: Array, windows: Mapping[str, Mask]) -> dict[str, float]:
    square = np.sum(error**2, axis=-1)
    found = {}
    for name, at in windows.items():
        known = square[at][np.isfinite(square[at])]
        found[name] = float(np.sqrt(known.mean())) if known.size else np.nan
    return found


def _axes(error: Array) -> Array:
    return np.asarray(np.sqrt(np.mean(error**2, axis=1)))


def _printed_turn(rows: Array) -> Array:
    v, a = rows[:, VELOCITY], rows[:, ACCELERATION]
    alpha = -np.sum(v * a, axis=1) / np.sum(a * a, axis=1)
    omega = np.linalg.norm(np.cross(v, a), axis=1) / np.sum(v * v, axis=1)
    slope = np.empty_like(rows)
    slope[:, POSITION], slope[:, VELOCITY] = v, a
    slope[:, ACCELERATION] = -2 * alpha[:, None] * a - (2 * alpha**2 + omega**2)[:, None] * v
    return slope


def _literal_predict(state: SquareRoot, process: Rows, Q: Array) -> SquareRoot:
    """Eqs 20-22 with deviations of X(n-1|n-1) from the predicted mean."""
    points = unscented.sigma_points(square_root.belief(state), centred(9))
    moved = np.stack([process(rows) for rows in points])
    mean = moved[:, 1:].mean(axis=1)
    d = points[:, 1:] - mean[:, None]
    return square_root.start(mean, centred(9).other * np.swapaxes(d, 1, 2) @ d + Q)


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
