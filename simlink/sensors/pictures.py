"""What the camera sees, drawn: a shaded aircraft, or a board with an AprilTag, before sky and ground, with noise
and blur. It needs OpenCV (`pip install opencv-python-headless`).

The aircraft's parts are boxes in body axes, in wingspans; each is drawn as the convex hull of its corners, the
farthest first, four times as fine as the image.
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

FINER: Final = 4  # subpixels of a pixel
NEAREST: Final = 1.0  # m: what is nearer is not drawn
BLUR_PX: Final = 0.7  # standard deviation of the lens's blur
QUALITY: Final = 92  # of JPEG: a picture has some 60 kB
NOISE: Final = 3.0  # grey levels
SKY: Final = (170.0, 220.0)  # grey at the horizon and overhead
GROUND: Final = 105.0
TAG: Final = 0  # the number of the tag, of the family 36h11
BOARD: Final = 235.0
TAG_MARGIN: Final = 1.25  # the white board, in sides of the tag

NO_POINTS: Final[Points] = ((0.0, 0.0),) * 3  # of an image with detections these are not sent
TIP: Final = 0.15  # of the wing's chord at its root
# name: middle (forward, right, down), size along these axes, grey
PARTS: Final = {
    "fuselage": ((0.0, 0.0, 0.0), (0.75, 0.10, 0.10), 55),
    "wing": ((0.0, 0.0, 0.0), (0.16, 1.0, 0.028), 40),
    "tailplane": ((-0.36, 0.0, 0.0), (0.10, 0.34, 0.02), 48),
    "fin": ((-0.36, 0.0, -0.09), (0.12, 0.02, 0.16), 62),
}


class PictureError(Exception):
    """Pictures cannot be drawn here; one line with a remedy."""


def seen_by(find: Find, painter: "Painter") -> Callable[[State, int], Image | None]:
    """A detector of drawn pictures in place of the scenario's own, in simulated time. `find` gives the points of a
    picture by name, each (u, v, sigma) in px."""

    def see(state: State, stamp_ns: int) -> Image | None:
        found = find(painter.paint(state))
        if found is None:
            return None
        points = {name: DetectedPoint(u_px=u, v_px=v, sigma_px=sigma) for name, (u, v, sigma) in found.items()}
        return Image(stamp_ns, NO_POINTS, (Detection(points=points, target="leader"),))

    return see


class Painter:
    """Pictures of one run: `paint` each, in order. `size`: the leader's wingspan, or the side of its tag, m;
    `mount`: q_bc of a moving mount."""

    def __init__(self, camera: Camera, size: float, seed: int, mount: Mount | None = None) -> None:
        try:
            import cv2  # noqa: PLC0415 - an extra
        except ImportError as error:
            raise PictureError("pictures need OpenCV: pip install opencv-python-headless") from error
        self._cv2, self._camera, self._size = cv2, camera, size
        self._random = np.random.default_rng((seed, 0x71C))
        self._mount = mount or (lambda _: mount_quaternion(camera))
        width, height = round(camera.width_px), round(camera.height_px)
        u, v = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
        rays = np.stack([np.full(u.shape, camera.f_px), u - width / 2, v - height / 2])
        self._rays = rays / np.linalg.norm(rays, axis=0)
        dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
        self._tag = cv2.aruco.generateImageMarker(dictionary, TAG, 10 * FINER)

    def paint(self, state: State) -> Grey:
        """What the camera sees of a state of the world."""
        R_nc = matrix_from_quaternion(state.q_nF) @ matrix_from_quaternion(self._mount(state))
        eye = np.array(state.r_OF_n) + matrix_from_quaternion(state.q_nF) @ np.array(self._camera.mount_offset)
        grey = self._background(R_nc)
        r_c = R_nc.T @ (np.array(state.r_OL_n) - eye)
        R_cL = R_nc.T @ matrix_from_quaternion(state.q_nL)
        if r_c[0] > NEAREST:
            self._draw(grey, r_c, R_cL)
        soft = self._cv2.GaussianBlur(grey, (0, 0), BLUR_PX)
        noisy = soft + NOISE * self._random.standard_normal(soft.shape, dtype=np.float32)
        return np.asarray(np.clip(noisy, 0, 255), dtype=np.uint8)

    def picture(self, state: State, t_ns: int) -> Picture:
        """The same as a record; `t_ns` is the time since boot."""
        _, jpeg = self._cv2.imencode(".jpg", self.paint(state), [self._cv2.IMWRITE_JPEG_QUALITY, QUALITY])
        return Picture(t_ns=t_ns, clock=Clock.BOOT, camera=self._camera.name, jpeg=jpeg.tobytes())

    def _background(self, R_nc: Array) -> Fine:
        """Sky above the horizon, brighter overhead, and ground below it."""
        down = np.tensordot(R_nc[2], self._rays, 1)
        horizon, top = SKY
        sky = horizon + (top - horizon) * np.clip(-2.0 * down, 0.0, 1.0)
        return np.where(down < 0.0, sky, GROUND + 15.0 * np.exp(-8.0 * np.abs(down))).astype(np.float32)

    def _draw(self, grey: Fine, r_c: Array, R_cL: Array) -> None:
        """Draw the leader into the picture, in a window around it that is finer than the picture."""
        half = math.ceil(self._camera.f_px * self._size / r_c[0]) + 4
        u, v = self._pixel(r_c)
        left, upper = max(math.floor(u) - half, 0), max(math.floor(v) - half, 0)
        window = grey[upper : math.floor(v) + half, left : math.floor(u) + half]
        if min(window.shape, default=0) < 2 or min(math.floor(u) + half, math.floor(v) + half) <= 0:
            return
        fine = np.kron(window, np.ones((FINER, FINER), dtype=np.float32))
        corner = np.array([left, upper], dtype=float)
        if self._camera.pictures == "tag":
            self._draw_tag(fine, r_c, R_cL, corner)
        else:
            self._draw_aircraft(fine, r_c, R_cL, corner)
        rows, columns = window.shape
        window[:] = fine.reshape(rows, FINER, columns, FINER).mean(axis=(1, 3))

    def _draw_aircraft(self, fine: Fine, r_c: Array, R_cL: Array, corner: Array) -> None:
        drawn = []
        for name, (middle, size, shade) in PARTS.items():
            signs = np.array(np.meshgrid(*[(-0.5, 0.5)] * 3)).reshape(3, -1)
            corners = np.array(middle)[:, None] + np.array(size)[:, None] * signs
            if name == "wing":  # tapered, from a long root to short tips
                corners = np.column_stack([corners * [[TIP], [1.0], [1.0]], corners * [[1.0], [0.0], [1.0]]])
            corners = r_c[:, None] + R_cL @ (self._size * corners)
            drawn.append((float(corners[0].mean()), corners, shade))
        for _, corners, shade in sorted(drawn, key=lambda part: -part[0]):
            if corners[0].min() > NEAREST:
                pixels = self._finer(np.column_stack(self._pixel(corners)), corner)
                hull = self._cv2.convexHull(pixels.astype(np.float32))
                _fill(fine, np.asarray(hull, dtype=float).reshape(-1, 2), shade)

    def _draw_tag(self, fine: Fine, r_c: Array, R_cL: Array, corner: Array) -> None:
        """A board across the body's forward axis, as it is seen from behind."""
        half = 0.5 * self._size
        square = np.array([(0.0, -half, -half), (0.0, half, -half), (0.0, half, half), (0.0, -half, half)]).T
        board = r_c[:, None] + R_cL @ (TAG_MARGIN * square)
        tag = r_c[:, None] + R_cL @ square
        if min(board[0].min(), tag[0].min()) <= NEAREST:
            return
        outline = self._finer(np.column_stack(self._pixel(board)), corner)
        _fill(fine, outline, BOARD)
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
        """u and v of positions (3, ...) in c; the upper left corner of the image is (0, 0)."""
        camera = self._camera
        return (
            camera.width_px / 2 + camera.f_px * r_c[1] / r_c[0],
            camera.height_px / 2 + camera.f_px * r_c[2] / r_c[0],
        )

    def _finer(self, pixels: Array, corner: Array) -> Array:
        """Pixels as indices of the window's subpixels, whose middles are whole numbers."""
        return np.asarray(FINER * (pixels - corner) - 0.5)


def _fill(fine: Fine, polygon: Array, grey: float) -> None:
    """Fill a convex polygon (n, 2), whichever way round it is. OpenCV's would also fill what its edges touch."""
    low = np.maximum(np.floor(polygon.min(axis=0)).astype(int), 0)
    high = np.minimum(np.ceil(polygon.max(axis=0)).astype(int) + 1, np.array(fine.shape)[::-1])
    if (high <= low).any():
        return
    u, v = np.meshgrid(np.arange(low[0], high[0]), np.arange(low[1], high[1]))
    following = np.roll(polygon, -1, axis=0)
    sides = [(b - a)[0] * (v - a[1]) - (b - a)[1] * (u - a[0]) for a, b in zip(polygon, following, strict=True)]
    inside = np.all(np.array(sides) >= 0.0, axis=0) | np.all(np.array(sides) <= 0.0, axis=0)
    fine[low[1] : high[1], low[0] : high[0]][inside] = grey
