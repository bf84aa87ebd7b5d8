"""Train the networks of `examples/learned.py` on pictures drawn by simlink or on your own.

It needs NumPy, OpenCV and `onboard`, and takes minutes; the result depends on the seed.

    python examples/learned_train.py
    python examples/learned_train.py --pictures FOLDER

FOLDER has the pictures, as large as your camera's, and `labels.csv`, a line each:

    file,center_u,center_v,left_u,left_v,right_u,right_v

Coordinates are in px from the upper left corner; `left` and `right` are sides of the image. A line with only the
file is a picture without an aircraft; a detector needs many of them. A tenth of all pictures is not trained on;
the error on these is printed, and is the sigma with which points are sent.
"""

import argparse
import csv
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
from learned import (
    CELL,
    CHANNELS,
    CROP_SIZE_PX,
    KERNELS,
    MIN_SPAN_PX,
    STRIDES,
    WEIGHTS,
    WIDTH_PX,
    Array,
    Layer,
    Learned,
    Network,
    Picture,
    Square,
    columns,
    cut,
    levels,
    look,
    middle_and_span,
    shares,
    small,
    square,
)

from onboard.geometry.rotations import matrix_from_quaternion, quaternion_from_euler
from simlink.scenarios.scenario import load_scenario
from simlink.sensors.camera import mount_quaternion, project
from simlink.sensors.pictures import Painter
from simlink.world.truth import State, states, true_size

BATCH_SIZE = 32
LEARNING_RATE = 3e-3  # at the beginning; it falls to 0
CROP_COUNT = 4  # for each aircraft
FIRST_ERROR = (0.2, 0.2, 0.7)  # of a first look: in spans, and in the logarithm of the span
SECOND_ERROR_RATIO = 0.4  # error of a second look over that of a first one
SPREAD = 0.7  # cells: standard deviation of a point's place as it is taught
MIN_IMAGES = 20  # of one's own
DEFAULT_ERROR_PX = 5.0  # of a crop, if nothing was found
NOWHERE = np.full((3, 2), np.nan, np.float32)

Labelled = tuple[Picture, Array | None]  # a picture, and center, left and right (3, 2), px; None: no aircraft


class Scene(NamedTuple):
    """The contents of drawn pictures with an aircraft of 2.7 m wingspan."""

    distances: tuple[float, float] = (7.0, 70.0)  # m
    empty: float = 0.25  # share of pictures without an aircraft
    cluttered: float = 0.5  # share with other things
    behind: float = 0.7  # share of aircraft seen from behind within 60 degrees, not from any side


EVERYTHING = Scene()


class Taught(NamedTuple):
    """Training pictures (n, rows, columns) and points (n, points, 2) in px, NaN if absent."""

    pictures: Picture
    places: Array


def draw_pictures(seed: int, count: int, scene: Scene = EVERYTHING) -> Iterator[Labelled]:
    """Yield pictures by simlink: an aircraft anywhere in the image, before sky and ground."""
    random = np.random.default_rng((seed, 0x1EA))
    scenario = load_scenario("pictures")
    camera, size = scenario.camera, true_size(scenario, seed)
    painter, base = Painter(camera, size, seed), next(states(scenario, seed))
    middle = np.array([camera.width_px / 2, camera.height_px / 2], np.float32)
    while count:
        state = random_pose(base, scene, random)
        angles = project(state, size, camera, mount_quaternion(camera))
        if angles is None:
            continue  # a wingtip is outside
        count -= 1
        points: Array | None = order_tips(camera.f_px * np.array(angles, np.float32) + middle)
        if random.random() < scene.empty:
            points = None
            state = state._replace(r_OL_n=(0.0, 0.0, 1e6))  # out of sight
        picture = painter.paint(state)
        if random.random() < scene.cluttered:
            clutter(picture, random, points)
        yield picture, points


