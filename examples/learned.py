"""A detector: a small neural network that has learned to find an aircraft.

It needs NumPy, OpenCV and `onboard`, and weights that `examples/learned_train.py` makes:

    python examples/learned_train.py
    python examples/learned.py --connect tcp/127.0.0.1:7447

It has two convolutional networks. `where` takes the whole picture at reduced size and finds the cell with an
aircraft. `points` takes that part, at several assumed sizes and again at the best one, and locates the center and
both wingtips. Each may also answer "nowhere"; if either does, nothing is sent. `left` and `right` are sides of the
image, as the daemon expects them.
"""

import sys
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
from live import run_detector

WEIGHTS = Path("out/learned.npz")
NAMES = ("center", "left", "right")
WIDTH_PX = 160  # of a whole picture at reduced size
CROP_SIZE_PX = 64
CROP_RATIO = 1.6  # side of a part, in spans
SPANS = (24.0, 48.0, 96.0, 192.0)  # px: the sizes that are tried
MIN_SPAN_PX = 20.0  # smaller aircraft are treated as of this span
STRIDES = {"where": (2, 2, 2, 1, 1, 1), "points": (2, 2, 1, 1, 1, 1, 1)}  # of the layers of each network
KERNELS = {"where": (5, 3, 3, 3, 3, 1), "points": (5, 3, 3, 3, 3, 3, 1)}
CHANNELS = {"where": (1, 8, 16, 24, 24, 24, 1), "points": (1, 12, 24, 24, 24, 24, 24, 3)}
CELL = {"where": 8, "points": 4}  # px of a network's input for a cell of its output: the product of its strides
MIN_PROBABILITY = 0.5  # of an aircraft, for either network
GREY_SCALE = 40.0  # levels that count as 1

Point = tuple[float, float, float]
Array = npt.NDArray[np.float32]
Picture = npt.NDArray[np.uint8]


class Layer(NamedTuple):
    """A convolution's weights (rows, columns, channels in, channels out) and biases."""

    weights: Array
    biases: Array
    stride: int


Network = Sequence[Layer]


class Learned(NamedTuple):
    """The trained networks, and the standard deviation of a point (px of a crop)."""

    where: Network
    points: Network
    sigma: float


class Square(NamedTuple):
    """A part of a picture: its upper left corner and its side, px."""

    left: int
    top: int
    side: int


