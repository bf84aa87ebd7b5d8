"""Style of all figures, in reports and studies. Needs the extra `study`."""

from typing import Any, Final

import matplotlib as mpl

mpl.use("Agg")

from matplotlib.figure import Figure

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
TRUTH_LINE: Final[dict[str, Any]] = {"color": "black", "linewidth": 0.9, "linestyle": (0, (4, 2))}


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
