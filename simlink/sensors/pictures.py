"""Drawn camera images: a shaded aircraft or an AprilTag before sky and ground.

They have noise and blur, and need OpenCV (`pip install opencv-python-headless`). The aircraft's parts are boxes in
body axes, in wingspans. Each is drawn as the convex hull of its corners, the farthest first, at four times the
image's resolution.
"""

import math
from collections.abc import Callable, Mapping
from typing import Final

import numpy as np
import numpy.typing as npt

from onboard.geometry.rotations import matrix_from_quaternion
from onboard.messages import Clock, DetectedPoint, Detection, Picture
from simlink.scenarios.camera import Camera
from simlink.sensors.camera import Image, Mount, Points, mount_quaternion
from simlink.world.truth import State

Grey = npt.NDArray[np.uint8]
Find = Callable[[Grey], Mapping[str, tuple[float, float, float]] | None]
Fine = npt.NDArray[np.float32]
Array = npt.NDArray[np.float64]

SUBPIXEL_FACTOR: Final = 4  # subpixels per pixel and axis
MIN_DEPTH: Final = 1.0  # m; nearer parts are not drawn
BLUR_SIGMA_PX: Final = 0.7  # of the lens
JPEG_QUALITY_PERCENT: Final = 92  # a picture has about 60 kB
NOISE_SIGMA: Final = 3.0  # grey levels
SKY_LEVELS: Final = (170.0, 220.0)  # grey at the horizon and overhead
GROUND_LEVEL: Final = 105.0
TAG_ID: Final = 0  # in the family 36h11
BOARD_LEVEL: Final = 235.0
BOARD_RATIO: Final = 1.25  # side of the white board over that of the tag

NO_POINTS: Final[Points] = ((0.0, 0.0),) * 3  # of an image with detections these are not sent
TIP_CHORD_RATIO: Final = 0.15  # chord of the wing at its tip over that at its root
# name: middle (forward, right, down), size along these axes, grey
PARTS: Final = {
    "fuselage": ((0.0, 0.0, 0.0), (0.75, 0.10, 0.10), 55),
    "wing": ((0.0, 0.0, 0.0), (0.16, 1.0, 0.028), 40),
    "tailplane": ((-0.36, 0.0, 0.0), (0.10, 0.34, 0.02), 48),
    "fin": ((-0.36, 0.0, -0.09), (0.12, 0.02, 0.16), 62),
}


class PictureError(Exception):
    """Pictures cannot be drawn here; the message is one line with a remedy."""


def picture_detector(find: Find, painter: "Painter") -> Callable[[State, int], Image | None]:
    """Return a detector of drawn pictures that replaces the scenario's own.

    `find` returns the points of a picture by name, each (u, v, sigma) in px.
    """

    def detect(state: State, stamp_ns: int) -> Image | None:
        found = find(painter.paint(state))
        if found is None:
            return None
        points = {name: DetectedPoint(u_px=u, v_px=v, sigma_px=sigma) for name, (u, v, sigma) in found.items()}
        return Image(stamp_ns, NO_POINTS, (Detection(points=points, target="leader"),))

    return detect