def columns(x: Array, layer: Layer) -> Array:
    """Return a convolution's input at each place of x (n, rows, columns, channels) as a row."""
    k, stride = layer.weights.shape[0], layer.stride
    rows, width = -(-x.shape[1] // stride), -(-x.shape[2] // stride)
    x = np.pad(x, ((0, 0), (k // 2, k // 2), (k // 2, k // 2), (0, 0)))
    parts = [
        x[:, i : i + stride * rows : stride, j : j + stride * width : stride] for i in range(k) for j in range(k)
    ]
    return np.concatenate(parts, axis=-1)


def run(network: Network, x: Array) -> Array:
    """Apply a network to pictures (n, rows, columns, 1)."""
    for k, layer in enumerate(network):
        x = columns(x, layer) @ layer.weights.reshape(-1, layer.weights.shape[-1]) + layer.biases
        if k + 1 < len(network):
            x = np.maximum(x, 0.0)
    return x


def shares(maps: Array) -> Array:
    """Return the probability of each point in each cell of maps (n, rows, columns, points).

    The remainder to 1 is the probability of nowhere, whose own logit is 0.
    """
    top = np.maximum(maps.max(axis=(1, 2), keepdims=True), 0.0)
    likely = np.exp(maps - top)
    return np.asarray(likely / (likely.sum(axis=(1, 2), keepdims=True) + np.exp(-top)))


def place(share: Array) -> tuple[float, float, float]:
    """Return column and row of a point in cells, and the probability that it is anywhere.

    The position is the mean over the cells around the likeliest. The upper left corner is (0, 0).
    """
    row, column = np.unravel_index(int(share.argmax()), share.shape)
    top, left = max(int(row) - 2, 0), max(int(column) - 2, 0)
    near = share[top : int(row) + 3, left : int(column) + 3]
    rows, cols = np.arange(top, top + near.shape[0]) + 0.5, np.arange(left, left + near.shape[1]) + 0.5
    whole = max(float(near.sum()), 1e-9)
    return float(near.sum(axis=0) @ cols) / whole, float(near.sum(axis=1) @ rows) / whole, float(share.sum())


def small(picture: Picture) -> Picture:
    """Return the whole picture as the input of `where`."""
    height = round(WIDTH_PX * picture.shape[0] / picture.shape[1])
    return np.asarray(cv2.resize(picture, (WIDTH_PX, height), interpolation=cv2.INTER_AREA), np.uint8)


def square(u: float, v: float, span: float) -> Square:
    """Return the part around a point (px) of an aircraft of this span (px)."""
    side = round(CROP_RATIO * max(span, MIN_SPAN_PX))
    return Square(round(u - side / 2), round(v - side / 2), side)


def cut(picture: Picture, part: Square) -> Picture:
    """Return a part of a picture, with repeated edge pixels outside."""
    rows = np.clip(np.arange(part.top, part.top + part.side), 0, picture.shape[0] - 1)
    cols = np.clip(np.arange(part.left, part.left + part.side), 0, picture.shape[1] - 1)
    how = cv2.INTER_AREA if part.side > CROP_SIZE_PX else cv2.INTER_LINEAR
    return np.asarray(
        cv2.resize(picture[np.ix_(rows, cols)], (CROP_SIZE_PX, CROP_SIZE_PX), interpolation=how), np.uint8
    )


def levels(pictures: Picture) -> Array:
    """Return pictures (n, rows, columns) minus their mean brightness, as a network's input."""
    x = pictures.astype(np.float32)
    return np.asarray((x - np.median(x, axis=(1, 2), keepdims=True))[..., None] / GREY_SCALE)


def look(learned: Learned, picture: Picture) -> tuple[Array, float, float] | None:
    """Find the aircraft in a picture; None without one.

    Returns center and wingtips (3, 2) in px, their sigma (px), and the probability of an aircraft.
    """
    share = shares(run(learned.where, levels(small(picture)[None])))
    column, row, likely = place(share[0, ..., 0])
    if likely < MIN_PROBABILITY:
        return None
    scale = CELL["where"] * picture.shape[1] / WIDTH_PX
    pixels, found, _ = closest(learned.points, picture, [square(scale * column, scale * row, x) for x in SPANS])
    if found < MIN_PROBABILITY:
        return None
    pixels, found, part = closest(learned.points, picture, [square(*middle_and_span(pixels))])
    likely = min(likely, found)
    return (pixels, learned.sigma * part.side / CROP_SIZE_PX, likely) if likely >= MIN_PROBABILITY else None


def closest(points: Network, picture: Picture, parts: Sequence[Square]) -> tuple[Array, float, Square]:
    """Locate center and wingtips (3, 2), px of the picture, in the part that shows them best.

    Also returns the probability of the least likely point, and that part.
    """
    maps = shares(run(points, levels(np.array([cut(picture, part) for part in parts]))))
    found = np.array([[place(share[..., k]) for k in range(3)] for share in maps], np.float32)
    best = int(found[..., 2].min(axis=1).argmax())
    corner, scale = (parts[best].left, parts[best].top), CELL["points"] * parts[best].side / CROP_SIZE_PX
    pixels = np.array(corner, np.float32) + np.float32(scale) * found[best, :, :2]
    return pixels, float(found[best, :, 2].min()), parts[best]


def middle_and_span(points: npt.ArrayLike) -> tuple[float, float, float]:
    """Return the centre of the extent of points (3, 2), and its larger side, px."""
    low, high = np.min(points, axis=0), np.max(points, axis=0)
    u, v = (low + high) / 2
    return float(u), float(v), float((high - low).max())


def load(path: Path) -> Learned:
    """Load the file that `examples/learned_train.py` has written. Raises OSError."""
    with np.load(path) as file:
        where, points = (
            [Layer(file[f"{name}_{k}_weights"], file[f"{name}_{k}_biases"], s) for k, s in enumerate(strides)]
            for name, strides in STRIDES.items()
        )
        return Learned(where, points, float(file["sigma"]))


@cache
def _loaded() -> Learned:
    try:
        return load(WEIGHTS)
    except OSError as error:
        sys.exit(f"no weights in {WEIGHTS} ({error}); make them: python examples/learned_train.py")


def find(picture: Picture) -> dict[str, Point] | None:
    """Return center and wingtips, each (u, v, sigma) in pixels, or None.

    The upper left corner of the picture is (0, 0).
    """
    found = look(_loaded(), picture)
    if found is None:
        return None
    pixels, sigma, _ = found
    return {name: (float(u), float(v), sigma) for name, (u, v) in zip(NAMES, pixels, strict=True)}


if __name__ == "__main__":
    _loaded()
    sys.exit(run_detector(find, __doc__))
