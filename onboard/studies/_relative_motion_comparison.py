"""One picture of all variants: what the paper's settings make of each, and what ours do."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from onboard.studies._relative_motion_table import Limit, Row
from onboard.studies._relative_motion_variants import COMPARED, VARIANTS

MARKS: Final = ("#d55e00", "#009e73", "#0072b2", "#cc79a7")
PANELS: Final = {
    "position_ft": "Position error, ft",
    "velocity_ft_s": "Velocity error, ft/s",
    "range_percent": "Range error, %",
    "nees": "NEES (should average 9)",
    "inside_percent": "True positions in the 95 % ellipsoid, %",
    "diverged": "Diverged, %",
}


def compared(rows: Sequence[Row], limits: Sequence[Limit]) -> Figure:
    """Dots by variant, a panel for each figure of merit; hollow where more than half of the runs diverged. Bars are
    Cramer-Rao bounds."""
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


def _value(row: Row, quantity: str) -> float:
    value = row.diverged_percent if quantity == "diverged" else row.quantities[quantity].value
    return np.nan if value is None else value
