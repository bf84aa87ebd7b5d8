"""The figures of a flight's report. Needs the extra `study` (Matplotlib)."""

from collections.abc import Sequence
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from onboard.analysis.report.series import FUSED, FlightSeries
from onboard.analysis.report.style import STYLE, TRUTH_LINE, panels
from onboard.arrays import Array
from onboard.filters.gating import chi_square_threshold
from onboard.messages import Lifecycle
from onboard.scoring.leader import Errors
from onboard.scoring.reference import Reference
from onboard.units import S_PER_NS

MAX_CURVE_SAMPLES: Final = 2000
BINS: Final = 120  # of windowed figures
LEADER, OWN, BAD, GREY = "#0072b2", "#e69f00", "#d55e00", "#999999"
COLORS_BY_STATE: Final = dict(zip(Lifecycle, ("#999999", "#9a80d0", "#2e9e5b", "#e69f00", "#d55e00"), strict=True))


def figures(series: FlightSeries, errors: Errors | None, reference: Reference | None) -> dict[str, Figure]:
    """Figures of a flight by their titles; those without data are left out."""
    found: dict[str, Figure] = {}
    with mpl.rc_context(STYLE):
        if _any(series.own.table()[:, 1]):
            found["Flight track, from above"] = _track(series, reference)
        if len(series.own.table()):
            found["Our own vehicle, as the autopilot has it"] = _own_motion(series)
        if len(series.leader.table()):
            found["Range, and when there was an estimate"] = _range(series, reference)
        if len(series.images.table()):
            found["Images: what became of them, and whether their noise is as configured"] = _images(series)
        if errors is not None:
            found["Errors against the truth, inside their bounds?"] = _errors(errors)
        if len(series.own_state.table()):
            found["Our own state: do its sensors agree?"] = _own_state(series)
    return found


def _track(series: FlightSeries, reference: Reference | None) -> Figure:
    figure, axes = panels("", 1, size=(7.2, 4.6))
    axis, own, leader = axes[0, 0], thin(_placed(series)), series.leader.table()
    axis.plot(own[:, 2], own[:, 1], color=OWN, label="own vehicle")
    axis.plot(own[0, 2], own[0, 1], "o", color=OWN, markersize=5)
    if len(leader):
        there = thin(leader)
        axis.plot(*_absolute(series, there[:, 0], there[:, 2:4]), color=LEADER, label="leader (dot: the start)")
        first = there[np.isfinite(there[:, 2])][:1]
        if len(first):
            axis.plot(*_absolute(series, first[:, 0], first[:, 2:4]), "o", color=LEADER, markersize=5)
    if reference is not None:
        axis.plot(*_absolute(series, reference.time, reference.values[:, :2]), **TRUTH_LINE, label="leader, truth")
    axis.set(xlabel="east, m", ylabel="north, m")
    axis.set_aspect("equal", adjustable="datalim")
    axis.legend(loc="best", fontsize=8)
    return figure


def _range(series: FlightSeries, reference: Reference | None) -> Figure:
    figure, axes = panels("", 2, size=(7.2, 4.2), sharex=True)
    above, below = axes[:, 0]
    table = thin(series.leader.table())
    t, r, sigma = table[:, 0], np.linalg.norm(table[:, 2:5], axis=1), table[:, 5]
    above.fill_between(t, r - 2 * sigma, r + 2 * sigma, color=LEADER, alpha=0.25, linewidth=0, label="±2σ")
    above.plot(t, r, color=LEADER, label="range")
    if reference is not None:
        above.plot(reference.time, np.linalg.norm(reference.values[:, :3], axis=1), **TRUTH_LINE, label="truth")
    above.set(ylabel="range, m", ylim=(0.0, 1.15 * float(np.nanpercentile(r + sigma, 99.5)) if _any(r) else 1.0))
    above.legend(loc="best", fontsize=8, ncols=3)
    _strip(below, series)
    below.set_xlabel("time since the autopilot's start, s")
    return figure


def _strip(axis: Any, series: FlightSeries) -> None:
    """The states of the estimate as coloured bars, one row each."""
    changes = series.states.table()
    ends = np.append(changes[1:, 0], series.end_s)
    for row, state in enumerate(Lifecycle):
        of_state = changes[:, 1] == row
        bars = list(zip(changes[of_state, 0], ends[of_state] - changes[of_state, 0], strict=True))
        axis.broken_barh(bars, (row - 0.4, 0.8), color=COLORS_BY_STATE[state], linewidth=0)
    axis.set(yticks=range(len(Lifecycle)), yticklabels=[str(state) for state in Lifecycle])
    axis.set_ylim(-0.6, len(Lifecycle) - 0.4)
    axis.grid(visible=False, axis="y")


def _images(series: FlightSeries) -> Figure:
    figure, axes = panels("", 2, size=(7.2, 4.2), sharex=True)
    above, below = axes[:, 0]
    table = series.images.table()
    seen = [verdict for verdict in series.verdicts if series.counts[verdict]]
    for row, verdict in enumerate(seen):
        times = table[table[:, 1] == series.verdicts.index(verdict), 0]
        marks = np.unique(np.round(times, 1))  # a tenth of a second is thinner than a mark
        above.plot(marks, np.full(len(marks), row), "|", color=LEADER if verdict in FUSED else BAD, markersize=9)
    above.set(yticks=range(len(seen)), yticklabels=[f"{v} ({series.counts[v]})" for v in seen])
    above.set_ylim(-0.6, len(seen) - 0.4)
    t, ratio, low, high = _windowed(table[np.isfinite(table[:, 2])])
    below.fill_between(t, low, high, color=GREY, alpha=0.3, linewidth=0, label="95 % of a matched filter")
    below.plot(t, ratio, color=LEADER, label="NIS, of its expectation")
    below.set(xlabel="time since the autopilot's start, s", yscale="log")
    below.legend(loc="best", fontsize=8, ncols=2)
    return figure