def random_pose(base: State, scene: Scene, random: np.random.Generator) -> State:
    """Return both aircraft in random flight attitudes, the other in front of the camera."""
    q_nF = quaternion_from_euler(random.uniform(-0.5, 0.5), random.uniform(-0.35, 0.35), 0.0)
    distance = np.exp(random.uniform(*np.log(scene.distances)))
    r_b = distance * np.array([1.0, random.uniform(-0.55, 0.55), random.uniform(-0.4, 0.4)])
    r_n = np.array(base.r_OL_n) - matrix_from_quaternion(q_nF) @ r_b
    yaw = np.pi * random.uniform(-1.0, 1.0) / (3.0 if random.random() < scene.behind else 1.0)
    q_nL = quaternion_from_euler(random.uniform(-0.6, 0.6), random.uniform(-0.35, 0.35), yaw)
    return base._replace(r_OF_n=tuple(r_n.tolist()), q_nF=tuple(q_nF.tolist()), q_nL=tuple(q_nL.tolist()))


def clutter(picture: Picture, random: np.random.Generator, points: Array | None) -> None:
    """Draw up to six other things into a picture, but not over the aircraft.

    They are bushes and birds, poles and edges, and clouds, dark or bright.
    """
    things = picture.copy()
    for _ in range(random.integers(1, 7)):
        kept, grey = things.copy(), float(random.uniform(20.0, 240.0))
        u, v = (int(random.integers(0, n)) for n in picture.shape[::-1])
        length, thin = np.exp(random.uniform([1.0, 0.0], [5.0, 2.5]))
        kind, angle = random.integers(3), float(random.uniform(0.0, 180.0))
        if kind == 0:
            cv2.ellipse(
                things, (u, v), (round(length / 2) + 1, round(thin) + 1), angle, 0, 360, grey, -1, cv2.LINE_AA
            )
        elif kind == 1:
            end = round(u + length * np.cos(angle)), round(v + length * np.sin(angle))
            cv2.line(things, (u, v), end, grey, max(round(thin / 2), 1), cv2.LINE_AA)
        else:
            cv2.ellipse(
                things, (u, v), (2 * round(length), round(length / 3) + 1), 0, 0, 360, grey, -1, cv2.LINE_AA
            )
        if points is not None:
            part = square(*middle_and_span(points))
            over = np.s_[max(part.top, 0) : part.top + part.side, max(part.left, 0) : part.left + part.side]
            if (things[over] != kept[over]).any():
                things = kept
    soft = cv2.GaussianBlur(things, (0, 0), 0.7)
    noise = 3.0 * random.standard_normal(picture.shape)
    changed = things != picture
    picture[changed] = np.clip(soft + noise, 0, 255)[changed]


def order_tips(pixels: Array) -> Array:
    """Return center and wingtips in the order of the image: left, then right."""
    return pixels if pixels[1, 0] <= pixels[2, 0] else pixels[[0, 2, 1]]


def read_pictures(folder: Path) -> Iterator[Labelled]:
    """Yield the pictures of a folder with the labels of its `labels.csv`.

    Raises OSError, and ValueError with the line.
    """
    labels = folder / "labels.csv"
    with labels.open(encoding="utf-8", newline="") as file:
        reader = csv.reader(file)
        next(reader, None)
        for name, *texts in reader:
            line = f"{labels}, line {reader.line_num}"
            picture = cv2.imread(str(folder / name), cv2.IMREAD_GRAYSCALE)
            if picture is None:
                raise ValueError(f"{line}: {name} is no picture")
            points = None
            if any(texts):
                try:
                    points = order_tips(np.array([float(text) for text in texts], np.float32).reshape(3, 2))
                except ValueError:
                    raise ValueError(f"{line}: not six numbers, nor none: {','.join(texts)}") from None
            yield np.asarray(picture, np.uint8), points
    if reader.line_num < MIN_IMAGES:
        raise ValueError(f"{labels}: {reader.line_num} lines; {MIN_IMAGES} are the least, and hundreds are better")


