"""Drawing of the leader's measurements in the camera's image, in pixels."""

import numpy as np

from onboard.arrays import Array
from onboard.geometry.camera import Camera, pixels_from_points
from onboard.messages import MeasurementReport
from onboard.view import palette, scene, words
from onboard.view.columns import Columns, ImagePoints, circles, image_points, labels, lines_2d
from onboard.view.memory import DRAW_RATE_HZ, Memory
from onboard.view.motion import LeaderArrays, range_estimate

MAGNIFIER_SCALE = 5.0
IMAGE_TIMEOUT_NS = 300_000_000  # the last image is cleared after this
NO_IMAGE_POINTS = np.zeros((0, 2))


def pixels(points: tuple[tuple[float, float], ...] | None, camera: Camera) -> Array:
    """Convert image points to pixels (n, 2) and drop those that are not finite."""
    if points is None or len(points) == 0:
        return NO_IMAGE_POINTS
    px = pixels_from_points(points, camera)
    return np.asarray(px[np.all(np.isfinite(px), axis=1)])


def wing(px: Array) -> Array:
    """Return the line left tip, centre, right tip of (centre, left, right) px (3, 2), or no points."""
    return px[[1, 0, 2]] if len(px) == 3 else NO_IMAGE_POINTS


def expected_error(camera: Camera, leader: LeaderArrays | None) -> float:
    """Return three sigma of an image point's error, px.

    It contains pixel noise and the position error across the line of sight.
    """
    if leader is None:
        return scene.DRAWN_SIGMAS * camera.sigma_px
    r = range_estimate(leader)
    return scene.DRAWN_SIGMAS * float(np.hypot(camera.sigma_px, camera.f_px * r.sigma_across / max(r.range, 1e-3)))


def magnify(px: Array, centre: Array, camera: Camera) -> Array:
    """Enlarge pixels (n, 2) about `centre` for the magnifier, without those outside it."""
    x, y, w, h = scene.magnifier(camera)
    half = np.array([w, h]) / 2
    offset = MAGNIFIER_SCALE * (px - centre)
    inside = np.all(np.abs(offset) < half, axis=1)
    return np.asarray(offset[inside] + np.array([x, y]) + half)


def draw_points(
    columns: Columns, place: str, t_ns: int, measured: ImagePoints, predicted: Array, radius: float
) -> None:
    """Draw measured and predicted points and the wings between them, in image or magnifier."""
    columns.add(image_points, f"{place}/measured", t_ns, measured)
    columns.add(lines_2d, f"{place}/measured_wing", t_ns, wing(measured.positions))
    columns.add(circles, f"{place}/predicted", t_ns, (predicted, radius))
    columns.add(lines_2d, f"{place}/predicted_wing", t_ns, wing(predicted))


def draw_image(
    columns: Columns, memory: Memory, camera: Camera, report: MeasurementReport, leader: LeaderArrays | None
) -> None:
    """Draw the measured points, in the colour of the verdict, over the predicted ones."""
    t_ns = report.t_ns
    if not memory.is_due("image", t_ns, DRAW_RATE_HZ):
        return
    colour, radius = palette.VERDICTS[report.verdict], expected_error(camera, leader)
    measured, predicted = pixels(report.points, camera), pixels(report.predicted_points, camera)
    draw_points(columns, scene.CAMERA, t_ns, ImagePoints(measured, colour), predicted, radius)
    centre = next((px[0] for px in (predicted, measured) if len(px)), np.zeros(2))
    close, expected = (magnify(px, centre, camera) for px in (measured, predicted))
    draw_points(columns, scene.MAGNIFIER, t_ns, ImagePoints(close, colour), expected, MAGNIFIER_SCALE * radius)
    draw_verdict(columns, camera, t_ns, colour, words.verdict_label(report))


def draw_verdict(columns: Columns, camera: Camera, t_ns: int, colour: palette.Colour, text: str) -> None:
    """Draw the text at the top of the image."""
    place = np.array([[camera.width_px / 2, camera.height_px * 0.06]])
    columns.add(labels, f"{scene.CAMERA}/verdict", t_ns, ImagePoints(place, colour, text))


def clear_image(columns: Columns, memory: Memory, camera: Camera, t_ns: int) -> None:
    """Draw an empty frame with a label that there is no image."""
    if not memory.is_due("no image", t_ns, 2.0):
        return
    for place in (scene.CAMERA, scene.MAGNIFIER):
        draw_points(columns, place, t_ns, ImagePoints(NO_IMAGE_POINTS, palette.GREY), NO_IMAGE_POINTS, 1.0)
    draw_verdict(columns, camera, t_ns, palette.AMBER, palette.NO_IMAGE_VERDICT.upper())
