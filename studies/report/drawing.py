"""The common parts of several studies' figures; they need the extra `study`."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

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
