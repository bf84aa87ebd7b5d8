"""Pictures of all variants: what the paper's settings make of each, and what ours do."""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from onboard.arrays import Array
from onboard.studies.relative_motion.table import Limit, Row
from onboard.studies.relative_motion.variants import COMPARED, VARIANTS

MARKS: Final = ("#d55e00", "#009e73", "#cc79a7", "#0072b2")
PANELS: Final = {
    "position_ft": "Position error, ft",
    "velocity_ft_s": "Velocity error, ft/s",
    "range_percent": "Range error, %",
    "nees": "NEES (should average 9)",
    "inside_percent": "True positions in the 95 % ellipsoid, %",
    "diverged": "Diverged, %",
}


def compared(rows: Sequence[Row], limits: Sequence[Limit]) -> Figure:
    """Dots by variant, a panel for each figure of merit; hollow where more than half of the runs diverged. Bars
    are Cramer-Rao bounds."""
    known = {(row.variant, row.method): row for row in rows}
    names = [v.name for v in VARIANTS if any((v.name, m.name) in known for m in COMPARED)]
    figure = Figure(figsize=(11.0, 6.6), layout="constrained")
    for axis, (quantity, title) in zip(figure.subplots(2, 3).flat, PANELS.items(), strict=True):
        for shift, (method, colour) in enumerate(zip(COMPARED, MARKS, strict=False)):
            for x, name in enumerate(names):
                row = known.get((name, method.name))
                value = np.nan if row is None else _value(row, quantity)
                hollow = row is not None and row.diverged_percent > 50
                axis.plot(
                    x + 0.18 * (shift - 0.5 * (len(COMPARED) - 1)),
                    value,
                    marker="o",
                    markersize=5,
                    linestyle="",
                    color=colour,
                    markerfacecolor="white" if hollow else colour,
                    label=method.label if x == 0 else None,
                )
        for limit in limits:
            if limit.variant in names and hasattr(limit, quantity):
                at, bound = names.index(limit.variant), getattr(limit, quantity)
                axis.hlines(bound, at - 0.35, at + 0.35, color="black", linewidth=1.2)
        axis.set_title(title, loc="left", fontsize=9.5)
        axis.set_xticks(range(len(names)), names, rotation=60, fontsize=8, ha="right", rotation_mode="anchor")
        if quantity in ("inside_percent", "diverged"):
            axis.set_ylim(-4, 104)
        else:
            axis.set_yscale("log")
        if quantity == "nees":
            axis.axhline(9, color="black", linewidth=0.7)
        if quantity == "inside_percent":
            axis.axhline(95, color="black", linewidth=0.7)
    figure.suptitle(
        "over t ≥ 15 s · hollow: most runs diverged, figure of the others · bars: Cramer-Rao bound",
        fontsize=8.5,
        x=0.01,
        ha="left",
    )
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(handles))
    return figure


def over_time(examples: Mapping[str, Mapping[str, Array]]) -> Figure:
    """A panel for each variant: by method of COMPARED, rows (T, 3) of one flight's time, position error and
    reported sigma of the position (root of the summed variances), ft."""
    shown = [variant for variant in VARIANTS if variant.name in examples]
    columns = min(5, len(shown))
    figure = Figure(figsize=(13.0, 0.8 + 2.2 * -(-len(shown) // columns)), layout="constrained")
    axes = figure.subplots(-(-len(shown) // columns), columns, sharex=True, squeeze=False).flat
    for axis, variant in zip(axes, shown, strict=False):
        for method, colour in zip(COMPARED, MARKS, strict=False):
            if method.name in examples[variant.name]:
                t, error, sigma = examples[variant.name][method.name].T
                axis.semilogy(t, error, color=colour, label=method.label, linewidth=1.0)
                axis.semilogy(t, sigma, color=colour, linestyle=(0, (2, 1.5)), linewidth=0.8)
        axis.set_title(f"{variant.name}: {variant.label}", loc="left", fontsize=8)
        axis.set_ylim(0.1, 3000)
        axis.set_xlim(0, 60)
        axis.tick_params(labelsize=7.5)
    for axis in axes:  # those left over
        axis.set_visible(False)
    figure.suptitle(
        "position error, ft, of one flight over time, s · dashed: the σ reported", fontsize=9, x=0.01, ha="left"
    )
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(handles))
    return figure


def _value(row: Row, quantity: str) -> float:
    value = row.diverged_percent if quantity == "diverged" else row.quantities[quantity].value
    return np.nan if value is None else value
