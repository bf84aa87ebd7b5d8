"""Measurements into the camera's image, in pixels."""

import numpy as np

from onboard.geometry.camera import Camera, pixels_from_points
from onboard.geometry.rotations import Array
from onboard.messages import MeasurementReport
from onboard.view import palette, words
from onboard.view.columns import Columns, Spots, circles, labels, lines_2d, spots
from onboard.view.memory import Memory
from onboard.view.motion import Track, sight
from onboard.view.scene import CAMERA, SIGMAS

STALE_NS = 300_000_000  # without an image for this long, the last one is taken down
EMPTY = np.zeros((0, 2))


def pixels(points: tuple[tuple[float, float], ...] | None, camera: Camera) -> Array:
    """Image points as pixels (n, 2), (0, 2) if there are none; what is not finite is left out."""
    if points is None or len(points) == 0:
        return EMPTY
    px = pixels_from_points(points, camera)
    return np.asarray(px[np.all(np.isfinite(px), axis=1)])


def wing(px: Array) -> Array:
    """The line left tip, centre, right tip of (centre, left, right) px (3, 2); nothing if a point is missing."""
    return px[[1, 0, 2]] if len(px) == 3 else EMPTY


def expected_error(camera: Camera, track: Track | None) -> float:
    """Radius in px of what SIGMAS sigma allow a point of the image to be off: pixel noise and the track's."""
    if track is None:
        return SIGMAS * camera.sigma_px
    seen = sight(track)
    return SIGMAS * float(np.hypot(camera.sigma_px, camera.f_px * seen.sigma_across / max(seen.range, 1e-3)))


def draw_image(
    columns: Columns, memory: Memory, camera: Camera, report: MeasurementReport, track: Track | None
) -> None:
    """What the camera measured, in the colour of the verdict, over what was expected."""
    t_ns = report.t_ns
    if not memory.due("image", t_ns, 25.0):
        return
    colour = palette.VERDICTS[report.verdict]
    measured, predicted = pixels(report.points, camera), pixels(report.predicted_points, camera)
    columns.add(spots, f"{CAMERA}/measured", t_ns, Spots(measured, colour))
    columns.add(lines_2d, f"{CAMERA}/measured_wing", t_ns, wing(measured))
    columns.add(circles, f"{CAMERA}/predicted", t_ns, (predicted, expected_error(camera, track)))
    columns.add(lines_2d, f"{CAMERA}/predicted_wing", t_ns, wing(predicted))
    place = np.array([[camera.width_px / 2, camera.height_px * 0.06]])
    columns.add(labels, f"{CAMERA}/verdict", t_ns, Spots(place, colour, words.verdict_label(report)))


def clear_image(columns: Columns, memory: Memory, camera: Camera, t_ns: int) -> None:
    """No image: an empty frame that says so."""
    if not memory.due("no image", t_ns, 2.0):
        return
    columns.add(spots, f"{CAMERA}/measured", t_ns, Spots(EMPTY, palette.GREY))
    columns.add(circles, f"{CAMERA}/predicted", t_ns, (EMPTY, 1.0))
    for name in ("measured_wing", "predicted_wing"):
        columns.add(lines_2d, f"{CAMERA}/{name}", t_ns, EMPTY)
    place = np.array([[camera.width_px / 2, camera.height_px * 0.06]])
    columns.add(labels, f"{CAMERA}/verdict", t_ns, Spots(place, palette.AMBER, palette.NO_IMAGE.upper()))
