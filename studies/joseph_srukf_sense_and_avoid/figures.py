"""Figures 1-17 of De Vivo et al., redrawn. Single flights are those of the first seed."""

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from onboard.analysis.report.style import STYLE, panels
from onboard.arrays import Array
from studies.joseph_srukf_sense_and_avoid import scenes
from studies.joseph_srukf_sense_and_avoid.runs import JOSEPH, AllResults, Results, measurement_errors
from studies.report.drawing import COLOURS, legend, save, shade
from studies.tracking.outcomes import ACCELERATION, POSITION

SHOWN = ("ekf", "ukf", JOSEPH)
LABELS = {"ekf": "EKF", "ukf": "UKF", JOSEPH: "square-root UKF, Joseph"}
# the curves coincide: the first is broad, the others are broken
LINES: dict[str, Any] = {
    "ekf": {"linestyle": "-", "linewidth": 2.2, "alpha": 0.6},
    "ukf": {"linestyle": "--", "linewidth": 1.4},
    JOSEPH: {"linestyle": ":", "linewidth": 1.4},
}
RADAR_FAULTS = (*scenes.JAMMED, *scenes.SIGNAL_LOST)
GNSS_FAULTS = (*scenes.DEGRADED, *scenes.NO_SATELLITES)


def draw(m: AllResults, seeds: range, out: Path) -> tuple[str, ...]:
    """Write the figures into the folder `out`; their names. `seeds`: the first one."""
    t, truth = scenes.intruder()
    e = scenes.in_ecef(truth)
    with mpl.rc_context(STYLE):
        return save(
            {
                "figure-01-and-11-trajectories.png": _trajectories(m, seeds),
                "figure-02-05-validation-rmse.png": _validation(m),
                "figure-06-09-condition-numbers.png": _conditions(m),
                "figure-10-time.png": _times(m),
                "figure-12-radar-snr-and-condition.png": _signal(m, seeds),
                "figure-13-radar-acceleration.png": _accelerations(m.radar, t, truth, RADAR_FAULTS, "13: radar"),
                "figure-14-radar-rmse.png": _rmse(m.radar, t, RADAR_FAULTS, "14: radar", "east north up"),
                "figure-15-gnss-error-and-condition.png": _pseudoranges(m, seeds),
                "figure-16-gnss-acceleration.png": _accelerations(m.gnss, t, e, GNSS_FAULTS, "16: GNSS, ECEF"),
                "figure-17-gnss-rmse.png": _rmse(m.gnss, t, GNSS_FAULTS, "17: GNSS", "x y z"),
            },
            out,
        )


def _trajectories(m: AllResults, seeds: range) -> Figure:
    figure, axes = panels(
        "Figures 1 and 11: trajectories of the validation and of the intruder", 1, 2, (10.0, 5.0)
    )
    for axis, made, results, faults in (
        (axes[0, 0], scenes.validation(seeds), m.validation, ()),
        (axes[0, 1], scenes.by_radar(seeds), m.radar, RADAR_FAULTS),
    ):
        measured = (made.truth[:, POSITION] + measurement_errors(made)[:, 0]) / 1e3
        path, mean = made.truth[:, POSITION] / 1e3, results.outcomes[JOSEPH].first_mean[:, POSITION] / 1e3
        axis.plot(measured[:, 0], measured[:, 1], ".", color=COLOURS["raw"], markersize=2, label="measured")
        axis.plot(path[:, 0], path[:, 1], color="black", label="truth")
        axis.plot(mean[:, 0], mean[:, 1], "--", color=COLOURS[JOSEPH], label=LABELS[JOSEPH])
        for count, (begin, end) in enumerate(faults):
            k = slice(round(begin / scenes.DT), round(end / scenes.DT))
            style = {"color": COLOURS["ekf"], "linewidth": 4, "alpha": 0.35, "label": "" if count else "faults"}
            axis.plot(path[k, 0], path[k, 1], **style)
        axis.set_xlabel("east, km")
        axis.set_ylabel("north, km")
        axis.set_aspect("equal", adjustable="datalim")
    legend(figure, axes[0, 1])
    return figure


def _validation(m: AllResults) -> Figure:
    figure, axes = panels("Figures 2-5: RMSE of the validation, and UKF less Joseph", 2, 2, (9.5, 6.2))
    t, found = scenes.validation_times(), m.validation.outcomes
    for i, axis in enumerate(axes.flat[:3]):
        for name in SHOWN:
            axis.semilogy(
                t, found[name].rms[:, POSITION[i]], color=COLOURS[name], label=LABELS[name], **LINES[name]
            )
        axis.set_ylabel(f"{'xyz'[i]}, m")
    difference = [np.linalg.norm(found[name].rms[:, POSITION], axis=1) for name in ("ukf", JOSEPH)]
    axes[1, 1].plot(t, difference[0] - difference[1], color="black")
    axes[1, 1].set_ylabel("UKF − Joseph, m")
    _label_times(axes)
    legend(figure, axes[0, 0])
    return figure


