"""Tables of the sense-and-avoid study."""

import numpy as np

from onboard.filters.gating import mean_bounds
from studies.joseph_srukf_sense_and_avoid.runs import JOSEPH, AllResults, Results
from studies.report.findings import Cell, Table
from studies.tracking.outcomes import Outcome, WindowErrors

ERRORS = ("position m", "velocity m/s", "acceleration m/s²")
RMS = (
    "Root mean squares of the lengths of error vectors, ± their standard error by the scatter over runs. Where "
    "runs failed, errors are of the others, which are the easier ones: they do not compare. "
    "NEES of {n} states: {n} "
    "when consistent (95 % of means, were each of {runs} runs one sample: {low:.1f} to {high:.1f}), NIS: {m}; in "
    "95 %: how often NEES kept its 95 % bound."
)


def tables_of(m: AllResults) -> tuple[Table, ...]:
    """All of them."""
    return (
        _validation(m),
        _sharp(m),
        _by_window("Radar", m.radar, 9, 3, _radar_note(m)),
        _by_window("GNSS", m.gnss, 11, _rows_of_a_fix(m), _gnss_note(m)),
        _acquisition(m),
        _durations(m),
    )


def _rms(o: Outcome, n: int, m: int) -> str:
    low, high = mean_bounds(n, o.runs)
    return RMS.format(n=n, m=m, runs=o.runs, low=low, high=high)


def _validation(m: AllResults) -> Table:
    extra = m.validation.extra
    return Table(
        title="Validation",
        note=_rms(m.validation.outcomes["ukf"], 9, 3)
        + f" After 20 s. The measurements are off by {m.validation.raw['settled']:.0f} m. Cramér–Rao bound of "
        f"the position: {extra['bound_model']:.1f} m for a target with the filter's process noise, "
        f"{extra['bound_still']:.1f} m for one without, as this; the filter must be between. κ: condition "
        "number, median over time and runs, of P, of its root S for square-root filters.",
        header=("filter", ERRORS[0], "±", *ERRORS[1:], "NEES", "±", "NIS", "in 95 %", "κ", "failed"),
        rows=tuple(
            (
                o.label,
                *(o.shown(w.position), w.standard_error("position"), o.shown(w.velocity), o.shown(w.acceleration)),
                *(o.shown(w.nees), w.standard_error("nees"), o.shown(w.nis), o.shown(w.inside)),
                *(float(np.nanmedian(o.condition)), o.failures),
            )
            for o in m.validation.outcomes.values()
            for w in (o.windows["settled"],)
        ),
    )


def _sharp(m: AllResults) -> Table:
    sharp, extreme = m.sharp.outcomes, m.extreme.outcomes
    return Table(
        title="Ill-conditioned cases from a prior of 300 m: 1 cm and 10 µrad, and a millionth of both",
        note="Runs of 30 s that end without a positive covariance; NEES with 1 cm.",
        header=("filter", "failed, 10 nm", "failed, 1 cm", "NEES", "in 95 %"),
        rows=tuple(
            (
                o.label,
                f"{extreme[name].failed} of {o.runs}",
                f"{o.failed} of {o.runs}",
                o.shown(o.windows["all"].nees),
                o.shown(o.windows["all"].inside),
            )
            for name, o in sharp.items()
        ),
    )


def _by_window(title: str, results: Results, n: int, components: int, note: str) -> Table:
    rows: list[tuple[Cell, ...]] = [
        (
            o.label,
            *(x for name in results.raw for x in _position(o, name)),
            *(o.shown(x) for x in (w.acceleration, w.nees, w.nis, w.inside)),
            o.failures,
            o.diverged,
        )
        for o in results.outcomes.values()
        for w in (o.windows["nominal"],)
    ]
    measured: list[Cell] = [x for value in results.raw.values() for x in (value, None)]
    raw: tuple[Cell, ...] = ("measured", *measured, None, None, None, None, "", None)
    return Table(
        title=title,
        note=_rms(results.outcomes["ukf"], n, components) + " " + note,
        header=(
            "filter",
            *(x for name in results.raw for x in (f"position m, {name}", "±")),
            *(f"{name}, nominal" for name in ("acceleration m/s²", "NEES", "NIS", "in 95 %")),
            "failed",
            "diverged",
        ),
        rows=(*rows, raw),
    )


def _position(o: Outcome, window: str) -> tuple[Cell, Cell]:
    errors = o.windows[window]
    return o.shown(errors.position), errors.standard_error("position")


def _first_and_all(o: Outcome) -> tuple[WindowErrors, WindowErrors]:
    return o.windows["first"], o.windows["all"]


def _radar_note(m: AllResults) -> str:
    rain, ours = (results.outcomes[JOSEPH].windows for results in (m.rain, m.radar))
    return (
        "Nominal: 10-70 s, before the faults. The signal-to-noise ratio falls from "
        f"{m.radar.extra['snr_first_db']:.0f} dB at the start to {m.radar.extra['snr_jammed_db']:.1f} dB when "
        f"jammed. With 50 mm/h of rain: {rain['nominal'].position:.2f} m nominal, {rain['jammed'].position:.1f} "
        f"m jammed ({ours['jammed'].position:.1f} m without)."
    )


def _gnss_note(m: AllResults) -> str:
    left = m.uncorrected.outcomes[JOSEPH].windows["nominal"].position
    return (
        "Nominal: 10-60 s. Measured: the least-squares position of each fix alone. The receiver "
        f"removes the mean troposphere; otherwise the nominal error would be {left:.1f} m. R and "
        "Q do not change with the degraded clock."
    )


def _rows_of_a_fix(m: AllResults) -> int:
    """Pseudoranges and rates in a fix."""
    return 2 * round(m.gnss.extra["satellites_most"])


def _acquisition(m: AllResults) -> Table:
    return Table(
        title="Acquisition from 20 km: 1 m and 0.2 mrad from a prior of 1 km",
        note="After the first measurement, and over all measurements of the first 5 s.",
        header=("filter", "position m, first", "NEES, first", "in 95 %, first", "position m", "NEES", "in 95 %"),
        rows=tuple(
            (
                o.label,
                *(o.shown(x) for w in _first_and_all(o) for x in (w.position, w.nees, w.inside)),
            )
            for o in m.acquisition.outcomes.values()
        ),
    )


def _durations(m: AllResults) -> Table:
    least = m.durations["srukf"]
    labels = {name: o.label for name, o in m.validation.outcomes.items()}
    return Table(
        title="Time of a step",
        note="Predict and update of the validation, 100 runs in one call, on this computer; only ratios matter.",
        header=("filter", "µs", "square-root UKF by triangularisation = 1"),
        rows=tuple((labels[name], micro, micro / least) for name, micro in m.durations.items()),
    )