def training_data(labelled: Iterable[Labelled], seed: int) -> tuple[Taught, Taught]:
    """Return the training data of `where` and `points`.

    Each picture is used whole, and in parts: around the aircraft with random offset and scale, and elsewhere.
    """
    random = np.random.default_rng((seed, 0xC07))
    whole: list[tuple[Picture, list[list[float]]]] = []
    parts: list[tuple[Picture, Array]] = []
    for picture, points in labelled:
        scale = WIDTH_PX / picture.shape[1]
        u, v, span = (np.nan,) * 3 if points is None else middle_and_span(points)
        whole.append((small(picture), [[scale * u, scale * v]]))
        near = [] if points is None else around(u, v, span, random)
        at = NOWHERE if points is None else points
        parts += [(cut(picture, part), in_crop(at, part)) for part in (*near, elsewhere(picture, random))]
    return _taught(*zip(*whole, strict=True)), _taught(*zip(*parts, strict=True))


def _taught(pictures: Sequence[Picture], places: Sequence[npt.ArrayLike]) -> Taught:
    return Taught(np.array(pictures), np.array(places, np.float32))


def around(u: float, v: float, span: float, random: np.random.Generator) -> list[Square]:
    """Return parts around an aircraft with the errors of a second look and of first looks."""
    off = random.uniform(-1.0, 1.0, (CROP_COUNT, 3)) * FIRST_ERROR
    off[0] *= SECOND_ERROR_RATIO
    return [square(u + du * span, v + dv * span, span * float(np.exp(grows))) for du, dv, grows in off]


def elsewhere(picture: Picture, random: np.random.Generator) -> Square:
    """Return a part without an aircraft: a random one, or that with the highest contrast."""
    span = float(np.exp(random.uniform(np.log(MIN_SPAN_PX), np.log(picture.shape[0] / 2))))
    if random.random() < 0.2:
        v, u = random.random(2) * picture.shape
        return square(float(u), float(v), span)
    sharp = np.abs(picture - cv2.blur(picture.astype(np.float32), (2 * round(span / 2) + 1,) * 2))
    v, u = np.unravel_index(int(cv2.blur(sharp, (5, 5)).argmax()), picture.shape)
    return square(float(u), float(v), span)


def in_crop(points: Array, part: Square) -> Array:
    """Convert points of a picture to px of a crop; NaN for those outside."""
    found = (points - np.array([part.left, part.top], np.float32)) * (CROP_SIZE_PX / part.side)
    found[~((found >= 0.0) & (found < CROP_SIZE_PX)).all(axis=1)] = np.nan
    return found


def targets(places: Array, shape: tuple[int, int], cell: int) -> Array:
    """Return the target probability of each point (n, points, 2; px) in each cell.

    The result is (n, rows, columns, points).
    """
    at = places / cell
    rows, cols = np.arange(shape[0]) + 0.5, np.arange(shape[1]) + 0.5
    vertical = np.exp(-0.5 * ((rows[:, None] - at[:, None, :, 1]) / SPREAD) ** 2)  # (n, rows, points)
    across = np.exp(-0.5 * ((cols[:, None] - at[:, None, :, 0]) / SPREAD) ** 2)
    likely = vertical[:, :, None] * across[:, None]
    share: Array = np.nan_to_num(likely / likely.sum(axis=(1, 2), keepdims=True)).astype(np.float32)
    return share


def loss_and_gradient(maps: Array, places: Array, cell: int) -> tuple[float, Array]:
    """Return the mean cross-entropy of maps over the pictures, and its derivatives."""
    share, wanted = shares(maps), targets(places, maps.shape[1:3], cell)
    nowhere = np.maximum(1.0 - share.sum(axis=(1, 2)), 1e-9)
    loss = -(wanted * np.log(share + 1e-9)).sum() - np.log(nowhere)[np.isnan(places[..., 0])].sum()
    return float(loss) / len(places), (share - wanted) / np.float32(len(places))