class Painter:
    """The painter of one run: call `paint` for each picture, in order.

    `size` is the leader's wingspan or the side of its tag (m); `mount` gives q_bc of a moving mount.
    """

    def __init__(self, camera: Camera, size: float, seed: int, mount: Mount | None = None) -> None:
        try:
            import cv2  # noqa: PLC0415 - an extra
        except ImportError as error:
            raise PictureError("pictures need OpenCV; run `pip install opencv-python-headless`") from error
        self._cv2, self._camera, self._size = cv2, camera, size
        self._random = np.random.default_rng((seed, 0x71C))
        self._mount = mount or (lambda _: mount_quaternion(camera))
        width, height = round(camera.width_px), round(camera.height_px)
        u, v = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
        rays = np.stack([np.full(u.shape, camera.f_px), u - width / 2, v - height / 2])
        self._rays = rays / np.linalg.norm(rays, axis=0)
        dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
        self._tag = cv2.aruco.generateImageMarker(dictionary, TAG_ID, 10 * SUBPIXEL_FACTOR)

    def paint(self, state: State) -> Grey:
        """Return the camera's grey image of a state of the world."""
        R_nc = matrix_from_quaternion(state.q_nF) @ matrix_from_quaternion(self._mount(state))
        eye = np.array(state.r_OF_n) + matrix_from_quaternion(state.q_nF) @ np.array(self._camera.mount_offset)
        grey = self._background(R_nc)
        r_c = R_nc.T @ (np.array(state.r_OL_n) - eye)
        R_cL = R_nc.T @ matrix_from_quaternion(state.q_nL)
        if r_c[0] > MIN_DEPTH:
            self._draw(grey, r_c, R_cL)
        soft = self._cv2.GaussianBlur(grey, (0, 0), BLUR_SIGMA_PX)
        noisy = soft + NOISE_SIGMA * self._random.standard_normal(soft.shape, dtype=np.float32)
        return np.asarray(np.clip(noisy, 0, 255), dtype=np.uint8)

    def picture(self, state: State, t_ns: int) -> Picture:
        """Return the image as a JPEG record; `t_ns` is the time since boot."""
        _, jpeg = self._cv2.imencode(
            ".jpg", self.paint(state), [self._cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY_PERCENT]
        )
        return Picture(t_ns=t_ns, clock=Clock.BOOT, camera=self._camera.name, jpeg=jpeg.tobytes())

    def _background(self, R_nc: Array) -> Fine:
        """Return the sky, brighter overhead, above the horizon, and the ground below it."""
        down = np.tensordot(R_nc[2], self._rays, 1)
        horizon, top = SKY_LEVELS
        sky = horizon + (top - horizon) * np.clip(-2.0 * down, 0.0, 1.0)
        return np.where(down < 0.0, sky, GROUND_LEVEL + 15.0 * np.exp(-8.0 * np.abs(down))).astype(np.float32)

    def _draw(self, grey: Fine, r_c: Array, R_cL: Array) -> None:
        """Draw the leader into the picture, through a window of finer resolution around it."""
        half = math.ceil(self._camera.f_px * self._size / r_c[0]) + 4
        u, v = self._pixel(r_c)
        left, upper = max(math.floor(u) - half, 0), max(math.floor(v) - half, 0)
        window = grey[upper : math.floor(v) + half, left : math.floor(u) + half]
        if min(window.shape, default=0) < 2 or min(math.floor(u) + half, math.floor(v) + half) <= 0:
            return
        fine = np.kron(window, np.ones((SUBPIXEL_FACTOR, SUBPIXEL_FACTOR), dtype=np.float32))
        corner = np.array([left, upper], dtype=float)
        if self._camera.pictures == "tag":
            self._draw_tag(fine, r_c, R_cL, corner)
        else:
            self._draw_aircraft(fine, r_c, R_cL, corner)
        rows, columns = window.shape
        window[:] = fine.reshape(rows, SUBPIXEL_FACTOR, columns, SUBPIXEL_FACTOR).mean(axis=(1, 3))

    def _draw_aircraft(self, fine: Fine, r_c: Array, R_cL: Array, corner: Array) -> None:
        drawn = []
        for name, (middle, size, shade) in PARTS.items():
            signs = np.array(np.meshgrid(*[(-0.5, 0.5)] * 3)).reshape(3, -1)
            corners = np.array(middle)[:, None] + np.array(size)[:, None] * signs
            if name == "wing":  # tapered, from a long root to short tips
                corners = np.column_stack(
                    [corners * [[TIP_CHORD_RATIO], [1.0], [1.0]], corners * [[1.0], [0.0], [1.0]]]
                )
            corners = r_c[:, None] + R_cL @ (self._size * corners)
            drawn.append((float(corners[0].mean()), corners, shade))
        for _, corners, shade in sorted(drawn, key=lambda part: -part[0]):
            if corners[0].min() > MIN_DEPTH:
                pixels = self._finer(np.column_stack(self._pixel(corners)), corner)
                hull = self._cv2.convexHull(pixels.astype(np.float32))
                _fill(fine, np.asarray(hull, dtype=float).reshape(-1, 2), shade)

    def _draw_tag(self, fine: Fine, r_c: Array, R_cL: Array, corner: Array) -> None:
        """Draw a board across the body's forward axis, as seen from behind."""
        half = 0.5 * self._size
        square = np.array([(0.0, -half, -half), (0.0, half, -half), (0.0, half, half), (0.0, -half, half)]).T
        board = r_c[:, None] + R_cL @ (BOARD_RATIO * square)
        tag = r_c[:, None] + R_cL @ square
        if min(board[0].min(), tag[0].min()) <= MIN_DEPTH:
            return
        outline = self._finer(np.column_stack(self._pixel(board)), corner)
        _fill(fine, outline, BOARD_LEVEL)
        n = self._tag.shape[0]
        source = np.array([(0, 0), (n, 0), (n, n), (0, n)], dtype=np.float32) - 0.5
        target = self._finer(np.column_stack(self._pixel(tag)), corner).astype(np.float32)
        turned = self._cv2.getPerspectiveTransform(source, target)
        size = fine.shape[1], fine.shape[0]
        shade = self._cv2.warpPerspective(
            self._tag.astype(np.float32), turned, size, flags=self._cv2.INTER_NEAREST
        )
        inside = self._cv2.warpPerspective(np.ones((n, n), np.uint8), turned, size, flags=self._cv2.INTER_NEAREST)
        fine[inside > 0] = 30.0 + 0.8 * shade[inside > 0]

    def _pixel(self, r_c: Array) -> tuple[Array, Array]:
        """Return u and v of positions (3, ...) in c, from the upper left corner of the image."""
        camera = self._camera
        return (
            camera.width_px / 2 + camera.f_px * r_c[1] / r_c[0],
            camera.height_px / 2 + camera.f_px * r_c[2] / r_c[0],
        )

    def _finer(self, pixels: Array, corner: Array) -> Array:
        """Return pixels as indices of the window's subpixels, whose centres are whole numbers."""
        return np.asarray(SUBPIXEL_FACTOR * (pixels - corner) - 0.5)


def _fill(fine: Fine, polygon: Array, grey: float) -> None:
    """Fill a convex polygon (n, 2) of either orientation.

    OpenCV's function would also fill the pixels that its edges touch.
    """
    low = np.maximum(np.floor(polygon.min(axis=0)).astype(int), 0)
    high = np.minimum(np.ceil(polygon.max(axis=0)).astype(int) + 1, np.array(fine.shape)[::-1])
    if (high <= low).any():
        return
    u, v = np.meshgrid(np.arange(low[0], high[0]), np.arange(low[1], high[1]))
    following = np.roll(polygon, -1, axis=0)
    sides = [(b - a)[0] * (v - a[1]) - (b - a)[1] * (u - a[0]) for a, b in zip(polygon, following, strict=True)]
    inside = np.all(np.array(sides) >= 0.0, axis=0) | np.all(np.array(sides) <= 0.0, axis=0)
    fine[low[1] : high[1], low[0] : high[0]][inside] = grey
