"""The paper's figures 6 and 7, redrawn: image points, and the filter's measurements."""

from typing import Final

import numpy as np
from matplotlib.figure import Figure

from onboard.analysis.report.style import TRUTH_LINE, panels
from onboard.arrays import Array
from onboard.geometry.rotations import matrix_from_euler, matrix_from_quaternion
from onboard.models import camera_angles
from onboard.models.relative_motion import POSITION, SIZE, STATE_SIZE
from simlink.scenarios.camera import Camera
from studies.relative_motion.flight import Flight
from studies.report.drawing import legend

POINTS: Final = {"center": "#000000", "left wingtip": "#d55e00", "right wingtip": "#0072b2"}
ANGLES: Final = ("azimuth", "elevation", "subtended angle")
MEASURED: Final = "#0072b2"
DOTS: Final = {"linestyle": "none", "marker": ".", "markersize": 2.5}


def image_points(flight: Flight, camera: Camera) -> Figure:
    """Figure 6: the three points in the image, and whether an image was registered."""
    figure, axes = panels("Figure 6: image points, from the image's middle", 3, sharex=True, size=(7.2, 6.6))
    t, pixels = flight.image_t, camera.f_px * flight.image_points
    for axis, coordinate, name in zip(axes[:2, 0], range(2), ("to the right", "down"), strict=True):
        for point, (label, colour) in enumerate(POINTS.items()):
            axis.plot(t, pixels[:, point, coordinate], color=colour, label=label, **DOTS)
        axis.set_ylabel(f"{name}, px")
    registered = np.isfinite(flight.image_points).all(axis=(1, 2))
    flag = axes[2, 0]
    flag.step(t, registered, where="post", color="black", linewidth=0.6)
    flag.set_yticks([0, 1], ["none", "registered"])
    flag.set_ylim(-0.2, 1.2)
    flag.set_ylabel(f"images, {100 * registered.mean():.0f} % registered")
    flag.set_xlabel("time, s")
    flag.set_xlim(t[0], t[-1])
    legend(figure, axes[0, 0])
    return figure


def measured_angles(flight: Flight, camera: Camera) -> Figure:
    """Draw figure 7: the angles by eq 18 from image points, and those of the true leader by eq 14."""
    figure, axes = panels("Figure 7: the measurements of the filter", 3, sharex=True)
    measured, true = (
        np.degrees(x) for x in (camera_angles.angles_from_points(flight.image_points), true_angles(flight, camera))
    )
    for i, (axis, name) in enumerate(zip(axes[:, 0], ANGLES, strict=True)):
        axis.plot(flight.image_t, measured[:, i], color=MEASURED, label="from the image points", **DOTS)
        axis.plot(flight.image_t, true[:, i], label="true leader, wing across the sight", **TRUTH_LINE)
        axis.set_ylabel(f"{name}, °")
    axes[-1, 0].set_xlabel("time, s")
    axes[-1, 0].set_xlim(flight.image_t[0], flight.image_t[-1])
    legend(figure, axes[0, 0])
    return figure


def true_angles(flight: Flight, camera: Camera) -> Array:
    """Return the angles (M, 3), rad, of the true leader by eq 14, with its wing across the sight."""
    truth = flight.image_truth
    rows = np.zeros((len(flight.image_t), 1, STATE_SIZE))
    rows[:, 0, POSITION], rows[:, 0, SIZE] = truth.r_FL_n, flight.size
    R_nb = matrix_from_quaternion(truth.q_nF)
    R_cn = matrix_from_euler(*np.radians(camera.mount_rpy_deg)).T @ np.swapaxes(R_nb, 1, 2)
    return camera_angles.measure_batch(rows, R_cn, R_nb @ np.array(camera.mount_offset))[:, 0]
