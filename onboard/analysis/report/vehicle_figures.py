"""Figures of the vehicle itself. Needs the extra `study` (Matplotlib)."""

import math
from collections.abc import Callable
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from onboard.analysis.report.figures import BAD, GREY, LEADER, OWN, thin
from onboard.analysis.report.style import STYLE, panels
from onboard.analysis.report.vehicle import MAX_DRAWN_OUTPUTS, VehicleSeries
from onboard.arrays import Array

FIX_TYPE_3D: Final = 3  # MAVLink GPS_FIX_TYPE
DEGREE_LENGTH_M: Final = 111_195.0  # of latitude, on the sphere of the Earth's mean radius
SCALES_M: Final = tuple(n * 10**k for k in range(6) for n in (1, 2, 5))
BODY_AXIS_NAMES: Final = ("forward", "right", "down")


def vehicle_figures(vehicle: VehicleSeries) -> dict[str, Figure]:
    """Figures by their titles; those without data are left out."""
    rows: list[tuple[Array, Callable[[Any, Array], None]]] = [
        (thin(vehicle.battery.table()), _battery),
        (thin(vehicle.outputs.table()), _motors),
        (thin(vehicle.vibration.table()), _vibration),
    ]
    shown = [(table, draw) for table, draw in rows if len(table)]
    found: dict[str, Figure] = {}
    gps = thin(vehicle.gps.table())
    with mpl.rc_context(STYLE):
        if shown:
            figure, axes = panels("", len(shown), size=(7.2, 0.6 + 1.7 * len(shown)), sharex=True)
            for axis, (table, draw) in zip(axes[:, 0], shown, strict=True):
                draw(axis, table)
            axes[-1, 0].set_xlabel("time since the autopilot's start, s")
            found["The vehicle: battery, motors, vibration"] = figure
        if len(gps):
            found["GPS"] = _gps(gps)
        if (gps[:, 1] >= FIX_TYPE_3D).any():
            found["Map, north up"] = _map(gps[gps[:, 1] >= FIX_TYPE_3D])
    return found


def _battery(axis: Any, table: Array) -> None:
    axis.plot(table[:, 0], table[:, 1], color=OWN)
    axis.set(ylabel="battery, V")


def _motors(axis: Any, table: Array) -> None:
    for k in range(MAX_DRAWN_OUTPUTS):
        if np.isfinite(table[:, 1 + k]).any():
            axis.plot(table[:, 0], table[:, 1 + k], linewidth=0.7, label=str(k + 1))
    axis.set(ylabel="outputs, µs")
    if axis.lines:
        axis.legend(loc="best", fontsize=7, ncols=MAX_DRAWN_OUTPUTS)


def _vibration(axis: Any, table: Array) -> None:
    for k, (name, colour) in enumerate(zip(BODY_AXIS_NAMES, (OWN, LEADER, GREY), strict=True)):
        axis.plot(table[:, 0], table[:, 1 + k], color=colour, label=name)
    axis.set(ylabel="vibration, m/s²")
    axis.legend(loc="best", fontsize=7, ncols=3)


def _gps(table: Array) -> Figure:
    """Satellites, times without a 3-D fix, and the accuracies that the receiver states."""
    figure, axes = panels("", 2, size=(7.2, 3.6), sharex=True)
    above, below = axes[:, 0]
    above.plot(table[:, 0], table[:, 2], color=OWN, label="satellites")
    lost = table[table[:, 1] < FIX_TYPE_3D]
    if len(lost):
        above.plot(lost[:, 0], np.zeros(len(lost)), "|", color=BAD, label="no 3-D fix")
    for column, name, colour in ((3, "horizontal", OWN), (4, "vertical", LEADER)):
        below.plot(table[:, 0], table[:, column], color=colour, label=name)
    below.set(xlabel="time since the autopilot's start, s", ylabel="accuracy, m")
    for axis in (above, below):
        axis.legend(loc="best", fontsize=8, ncols=2)
    return figure


def _map(table: Array) -> Figure:
    """Map of the fixes with a scale, and without tiles, which need a network."""
    figure, axes = panels("", 1, size=(7.2, 4.6))
    axis, lat, lon = axes[0, 0], table[:, 5], table[:, 6]
    narrow = max(math.cos(math.radians(float(lat.mean()))), 1e-3)
    axis.plot(lon, lat, color=OWN, label="GPS fixes")
    axis.plot(lon[0], lat[0], "o", color=OWN, markersize=5, label="the first")
    axis.set_aspect(1.0 / narrow, adjustable="datalim")
    axis.ticklabel_format(useOffset=False)
    size_m = DEGREE_LENGTH_M * max(float(np.ptp(lat)), narrow * float(np.ptp(lon)), 1e-5)
    length_m = max((scale for scale in SCALES_M if scale < 0.5 * size_m), default=SCALES_M[0])
    east = float(lon.min()) + np.array([0.0, length_m / (DEGREE_LENGTH_M * narrow)])
    axis.plot(east, [float(lat.min()) - 0.05 * size_m / DEGREE_LENGTH_M] * 2, color="black", label=f"{length_m} m")
    axis.set(xlabel="longitude, degrees", ylabel="latitude, degrees")
    axis.legend(loc="best", fontsize=8)
    return figure