def _conditions(m: AllResults) -> Figure:
    figure, axes = panels("Figures 6-9: condition numbers of the validation (medians)", 2, 2, (9.5, 6.2))
    t, found = scenes.validation_times(), m.validation.outcomes
    pairs = (
        ("EKF: κ(P)", (("ekf-plain", "as printed"), ("ekf", "Joseph"))),
        ("UKF: κ(P)", (("ukf", "classical"), (JOSEPH, "Joseph (κ(S)²)"))),
        ("square-root UKF: κ(S)", (("srukf-classical", "downdates"), (JOSEPH, "Joseph"))),
        ("all", (("ekf", "EKF κ(P)"), ("ukf", "UKF κ(P)"), (JOSEPH, "Joseph κ(S)"))),
    )
    for axis, (title, names) in zip(axes.flat, pairs, strict=True):
        for (name, label), style in zip(names, ("-", "--", ":"), strict=False):
            squared = label.endswith("²)")
            kappa = found[name].condition ** 2 if squared else found[name].condition
            axis.semilogy(t, kappa, style, color=COLOURS[name], label=label)
        axis.set_title(title, loc="left", fontsize=9)
        axis.legend(fontsize=8)
    _label_times(axes)
    return figure


def _times(m: AllResults) -> Figure:
    figure, axes = panels("Figure 10: time of a step, µs", 1, 1, (6.5, 2.8))
    names = list(m.durations)
    labels = [m.validation.outcomes[name].label for name in names]
    axes[0, 0].barh(labels, list(m.durations.values()), color=[COLOURS[name] for name in names])
    return figure


def _signal(m: AllResults, seeds: range) -> Figure:
    figure, axes = panels("Figure 12: the radar's signal-to-noise ratio, and condition numbers", 2)
    t, look = scenes.intruder()[0], scenes.looks(seeds)[0]
    axes[0, 0].plot(t, np.where(look.detected, look.snr_db, np.nan), color="black")
    axes[0, 0].set_ylabel("S/N, dB")
    _condition_panel(axes[1, 0], m.radar, t)
    for axis in axes[:, 0]:
        shade(axis, RADAR_FAULTS)
    _label_times(axes)
    return figure


def _pseudoranges(m: AllResults, seeds: range) -> Figure:
    figure, axes = panels("Figure 15: errors of pseudoranges (clock removed), and condition numbers", 2)
    t, truth = scenes.intruder()
    e, reception = scenes.in_ecef(truth), scenes.receptions(seeds)[0]
    for k, fix in enumerate(reception.fixes):
        if fix is not None:
            error = fix.y[: len(fix.slots)] - np.linalg.norm(fix.position - e[k, POSITION], axis=1)
            axes[0, 0].plot(
                np.full(len(error), t[k]), error - reception.clock[k, 0], ".", color="black", markersize=2
            )
    axes[0, 0].set_ylabel("m")
    _condition_panel(axes[1, 0], m.gnss, t)
    for axis in axes[:, 0]:
        shade(axis, GNSS_FAULTS)
    _label_times(axes)
    return figure


def _condition_panel(axis: Axes, results: Results, t: Array) -> None:
    for name in ("ekf-plain", *SHOWN):
        label = {"ekf-plain": "EKF as printed κ(P)"}.get(
            name, f"{LABELS.get(name)} κ({'S' if name == JOSEPH else 'P'})"
        )
        axis.semilogy(t, results.outcomes[name].condition, color=COLOURS[name], label=label, **LINES.get(name, {}))
    axis.set_ylabel("condition number")
    axis.legend(fontsize=8, ncols=2)


def _accelerations(
    results: Results, t: Array, truth: Array, faults: tuple[tuple[float, float], ...], title: str
) -> Figure:
    figure, axes = panels(f"Figure {title}: acceleration, m/s²", 3)
    for i, axis in enumerate(axes[:, 0]):
        for name in SHOWN:
            mean = results.outcomes[name].first_mean[:, ACCELERATION[i]]
            axis.plot(t, mean, color=COLOURS[name], label=LABELS[name], **LINES[name])
        axis.plot(t, truth[:, ACCELERATION[i]], color="black", linewidth=0.9, linestyle=(0, (4, 2)), label="truth")
        reach = 1.6 * float(np.abs(truth[:, ACCELERATION[i]]).max()) + 1
        axis.set_ylim(-reach, reach)
        axis.set_ylabel(f"axis {i + 1}")
        shade(axis, faults)
    _label_times(axes)
    legend(figure, axes[0, 0])
    return figure


def _rmse(results: Results, t: Array, faults: tuple[tuple[float, float], ...], title: str, names: str) -> Figure:
    figure, axes = panels(f"Figure {title}: RMSE of the measurements and of the filter, m", 3)
    for i, (axis, name) in enumerate(zip(axes[:, 0], names.split(), strict=True)):
        raw = results.raw_axes[:, i]
        known = np.isfinite(raw)
        axis.semilogy(t[known], raw[known], ".", color=COLOURS["raw"], markersize=2, label="measured")
        axis.semilogy(t, results.outcomes[JOSEPH].rms[:, POSITION[i]], color=COLOURS[JOSEPH], label=LABELS[JOSEPH])
        axis.set_ylabel(name)
        shade(axis, faults)
    _label_times(axes)
    legend(figure, axes[0, 0])
    return figure


def _label_times(axes: Array) -> None:
    for axis in axes[-1]:
        axis.set_xlabel("time, s")
