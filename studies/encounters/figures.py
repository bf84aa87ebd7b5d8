"""The figure of the study of encounters: estimated and true range of one flight of each family."""

from collections.abc import Mapping
from pathlib import Path
from typing import Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes

from onboard.analysis.report.style import STYLE, TRUTH_LINE, panels
from studies.encounters.flights import Case, Flight
from studies.report.drawing import COLOURS, legend, save

COLUMNS: Final = 3
COLOUR: Final = COLOURS["ukf"]
NAME: Final = "ranges.png"


def draw(flights: Mapping[Case, Flight], out: Path) -> tuple[str, ...]:
    """Write the figure into the folder `out`; its file name."""
    with mpl.rc_context(STYLE):
        rows = -(-len(flights) // COLUMNS)
        figure, axes = panels(
            "Range of the leader: truth and estimate", rows, COLUMNS, (10.0, 2.4 * rows), sharex=True
        )
        for axis, (case, flight) in zip(axes.flat, flights.items(), strict=False):
            axis.fill_between(
                *(flight.t, flight.range_ - flight.sigma, flight.range_ + flight.sigma),
                color=COLOUR,
                alpha=0.25,
                linewidth=0,
                label="±1σ of the filter",
            )
            axis.plot(flight.t, flight.range_, color=COLOUR, label="estimate, where valid")
            axis.plot(flight.t, flight.distance, label="truth", **TRUTH_LINE)
            _limit(axis, flight)
            axis.set_title(case.name, fontsize=9)
        for axis in axes[-1]:
            axis.set_xlabel("time, s")
        for axis in axes[:, 0]:
            axis.set_ylabel("range, m")
        legend(figure, axes[0, 0])
        return save({NAME: figure}, out)


def _limit(axis: Axes, flight: Flight) -> None:
    """Scale by the truth, so that a bad estimate does not flatten it; note what is off the scale."""
    top = 2.0 * float(np.max(flight.distance, initial=1.0))
    axis.set_ylim(0.0, top)
    highest = float(np.nanmax(flight.range_, initial=0.0))
    if highest > top:
        axis.text(
            0.98, 0.05, f"estimate up to {highest:.0f} m", transform=axis.transAxes, ha="right", color=COLOUR
        )
