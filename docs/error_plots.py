"""One plot for each estimator: its errors in a simulated flight within its own bounds."""

from collections import Counter
from collections.abc import Callable
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from drawings import BLUE, GREEN, INK, ORANGE, PICTURES, PINK

from onboard.analysis.report.style import STYLE
from onboard.arrays import Array
from onboard.messages import Estimate, NavState, TrafficTruth, Truth

SIGMAS: Final = 3.0
MAX_ROWS: Final = 500  # of a plot
SETTLING_TIME_S: Final = 5.0
LOOK: Final = {
    **STYLE,
    "svg.hashsalt": "wingline",
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": INK,
    "xtick.color": INK,
    "ytick.color": INK,
}
Flown = Callable[[str, float], tuple[Any, ...]]


def main(flown: Flown) -> None:
    """Write the four plots into docs/pictures."""
    mission = flown("mission", 60.0)
    _draw("errors-leader.svg", *leader(mission, "leader"), BLUE)
    _draw("errors-oh-johnson.svg", *leader(flown("formation", 60.0), "oh_johnson"), PINK)
    _draw("errors-own-state.svg", *own_state(mission), ORANGE)
    _draw("errors-traffic.svg", *traffic(flown("traffic", 60.0)), GREEN)


def leader(records: tuple[Any, ...], name: str) -> tuple[Array, Array, Array, list[str]]:
    """Return times (n,) s, errors (n, 3) m of the leader's position, and their three-sigma bounds."""
    found = [r for r in records if isinstance(r, Estimate) and r.name == name and r.valid and r.mean is not None]
    truths = [r for r in records if isinstance(r, Truth)]
    times = np.array([t.t_ns for t in truths])
    true = np.array([t.r_FL_n for t in truths])
    rows = [
        (e.t_ns, *(np.array(e.mean)[:3] - _at(times, true, e.t_ns)), *_bounds(e.covariance, range(3)))
        for e in found
    ]
    return _parts(rows, ["north [m]", "east [m]", "down [m]"])


def own_state(records: tuple[Any, ...]) -> tuple[Array, Array, Array, list[str]]:
    """Return the same for our own velocity, m/s."""
    truths = [r for r in records if isinstance(r, Truth)]
    times, true = np.array([t.t_ns for t in truths]), np.array([t.v_F_n for t in truths])
    found = [r for r in records if isinstance(r, NavState) and r.valid and r.mean is not None]
    rows = [
        (s.t_ns, *(np.array(s.mean)[3:6] - _at(times, true, s.t_ns)), *_bounds(s.covariance, range(3, 6)))
        for s in found
    ]
    return _parts(rows, ["north [m/s]", "east [m/s]", "down [m/s]"])


def traffic(records: tuple[Any, ...]) -> tuple[Array, Array, Array, list[str]]:
    """Return the same for the position of the most frequently estimated aircraft, m."""
    truths: dict[str, list[tuple[float, ...]]] = {}
    for r in records:
        for one in r.intruders if isinstance(r, TrafficTruth) else ():
            truths.setdefault(one.target, []).append((r.t_ns, *one.r_FT_n))
    found = [
        r for r in records if isinstance(r, Estimate) and r.name == "traffic" and r.valid and r.target in truths
    ]
    (target, _), *_ = Counter(r.target for r in found).most_common(1)
    times, *axes = np.array(truths[target]).T
    true = np.array(axes).T
    rows = [
        (e.t_ns, *(np.array(e.mean)[:3] - _at(times, true, e.t_ns)), *_bounds(e.covariance, range(3)))
        for e in found
        if e.target == target and e.mean is not None
    ]
    return _parts(rows, ["north [m]", "east [m]", "down [m]"])


def _bounds(covariance: Any, places: range) -> list[float]:
    return [SIGMAS * float(covariance[k][k]) ** 0.5 for k in places]


def _at(times: Array, values: Array, t_ns: int) -> Array:
    return np.array([np.interp(t_ns, times, column) for column in values.T])


def _parts(rows: list[Any], names: list[str]) -> tuple[Array, Array, Array, list[str]]:
    table = np.array(rows[:: max(len(rows) // MAX_ROWS, 1)], dtype=float)
    seconds = (table[:, 0] - table[0, 0]) * 1e-9
    keep = seconds >= 0.0
    return seconds[keep], table[keep, 1:4], table[keep, 4:7], names


def _draw(file: str, t: Array, errors: Array, bounds: Array, names: list[str], colour: str) -> None:
    """Draw three panels, one for each axis, with the scale of the settled bounds."""
    with mpl.rc_context(LOOK):
        from matplotlib.figure import Figure  # noqa: PLC0415

        figure = Figure(figsize=(7.6, 4.4), layout="constrained")
        figure.patch.set_alpha(0.0)
        axes = figure.subplots(3, 1, sharex=True)
        for k, axis in enumerate(axes):
            axis.patch.set_alpha(0.0)
            axis.fill_between(t, -bounds[:, k], bounds[:, k], color=colour, alpha=0.18, linewidth=0)
            axis.plot(t, errors[:, k], color=colour, linewidth=0.9)
            high = 1.25 * float(np.percentile(bounds[t > SETTLING_TIME_S, k], 98))
            axis.set_ylim(-high, high)
            axis.set_ylabel(names[k])
            inside = 100.0 * float(np.mean(np.abs(errors[:, k]) <= bounds[:, k]))
            axis.set_title(f"{inside:.1f} % inside ±3σ", loc="right", fontsize=8, color=INK)
        axes[-1].set_xlabel("time since the first valid estimate [s]")
        figure.savefig(PICTURES / file, metadata={"Date": None})