def _windowed(table: Array) -> tuple[Array, Array, Array, Array]:
    """Times, mean NIS ratios in windows, and their lower and upper 95 % bounds."""
    if not len(table):
        return (np.empty(0),) * 4
    rows = []
    for part in np.array_split(table, min(BINS, -(-len(table) // 10))):
        dof = int(part[:, 3].sum())
        bounds = [chi_square_threshold(p, dof) / dof for p in (0.025, 0.975)] if dof else [np.nan, np.nan]
        rows.append([part[:, 0].mean(), part[:, 2].sum() / max(dof, 1), *bounds])
    t, ratio, low, high = np.array(rows).T
    return t, ratio, low, high


def _errors(errors: Errors) -> Figure:
    figure, axes = panels("", 2, size=(7.2, 4.2), sharex=True)
    above, below = axes[:, 0]
    keep = slice(None, None, -(-len(errors.time) // MAX_CURVE_SAMPLES))
    t, percent = errors.time[keep], 100.0 * errors.range_fraction[keep]
    sigma = np.abs(percent) / np.maximum(errors.range_sigmas[keep], 1e-9)
    above.fill_between(t, -2 * sigma, 2 * sigma, color=LEADER, alpha=0.25, linewidth=0, label="±2σ of the filter")
    above.plot(t, percent, color=LEADER, label="range error")
    limit = 1.2 * float(np.percentile(np.maximum(2 * sigma, np.abs(percent)), 99))
    above.set(ylabel="%", ylim=(-limit, limit))
    above.legend(loc="best", fontsize=8, ncols=2)
    low, high = chi_square_threshold(0.025, 3), chi_square_threshold(0.975, 3)
    below.axhspan(low, high, color=GREY, alpha=0.3, linewidth=0, label="95 % of a matched filter")
    below.plot(t, errors.position_nees[keep], color=LEADER, label="NEES of the position (3)")
    below.set(xlabel="time since the autopilot's start, s", yscale="log")
    below.legend(loc="best", fontsize=8, ncols=2)
    return figure


def _own_state(series: FlightSeries) -> Figure:
    figure, axes = panels("", 2, size=(7.2, 4.2), sharex=True)
    (axis, below), table = axes[:, 0], thin(series.own_state.table())
    axis.plot(table[:, 0], table[:, 2], color=OWN, label="NIS, of its expectation")
    axis.axhline(1.0, color=GREY, linewidth=0.8)
    for fault in series.faults.values():
        axis.axvline(fault.t_onset_ns * S_PER_NS, color=BAD, linewidth=1.0)
        name = fault.name
        at = fault.t_onset_ns * S_PER_NS, 1.0
        axis.annotate(name, at, xycoords=("data", "axes fraction"), color=BAD, rotation=90, va="top", ha="right")
    axis.set(yscale="log")
    axis.legend(loc="best", fontsize=8)
    own = series.own.table()
    if len(own):
        there = [np.interp(table[:, 0], own[:, 0], own[:, 4 + k]) for k in range(3)]
        off = np.linalg.norm(table[:, 3:6] - np.stack(there, 1), axis=1)
        below.plot(table[:, 0], off, color=OWN, label="velocity, off the autopilot's")
        below.legend(loc="best", fontsize=8)
    below.set(xlabel="time since the autopilot's start, s", ylabel="m/s")
    return figure


def _own_motion(series: FlightSeries) -> Figure:
    """Height above the origin, speeds and attitude."""
    figure, axes = panels("", 3, size=(7.2, 5.4), sharex=True)
    own = thin(series.own.table())
    t, (above, middle, below) = own[:, 0], axes[:, 0]
    above.plot(t, -own[:, 3], color=OWN)
    above.set(ylabel="height, m")
    middle.plot(t, np.hypot(own[:, 4], own[:, 5]), color=OWN, label="over ground")
    middle.plot(t, -own[:, 6], color=LEADER, label="up")
    middle.set(ylabel="speed, m/s")
    for column, name, colour in ((7, "roll", OWN), (8, "pitch", LEADER), (9, "yaw", GREY)):
        below.plot(t, own[:, column], ".", markersize=1.5, color=colour, label=name)
    below.set(xlabel="time since the autopilot's start, s", ylabel="degrees")
    for axis in (middle, below):
        axis.legend(loc="best", fontsize=8, ncols=3)
    return figure


def _absolute(series: FlightSeries, t: Array, r_north_east: Array) -> tuple[Array, Array]:
    """East and north of a relative position at times, from the autopilot's origin."""
    own = _placed(series)
    there = [np.interp(t, own[:, 0], own[:, 1 + k]) + r_north_east[:, k] for k in (0, 1)]
    return there[1], there[0]


def _placed(series: FlightSeries) -> Array:
    """The rows of our own vehicle whose position is known."""
    own = series.own.table()
    return own[np.isfinite(own[:, 1])]


def thin(table: Array) -> Array:
    """Keep every k-th row, so that a curve has not too many points."""
    return table[:: -(-len(table) // MAX_CURVE_SAMPLES) or 1]


def _any(values: Array | Sequence[float]) -> bool:
    return bool(np.isfinite(values).any())
