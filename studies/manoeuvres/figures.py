"""The figure of the manoeuvres: how near and how far each flight came."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

import matplotlib as mpl

from onboard.analysis.report.style import STYLE, panels
from studies.manoeuvres.flights import MANOEUVRES, SPEEDS
from studies.report.drawing import COLOURS, save

if TYPE_CHECKING:
    from studies.manoeuvres.study import Row

NAME: Final = "distances.png"
MAX_SHOWN_PERCENT: Final = 400.0  # the rest is cut off


def draw(rows: Sequence["Row"], out: Path) -> tuple[str, ...]:
    """Write the figure into the folder `out`; its file name."""
    names = [m.name for m in MANOEUVRES]
    with mpl.rc_context(STYLE):
        figure, axes = panels("How near and how far each flight came", 1, len(SPEEDS), (11.0, 6.0), sharey=True)
        for axis, autopilot in zip(axes.flat, SPEEDS, strict=True):
            for name, m, found in rows:
                place = names.index(m.name)
                for k, result in enumerate(found if name == autopilot else ()):
                    y = place + 0.6 * ((k + 0.5) / len(found) - 0.5)
                    colour = COLOURS["ukf"] if result.followed else COLOURS["ekf"]
                    axis.plot(
                        [result.least, min(result.greatest, MAX_SHOWN_PERCENT)],
                        [y, y],
                        color=colour,
                        linewidth=1.5,
                    )
            axis.axvline(200.0 / 3.0, color="black", linewidth=0.8, linestyle="--")
            axis.set_title(f"{autopilot} (orange: not followed at the end)")
            axis.set_xlabel("distance, % of the slot's")
            axis.set_xlim(0.0, MAX_SHOWN_PERCENT)
            axis.set_yticks(range(len(names)), names)
        axes.flat[0].invert_yaxis()
        return save({NAME: figure}, out)
