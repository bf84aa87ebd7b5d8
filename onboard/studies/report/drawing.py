"""The look of all studies' figures. Needs the extra `study`."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl

mpl.use("Agg")

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from onboard.arrays import Array

COLOURS: Final = {
    "ekf": "#d55e00",
    "ekf-plain": "#cc79a7",
    "ukf": "#0072b2",
    "srukf": "#56b4e9",
    "srukf-joseph": "#009e73",
    "srukf-classical": "#e69f00",
    "raw": "#999999",
}
FAULT: Final = "#cccccc"
STYLE: Final[dict[Any, Any]] = {
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.25,
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.0,
    "legend.frameon": False,
    "figure.dpi": 130,
}
TRUTH: Final[dict[str, Any]] = {"color": "black", "linewidth": 0.9, "linestyle": (0, (4, 2))}


def panels(
    title: str,
    rows: int,
    columns: int = 1,
    size: tuple[float, float] = (7.2, 6.2),
    *,
    sharex: bool = False,
    sharey: bool = False,
) -> tuple[Figure, Any]:
    """A figure and its axes (rows, columns), with a title over all."""
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, sharex=sharex, sharey=sharey)
    figure.suptitle(title, fontsize=10, x=0.01, ha="left")
    return figure, axes


def legend(figure: Figure, axis: Axes, columns: int = 4) -> None:
    """One legend below, of the curves of one panel."""
    handles, labels = axis.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(len(handles), columns))


def shade(axis: Axes, intervals: Sequence[tuple[float, float]]) -> None:
    """Grey where a fault lasts."""
    for begin, end in intervals:
        axis.axvspan(begin, end, color=FAULT, alpha=0.45, linewidth=0)


def within_sigma(axis: Axes, t: Array, error: Array, sigma: Array, colour: str, label: str) -> None:
    """An error between plus and minus one standard deviation by the filter's own account."""
    axis.fill_between(t, -sigma, sigma, color=colour, alpha=0.2, linewidth=0, label="±1σ of the filter")
    axis.plot(t, error, color=colour, linewidth=0.6, label=label)


def save(figures: Mapping[str, Figure], out: Path) -> tuple[str, ...]:
    """Write them into the folder `out`; their file names."""
    out.mkdir(parents=True, exist_ok=True)
    for name, figure in figures.items():
        figure.savefig(out / name)
    return tuple(figures)
