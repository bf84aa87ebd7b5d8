"""Figures over all variants: errors with the paper's settings beside those with ours."""

from collections.abc import Mapping, Sequence
from typing import Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from onboard.analysis.report.style import panels
from onboard.arrays import Array
from studies.relative_motion.bound import VariantBound
from studies.relative_motion.scores import Row
from studies.relative_motion.variants import COMPARED, SHOWN, VARIANTS
from studies.report.drawing import legend
from studies.report.runs import by_name

COLOURS: Final = dict(
    zip((method.name for method in SHOWN), ("#d55e00", "#0072b2", "#009e73", "#cc79a7"), strict=False)
)
QUANTITIES: Final = {
    "position_ft": "Position error, ft",
    "velocity_ft_s": "Velocity error, ft/s",
    "range_percent": "Range error, %",
    "nees": "NEES (should average 9)",
    "inside_percent": "True positions in the 95 % ellipsoid, %",
    "diverged": "Diverged, %",
}
RIGHT: Final = {"nees": 9.0, "inside_percent": 95.0}


def compared(rows: Sequence[Row], bounds: Sequence[VariantBound]) -> Figure:
    """Draw dots by variant, a panel for each figure of merit, with bars of the Cramer-Rao bounds.

    Dots are hollow if more than half of the runs diverged.
    """
    known = by_name(rows)
    names = [v.name for v in VARIANTS if any((v.name, m.name) in known for m in COMPARED)]
    title = "over t ≥ 15 s · hollow: most runs diverged, figure of the others · bars: Cramer-Rao bound"
    figure, axes = panels(title, 2, 3, (11.0, 6.6))
    for axis, (quantity, label) in zip(axes.flat, QUANTITIES.items(), strict=True):
        _dots(axis, quantity, names, known)
        for bound in bounds:
            if bound.variant in names and hasattr(bound, quantity):
                x = names.index(bound.variant)
                axis.hlines(getattr(bound, quantity), x - 0.35, x + 0.35, color="black", linewidth=1.2)
        axis.set_title(label, loc="left", fontsize=9.5)
        axis.set_xticks(range(len(names)), names, rotation=60, fontsize=8, ha="right", rotation_mode="anchor")
        if quantity in ("inside_percent", "diverged"):
            axis.set_ylim(-4, 104)
        else:
            axis.set_yscale("log")
        if quantity in RIGHT:
            axis.axhline(RIGHT[quantity], color="black", linewidth=0.7)
    legend(figure, figure.axes[0])
    return figure


def over_time(examples: Mapping[str, Mapping[str, Array]]) -> Figure:
    """Draw a panel for each variant with rows (T, 3) of one flight, by method of COMPARED.

    A row has time, position error and reported sigma of the position (root of the summed variances), ft.
    """
    shown = [variant for variant in VARIANTS if variant.name in examples]
    columns = min(5, len(shown))
    lines = -(-len(shown) // columns)
    title = "position error, ft, of one flight over time, s · dashed: the reported σ"
    figure, axes = panels(title, lines, columns, (13.0, 0.8 + 2.2 * lines), sharex=True)
    for axis, variant in zip(axes.flat, shown, strict=False):
        for method in COMPARED:
            if method.name in examples[variant.name]:
                t, error, sigma = examples[variant.name][method.name].T
                colour = COLOURS[method.name]
                axis.semilogy(t, error, color=colour, label=method.label)
                axis.semilogy(t, sigma, color=colour, linestyle=(0, (2, 1.5)), linewidth=0.8)
        axis.set_title(f"{variant.name}: {variant.label}", loc="left", fontsize=8)
        axis.set_ylim(0.1, 3000)
        axis.set_xlim(0, 60)
        axis.tick_params(labelsize=7.5)
    for axis in axes.flat[len(shown) :]:
        axis.set_visible(False)
    legend(figure, figure.axes[0])
    return figure


def _dots(axis: Axes, quantity: str, names: Sequence[str], rows: Mapping[tuple[str, str], Row]) -> None:
    """A dot for each variant and method of COMPARED."""
    for place, method in enumerate(COMPARED):
        colour = COLOURS[method.name]
        for x, name in enumerate(names):
            row = rows.get((name, method.name))
            if row is None:
                continue
            axis.plot(
                x + 0.18 * (place - 0.5 * (len(COMPARED) - 1)),
                row.diverged_percent if quantity == "diverged" else row.value(quantity),
                marker="o",
                markersize=5,
                linestyle="",
                color=colour,
                markerfacecolor="white" if row.diverged_percent > 50 else colour,
                label=method.label if x == 0 else None,
            )
