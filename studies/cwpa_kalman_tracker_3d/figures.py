"""Figures 1-5 of Lazarov et al., redrawn from one run that begins at rest."""

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from onboard.analysis.report.style import STYLE, panels
from onboard.arrays import Array
from onboard.filters.discretisation import wiener_acceleration
from studies.cwpa_kalman_tracker_3d.runs import DENSITY, DT, Runs
from studies.report.drawing import COLOURS, legend, save

SHOWN = (17, 29, 34, 42, 45, 49)  # the steps of figures 3-5
ONE_SIGMA_PLANE = 2.2789  # chi-square of two, 68 %
MARGIN = 6.0  # m around what a panel of figures 3-5 shows: twice an ellipse


def draw(runs: Runs, out: Path) -> tuple[str, ...]:
    """Write the figures into the folder `out`; their names."""
    with mpl.rc_context(STYLE):
        return save(
            {
                "figure-01-02-trajectory.png": _trajectory(runs),
                "figure-03-05-steps.png": _steps(runs),
            },
            out,
        )


def _trajectory(runs: Runs) -> Figure:
    figure, axes = panels("Figures 1 and 2: trajectory and velocity in the plane (x, y)", 1, 2, (9.5, 4.6))
    plan, speed = axes[0]
    plan.plot(*runs.measured[:, 0, :2].T, ".", color=COLOURS["raw"], markersize=4, label="measured")
    for axis, i in ((plan, 0), (speed, 3)):
        axis.plot(*runs.truth[:, 0, i : i + 2].T, color="black", label="real")
        axis.plot(*runs.mean[:, 0, i : i + 2].T, "--", color=COLOURS["ukf"], label="estimated")
        axis.plot(0, 0, "o", color="black", fillstyle="none")
    _label_axes(plan, "m")
    _label_axes(speed, "m/s")
    legend(figure, plan)
    return figure


def _steps(runs: Runs) -> Figure:
    """Draw each estimate's ellipse and that of the next step, with an inset of their position."""
    title = "Figures 3-5: the filter at single steps, with the 68 % ellipses of the estimate and of the prediction"
    figure, axes = panels(title, 2, 3, (10.5, 7.4))
    F, Q = wiener_acceleration(DT, DENSITY)
    for axis, step in zip(axes.flat, SHOWN, strict=True):
        k = step - 1
        mean, P = runs.mean[k, 0], runs.covariance[k]
        after = F @ mean
        axis.plot(*runs.measured[: k + 1, 0, :2].T, ".", color=COLOURS["raw"], markersize=5, label="measured")
        axis.plot(*runs.truth[:, 0, :2].T, color="black", linewidth=0.8, label="real")
        real = runs.truth[k, 0, :2]
        axis.plot(*real, "x", color="black", markersize=6, label="real at this step")
        axis.plot(*runs.mean[: k + 1, 0, :2].T, "--", color=COLOURS["ukf"])
        _believed(axis, mean, P, COLOURS["ukf"], "filtered")
        _believed(axis, after, F @ P @ F.T + Q, COLOURS["ekf"], "predicted next")
        _around(axis, real, mean[:2], after[:2])
        _whole(axis, runs.truth[:, 0, :2], mean[:2])
        axis.set_title(f"step {step}", loc="left", fontsize=9)
        _label_axes(axis, "m")
    legend(figure, axes[0, 0], columns=5)
    return figure


def _believed(axis: Axes, mean: Array, P: Array, colour: str, label: str) -> None:
    """A state's place in the plane, with its ellipse."""
    axis.fill(*_ellipse(mean[:2], P[:2, :2]), facecolor=colour, edgecolor=colour, alpha=0.3)
    axis.plot(*mean[:2], "o", color=colour, markersize=4, label=label)


def _around(axis: Axes, *places: Array) -> None:
    """Equal scales, and a window that holds the places and their ellipses."""
    low, high = np.min(places, axis=0), np.max(places, axis=0)
    half = MARGIN + float(np.max(high - low)) / 2
    x, y = (low + high) / 2
    axis.set_aspect("equal")
    axis.set_xlim(x - half, x + half)
    axis.set_ylim(y - half, y + half)


def _whole(axis: Axes, path: Array, here: Array) -> None:
    """The whole path in a corner, and where the panel is on it."""
    corner = axis.inset_axes((0.02, 0.02, 0.24, 0.24), xticks=[], yticks=[])
    corner.plot(*path.T, color="black", linewidth=0.7)
    corner.plot(*here, "s", color=COLOURS["ukf"], fillstyle="none", markersize=5)
    corner.margins(0.15)


def _ellipse(centre: Array, covariance: Array) -> Array:
    angle = np.linspace(0, 2 * np.pi, 60)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    return np.asarray(centre[:, None] + np.sqrt(ONE_SIGMA_PLANE) * np.linalg.cholesky(covariance) @ circle)


def _label_axes(axis: Axes, unit: str) -> None:
    axis.set_xlabel(f"x, {unit}")
    axis.set_ylabel(f"y, {unit}")