def gradients(
    network: Network, x: Array, wrong: Callable[[Array], tuple[float, Array]]
) -> tuple[float, list[Array]]:
    """Return the loss `wrong` of the network's maps of x, and its derivatives by `parameters`."""
    kept: list[tuple[tuple[int, ...], Array, Array]] = []
    for layer in network:
        seen = columns(x, layer)
        y = seen @ layer.weights.reshape(-1, layer.weights.shape[-1]) + layer.biases
        kept.append((x.shape, seen, y))
        x = np.maximum(y, 0.0)
    loss, by_y = wrong(y)
    found: list[Array] = []
    for k, (layer, (shape, seen, y)) in reversed(list(enumerate(zip(network, kept, strict=True)))):
        if k + 1 < len(network):
            by_y = by_y * (y > 0.0)
        flat = by_y.reshape(-1, by_y.shape[-1])
        by_weights = seen.reshape(-1, seen.shape[-1]).T @ flat
        found += [flat.sum(axis=0), by_weights.reshape(layer.weights.shape)]
        if k:
            by_seen = flat @ layer.weights.reshape(-1, flat.shape[1]).T
            by_y = scatter_columns(by_seen.reshape(seen.shape), shape, layer)
    return loss, found[::-1]


def scatter_columns(by_seen: Array, shape: tuple[int, ...], layer: Layer) -> Array:
    """Return derivatives by `columns` as derivatives by their source, which has this shape."""
    k, stride, (n, rows, width, channels) = layer.weights.shape[0], layer.stride, shape
    out = np.zeros((n, rows + k - 1, width + k - 1, channels), np.float32)
    parts = np.split(by_seen, k * k, axis=-1)
    for place, part in enumerate(parts):
        i, j = divmod(place, k)
        out[:, i : i + stride * part.shape[1] : stride, j : j + stride * part.shape[2] : stride] += part
    return out[:, k // 2 : k // 2 + rows, k // 2 : k // 2 + width]


def make_network(name: str, random: np.random.Generator) -> list[Layer]:
    """Return a network with random weights (He et al. 2015)."""
    layers = []
    for k, ins, outs, stride in zip(
        KERNELS[name], CHANNELS[name], CHANNELS[name][1:], STRIDES[name], strict=False
    ):
        sigma = np.sqrt(2.0 / (k * k * ins))
        weights = sigma * random.standard_normal((k, k, ins, outs))
        layers.append(Layer(weights.astype(np.float32), np.zeros(outs, np.float32), stride))
    return layers


def parameters(network: Network) -> list[Array]:
    """Return weights and biases of each layer, not copied."""
    return [array for layer in network for array in (layer.weights, layer.biases)]


def train(name: str, data: Taught, steps: int, seed: int) -> list[Layer]:
    """Train a network on `data` for `steps` steps by Adam (Kingma and Ba 2015).

    Pictures are mirrored and change in brightness.
    """
    random = np.random.default_rng((seed, len(STRIDES[name])))
    network = make_network(name, random)
    means = [np.zeros_like(a) for a in parameters(network)]
    squares = [np.zeros_like(a) for a in means]
    smooth = 0.0
    for step in range(1, steps + 1):
        pictures, places = batch(data, random)
        loss, found = gradients(network, pictures, partial(loss_and_gradient, places=places, cell=CELL[name]))
        smooth += (loss - smooth) / min(step, 100)
        rate = LEARNING_RATE * min(1.0, step / 50) * 0.5 * (1.0 + np.cos(np.pi * step / steps))
        for k, (array, by_array) in enumerate(zip(parameters(network), found, strict=True)):
            means[k] += 0.1 * (by_array - means[k])
            squares[k] += 0.001 * (by_array**2 - squares[k])
            mean, square_ = means[k] / (1.0 - 0.9**step), squares[k] / (1.0 - 0.999**step)
            array[...] -= rate * mean / (np.sqrt(square_) + 1e-8)
        if step % (steps // 10 or 1) == 0:
            print(f"{name}: step {step} of {steps}, loss {smooth:.3f}", flush=True)
    return network


def batch(data: Taught, random: np.random.Generator) -> tuple[Array, Array]:
    """Return pictures as a network's input, half of them mirrored, and their positions."""
    k = random.integers(len(data.pictures), size=BATCH_SIZE)
    pictures, places = levels(data.pictures[k]), data.places[k].copy()
    flip = random.random(BATCH_SIZE) < 0.5
    pictures[flip] = pictures[flip, :, ::-1]
    places[flip, :, 0] = pictures.shape[2] - places[flip, :, 0]
    if places.shape[1] == 3:
        places[flip] = places[flip][:, [0, 2, 1]]
    pictures *= np.exp(random.uniform(-0.4, 0.3, (BATCH_SIZE, 1, 1, 1))).astype(np.float32)
    return pictures, places


def learn(pictures: Iterable[Labelled], steps: int, seed: int) -> Learned:
    """Train both networks on nine of ten pictures, and measure the error on the tenth."""
    held: list[Labelled] = []
    where, points = training_data(_but_each_tenth(pictures, held), seed)
    learned = Learned(train("where", where, steps // 3, seed), train("points", points, steps, seed), 1.0)
    return learned._replace(sigma=validate(learned, held))


def validate(learned: Learned, held: Iterable[Labelled]) -> float:
    """Return the error of a coordinate in 68 % of the pictures not trained on, px of a crop.

    The daemon's gates reject grossly wrong points. The results are printed.
    """
    errors, wrong, aircraft, empty = [], 0, 0, 0
    for picture, truth in held:
        seen = look(learned, picture)
        aircraft += truth is not None
        empty += truth is None
        if seen is not None and truth is not None:
            errors.append(np.abs(seen[0] - truth) * learned.sigma / seen[1])
        wrong += seen is not None and truth is None
    sigma = float(np.quantile(errors, 0.68)) if errors else DEFAULT_ERROR_PX
    print(
        f"not trained on: {len(errors)} of {aircraft} aircraft found, and {wrong} in {empty} pictures without; "
        f"a coordinate is off by {sigma:.2f} px of a crop of {CROP_SIZE_PX} (68 %)"
    )
    return sigma


def _but_each_tenth(pictures: Iterable[Labelled], held: list[Labelled]) -> Iterator[Labelled]:
    for k, labelled in enumerate(pictures):
        if k % 10 == 9:
            held.append(labelled)
        else:
            yield labelled


def save(learned: Learned, path: Path) -> None:
    """Write the file that `learned.load` reads."""
    arrays: dict[str, Array] = {"sigma": np.array(learned.sigma, np.float32)}
    for name, network in zip(STRIDES, (learned.where, learned.points), strict=True):
        for k, layer in enumerate(network):
            arrays |= {f"{name}_{k}_weights": layer.weights, f"{name}_{k}_biases": layer.biases}
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(path, allow_pickle=False, **arrays)


def main() -> int:
    """Train, and write the weights."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pictures", type=Path, metavar="FOLDER", help="your own (default: drawn by simlink)")
    parser.add_argument("--count", type=int, default=3000, metavar="N", help="drawn (default: %(default)s)")
    parser.add_argument("--steps", type=int, default=3000, metavar="N", help="of `points` (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="(default: %(default)s)")
    parser.add_argument("--out", type=Path, default=WEIGHTS, metavar="FILE", help="(default: %(default)s)")
    given = parser.parse_args()
    pictures = draw_pictures(given.seed, given.count) if given.pictures is None else read_pictures(given.pictures)
    try:
        save(learn(pictures, given.steps, given.seed), given.out)
    except (OSError, ValueError) as error:
        print(f"learned_train: {error}", file=sys.stderr)
        return 1
    print(f"written: {given.out}, {given.out.stat().st_size / 1e3:.0f} kB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
