"""The figure of the closed loop: distance and slot error over the flight."""

from pathlib import Path
from typing import Final

import matplotlib as mpl
import numpy as np

from onboard.analysis.report.style import STYLE, panels
from studies.closed_loop.flight import Flight
from studies.report.drawing import COLOURS, save, shade

NAME: Final = "flight.png"


def draw(flight: Flight, out: Path) -> tuple[str, ...]:
    """Write the figure into the folder `out`; its file name."""
    with mpl.rc_context(STYLE):
        figure, axes = panels("Formation on our estimates", 2, 1, (10.0, 5.0), sharex=True)
        top, bottom = axes.flat
        top.plot(flight.t, flight.distance, color=COLOURS["ukf"])
        top.set_ylabel("distance, m")
        bottom.plot(flight.t, flight.slot_error, color=COLOURS["ukf"])
        bottom.set_ylabel("from the slot, m")
        bottom.set_xlabel("time, s")
        for axis in (top, bottom):
            shade(axis, _not_valid(flight))
        bottom.set_ylim(0, 10)
        return save({NAME: figure}, out)


def _not_valid(flight: Flight) -> list[tuple[float, float]]:
    """When the estimate was not valid: begin and end of each interval, s."""
    edges = np.flatnonzero(np.diff(np.concatenate(([1.0], flight.valid, [1.0]))))
    times = flight.t[np.minimum(edges, len(flight.t) - 1)].tolist()
    return list(zip(times[::2], times[1::2], strict=True))
