"""Measurements of the leader into the camera's image, in pixels."""

import numpy as np

from onboard.arrays import Array
from onboard.geometry.camera import Camera, pixels_from_points
from onboard.messages import MeasurementReport
from onboard.view import palette, scene, words
from onboard.view.columns import Columns, ImagePoints, circles, image_points, labels, lines_2d
from onboard.view.memory import Memory
from onboard.view.motion import LeaderArrays, range_estimate

IMAGE_HZ = 25.0
MAGNIFICATION = 5.0
STALE_NS = 300_000_000  # without an image for this long, the last one is cleared
NO_POINTS = np.zeros((0, 2))


def pixels(points: tuple[tuple[float, float], ...] | None, camera: Camera) -> Array:
    """Image points as pixels (n, 2), (0, 2) if there are none; points that are not finite are left out."""
    if points is None or len(points) == 0:
        return NO_POINTS
    px = pixels_from_points(points, camera)
    return np.asarray(px[np.all(np.isfinite(px), axis=1)])


def wing(px: Array) -> Array:
    """The line left tip, centre, right tip of (centre, left, right) px (3, 2); nothing if a point is missing."""
    return px[[1, 0, 2]] if len(px) == 3 else NO_POINTS


def expected_error(camera: Camera, leader: LeaderArrays | None) -> float:
    """Three sigma of an image point's error, px: of pixel noise and of the position across the line of sight."""
    if leader is None:
        return scene.SIGMAS * camera.sigma_px
    r = range_estimate(leader)
    return scene.SIGMAS * float(np.hypot(camera.sigma_px, camera.f_px * r.sigma_across / max(r.range, 1e-3)))


def magnify(px: Array, centre: Array, camera: Camera) -> Array:
    """Pixels (n, 2) as the magnifier shows them, enlarged about `centre`; points outside it are left out."""
    x, y, w, h = scene.magnifier(camera)
    half = np.array([w, h]) / 2
    offset = MAGNIFICATION * (px - centre)
    inside = np.all(np.abs(offset) < half, axis=1)
    return np.asarray(offset[inside] + np.array([x, y]) + half)


def draw_points(
    columns: Columns, place: str, t_ns: int, measured: ImagePoints, predicted: Array, radius: float
) -> None:
    """Measured and predicted points and the wings between them, in the image or in the magnifier."""
    columns.add(image_points, f"{place}/measured", t_ns, measured)
    columns.add(lines_2d, f"{place}/measured_wing", t_ns, wing(measured.positions))
    columns.add(circles, f"{place}/predicted", t_ns, (predicted, radius))
    columns.add(lines_2d, f"{place}/predicted_wing", t_ns, wing(predicted))


def draw_image(
    columns: Columns, memory: Memory, camera: Camera, report: MeasurementReport, leader: LeaderArrays | None
) -> None:
    """The measured points, in the colour of the verdict, over the predicted ones."""
    t_ns = report.t_ns
    if not memory.due("image", t_ns, IMAGE_HZ):
        return
    colour, radius = palette.VERDICTS[report.verdict], expected_error(camera, leader)
    measured, predicted = pixels(report.points, camera), pixels(report.predicted_points, camera)
    draw_points(columns, scene.CAMERA, t_ns, ImagePoints(measured, colour), predicted, radius)
    centre = next((px[0] for px in (predicted, measured) if len(px)), np.zeros(2))
    close, expected = (magnify(px, centre, camera) for px in (measured, predicted))
    draw_points(columns, scene.MAGNIFIER, t_ns, ImagePoints(close, colour), expected, MAGNIFICATION * radius)
    draw_verdict(columns, camera, t_ns, colour, words.verdict_label(report))


def draw_verdict(columns: Columns, camera: Camera, t_ns: int, colour: palette.Colour, text: str) -> None:
    """The words at the top of the image."""
    place = np.array([[camera.width_px / 2, camera.height_px * 0.06]])
    columns.add(labels, f"{scene.CAMERA}/verdict", t_ns, ImagePoints(place, colour, text))


def clear_image(columns: Columns, memory: Memory, camera: Camera, t_ns: int) -> None:
    """No image: an empty frame that says so."""
    if not memory.due("no image", t_ns, 2.0):
        return
    for place in (scene.CAMERA, scene.MAGNIFIER):
        draw_points(columns, place, t_ns, ImagePoints(NO_POINTS, palette.GREY), NO_POINTS, 1.0)
    draw_verdict(columns, camera, t_ns, palette.AMBER, palette.NO_IMAGE.upper())
