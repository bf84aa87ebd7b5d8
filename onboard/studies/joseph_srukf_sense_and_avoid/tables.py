"""Tables of the sense-and-avoid study."""

import numpy as np

from onboard.filters.gating import mean_bounds
from onboard.studies.joseph_srukf_sense_and_avoid.claims import Measured
from onboard.studies.joseph_srukf_sense_and_avoid.runs import Flown
from onboard.studies.report.findings import Cell, Table
from onboard.studies.tracking.outcomes import Outcome

RMS = (
    "Root mean squares of the lengths of error vectors over the runs that did not fail. NEES of {n} states: {n} "
    "when consistent (95 % of means, were each of {runs} runs one sample: {low:.1f} to {high:.1f}), NIS: {m}; in "
    "95 %: how often NEES kept its 95 % bound."
)


def tables_of(m: Measured) -> tuple[Table, ...]:
    """All of them."""
    return (
        _validation(m),
        _sharp(m),
        _by_window("Radar", m.radar, 9, 3, ("nominal", "jammed", "lost", "after"), _radar_note(m)),
        _by_window(
            "GNSS", m.gnss, 11, _seen(m), ("nominal", "degraded", "between", "lost", "after"), _gnss_note(m)
        ),
        _acquisition(m),
        _durations(m),
    )


def _rms(o: Outcome, n: int, m: int) -> str:
    low, high = mean_bounds(n, o.runs)
    return RMS.format(n=n, m=m, runs=o.runs, low=low, high=high)


def failures(o: Outcome) -> str:
    """How many runs failed, and when."""
    return f"{o.failed} of {o.runs}" + (f", median {o.failed_at:.0f} s" if o.failed else "")


def _validation(m: Measured) -> Table:
    rows: list[tuple[Cell, ...]] = []
    for o in m.validation.outcomes.values():
        w = o.windows["settled"]
        condition = float(np.nanmedian(o.condition))
        rows.append(
            (o.label, w.position, w.velocity, w.acceleration, w.nees, w.nis, w.inside, condition, failures(o))
        )
    extra = m.validation.extra
    return Table(
        title="Validation",
        note=_rms(m.validation.outcomes["ukf"], 9, 3)
        + f" After 20 s. What is measured is off by {m.validation.raw['settled']:.0f} m. Cramér–Rao bound of "
        f"the position: {extra['bound_model']:.1f} m for a target with the filter's process noise, "
        f"{extra['bound_still']:.1f} m for one without, as this; the filter must be between. κ: condition "
        "number, median over time and runs, of P, of its root S for square-root filters.",
        header=(
            "filter",
            "position m",
            "velocity m/s",
            "acceleration m/s²",
            "NEES",
            "NIS",
            "in 95 %",
            "κ",
            "failed",
        ),
        rows=tuple(rows),
    )


def _sharp(m: Measured) -> Table:
    single, double = m.sharp_single.outcomes, m.sharp_double.outcomes
    return Table(
        title="An ill-conditioned case: 1 cm and 10 µrad from a prior of 300 m",
        note="Runs of 30 s that end without a positive covariance, in single and in double precision; NEES in "
        "double.",
        header=("filter", "failed, float32", "failed, float64", "NEES", "in 95 %"),
        rows=tuple(
            (
                o.label,
                f"{single[name].failed} of {o.runs}",
                f"{o.failed} of {o.runs}",
                o.windows["all"].nees,
                o.windows["all"].inside,
            )
            for name, o in double.items()
        ),
    )


def _by_window(title: str, flown: Flown, n: int, seen: int, windows: tuple[str, ...], note: str) -> Table:
    rows: list[tuple[Cell, ...]] = [
        (
            o.label,
            *(o.windows[name].position for name in windows),
            o.windows["nominal"].acceleration,
            o.windows["nominal"].nees,
            o.windows["nominal"].nis,
            o.windows["nominal"].inside,
            failures(o),
            o.diverged,
        )
        for o in flown.outcomes.values()
    ]
    raw: tuple[Cell, ...] = ("measured", *(flown.raw[name] for name in windows), None, None, None, None, "", None)
    return Table(
        title=title,
        note=_rms(flown.outcomes["ukf"], n, seen) + " " + note,
        header=(
            "filter",
            *(f"position m, {name}" for name in windows),
            "acceleration m/s², nominal",
            "NEES, nominal",
            "NIS, nominal",
            "in 95 %, nominal",
            "failed",
            "diverged",
        ),
        rows=(*rows, raw),
    )


def _radar_note(m: Measured) -> str:
    rain, ours = (flown.outcomes["srukf-joseph"].windows for flown in (m.rain, m.radar))
    return (
        "Nominal: 10-70 s, before the faults. The signal-to-noise ratio falls from "
        f"{m.radar.extra['snr_first_db']:.0f} dB at the start to {m.radar.extra['snr_jammed_db']:.1f} dB when "
        f"jammed. With 50 mm/h of rain: {rain['nominal'].position:.2f} m nominal, {rain['jammed'].position:.1f} "
        f"m jammed ({ours['jammed'].position:.1f} m without)."
    )


def _gnss_note(m: Measured) -> str:
    left = m.uncorrected.outcomes["srukf-joseph"].windows["nominal"].position
    return (
        "Nominal: 10-60 s. What is measured: the least-squares position of each fix alone. The receiver "
        f"removes the mean troposphere; if it did not, the nominal error would be {left:.1f} m. The filter is "
        "not told that the clock is degraded: R and Q stay."
    )


def _seen(m: Measured) -> int:
    """Pseudoranges and rates in a fix."""
    return 2 * round(m.gnss.extra["satellites_most"])


def _acquisition(m: Measured) -> Table:
    return Table(
        title="Acquisition from 20 km: 1 m and 0.2 mrad from a prior of 1 km",
        note="After the first look, and over all looks of the first 5 s.",
        header=("filter", "position m, first", "NEES, first", "in 95 %, first", "position m", "NEES", "in 95 %"),
        rows=tuple(
            (
                o.label,
                *(x for w in (o.windows["first"], o.windows["all"]) for x in (w.position, w.nees, w.inside)),
            )
            for o in m.acquisition.outcomes.values()
        ),
    )


def _durations(m: Measured) -> Table:
    least = m.durations["srukf"]
    labels = {name: o.label for name, o in m.validation.outcomes.items()}
    return Table(
        title="Time of a step",
        note="Predict and update of the validation, 100 runs in one call, on this computer; only ratios are "
        "meant.",
        header=("filter", "µs", "square-root UKF by triangularisation = 1"),
        rows=tuple((labels[name], micro, micro / least) for name, micro in m.durations.items()),
    )
