"""Figures 1-5 of Lazarov et al., redrawn from one run that begins at rest."""

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from onboard.arrays import Array
from onboard.filters.discretisation import wiener_acceleration
from onboard.studies.cwpa_kalman_tracker_3d.runs import DENSITY, DT, Runs
from onboard.studies.report.drawing import COLOURS, STYLE, legend, panels, save

SHOWN = (17, 29, 34, 42, 45, 49)  # the steps of figures 3-5
ONE_SIGMA_PLANE = 2.2789  # chi-square of two, 68 %


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
    figure, axes = panels("Figures 3-5: the filter at single steps, with its 68 % ellipse", 2, 3, (10.5, 7.0))
    F = wiener_acceleration(DT, DENSITY).F
    for axis, step in zip(axes.flat, SHOWN, strict=True):
        k = step - 1
        axis.plot(*runs.measured[: k + 1, 0, :2].T, ".", color=COLOURS["raw"], markersize=3, label="measured")
        axis.plot(*runs.truth[:, 0, :2].T, color="black", linewidth=0.8, label="real")
        axis.plot(*runs.mean[: k + 1, 0, :2].T, "--", color=COLOURS["ukf"], label="filtered")
        mean = runs.mean[k, 0]
        axis.plot(*_ellipse(mean[:2], runs.covariance[k, :2, :2]), color=COLOURS["ukf"], linewidth=0.8)
        axis.plot(*mean[:2], "o", color=COLOURS["ukf"], markersize=4)
        axis.plot(*(F @ mean)[:2], "o", color=COLOURS["ekf"], fillstyle="none", label="predicted next")
        axis.set_title(f"step {step}", loc="left", fontsize=9)
        _label_axes(axis, "m")
    legend(figure, axes[0, 0])
    return figure


def _ellipse(centre: Array, covariance: Array) -> Array:
    angle = np.linspace(0, 2 * np.pi, 60)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    return np.asarray(centre[:, None] + np.sqrt(ONE_SIGMA_PLANE) * np.linalg.cholesky(covariance) @ circle)


def _label_axes(axis: Axes, unit: str) -> None:
    axis.set_xlabel(f"x, {unit}")
    axis.set_ylabel(f"y, {unit}")
