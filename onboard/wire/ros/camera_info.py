"""The lens of a ROS sensor_msgs/CameraInfo or of a calibration file, which has its fields."""

import math
from dataclasses import replace
from typing import Any, Final, NamedTuple

from onboard.geometry.lens import COEFFICIENT_COUNTS, Lens, LensError, Model
from onboard.messages.text import plain

MODELS: Final[dict[str, Model]] = {
    "plumb_bob": "radial-tangential",
    "rational_polynomial": "radial-tangential",
    "radtan": "radial-tangential",
    "equidistant": "fisheye",
    "fisheye": "fisheye",
}
EXPECTED: Final = "expected a camera_info file of ROS or a camchain of Kalibr"
MAX_SKEW_PIXELS: Final = 1.0
SHAPE_TOLERANCE: Final = 0.01  # relative, of width over height: sizes are rounded to pixels


def part_of(
    lens: Lens, crop_px: tuple[float, ...] | None, width_px: float | None, height_px: float | None
) -> Lens:
    """The lens of a crop (left, upper, width, height) resized to a width and a height.

    None means the whole image, or its size. Raises LensError if the shape differs or the crop is not inside the
    image.
    """
    left, upper, width, height = crop_px or (0.0, 0.0, lens.width_px, lens.height_px)
    if left + width > lens.width_px or upper + height > lens.height_px:
        raise LensError(f"crop_px: beyond the image, which has {lens.width_px:g} x {lens.height_px:g} pixels")
    if width_px is None:
        width_px = width if height_px is None else width * height_px / height
    if height_px is None:
        height_px = height * width_px / width
    x, y = width_px / width, height_px / height
    if abs(x / y - 1.0) > SHAPE_TOLERANCE:
        raise LensError(
            f"it is of {width:g} x {height:g} pixels, width_px and height_px are {width_px:g} x {height_px:g}: "
            "another shape; expected the same shape, or `crop_px`, the part that was used"
        )
    return replace(
        lens,
        fx_px=lens.fx_px * x,
        fy_px=lens.fy_px * y,
        cx_px=(lens.cx_px - left) * x,
        cy_px=(lens.cy_px - upper) * y,
        width_px=width_px,
        height_px=height_px,
    )


class _Names(NamedTuple):
    """Field names of a camera_info."""

    width: str
    height: str
    matrix: str
    coefficients: str


FILE: Final = _Names("image_width", "image_height", "camera_matrix", "distortion_coefficients")
MESSAGE: Final = _Names("width", "height", "k", "d")  # sensor_msgs/CameraInfo, as `ros2 topic echo` prints it


def lens_of_info(table: dict[str, Any]) -> Lens:
    """The lens of a camera_info with the fields of a file or a message.

    Raises ValueError, which names the field.
    """
    names = MESSAGE if MESSAGE.matrix in table else FILE
    k, d = (numbers_of(table, name) for name in (names.matrix, names.coefficients))
    size = [_size(table, name) for name in (names.width, names.height)]
    model = model_of(table, "distortion_model")
    if len(k) != 9:
        raise ValueError(f"{names.matrix}: expected 3x3 numbers, got {len(k)}")
    if abs(k[1]) > MAX_SKEW_PIXELS:
        raise ValueError(f"{names.matrix}: a skew of {k[1]:g} px is not supported")
    lens = make_lens((k[0], k[4], k[2], k[5]), size, model, d)
    return _as_sent(lens, table)


def _as_sent(lens: Lens, table: dict[str, Any]) -> Lens:
    """The lens of a message's region of interest with binned pixels. Raises ValueError."""
    roi = table.get("roi") or {}
    crop = tuple(_number(roi.get(name, 0), f"roi.{name}") for name in ("x_offset", "y_offset", "width", "height"))
    binning = [max(1.0, _number(table.get(name, 0), name)) for name in ("binning_x", "binning_y")]
    _, _, width, height = crop = crop if crop[2] and crop[3] else (0.0, 0.0, lens.width_px, lens.height_px)
    return part_of(lens, crop, width / binning[0], height / binning[1])


def make_lens(k: tuple[float, float, float, float], size: list[float], model: Model, d: list[float]) -> Lens:
    """The lens of two focal lengths, a principal point, a size and OpenCV's coefficients.

    Raises ValueError for impossible values.
    """
    fx, fy, cx, cy = k
    most = max(COEFFICIENT_COUNTS[model])
    if any(d[most:]):
        beyond = "thin prism and tilt coefficients" if model == "radial-tangential" else f"more than {most}"
        raise ValueError(f"distortion: {beyond} are not supported")
    if not all(side > 0 for side in size):
        raise ValueError(f"the image has {size[0]:g} x {size[1]:g} pixels; expected the size of its images")
    return Lens(
        fx_px=fx,
        fy_px=fy,
        cx_px=cx,
        cy_px=cy,
        width_px=size[0],
        height_px=size[1],
        model=model,
        distortion=tuple(d[:most]),
    ).of_whole_image()


def model_of(table: dict[str, Any], name: str) -> Model:
    """The model of distortion that a field names. Raises ValueError."""
    found = table.get(name)
    model = MODELS.get(found) if isinstance(found, str) else None
    if model is None:
        raise ValueError(f"{name} is {shown(found)}, known: {', '.join(MODELS)}")
    return model


def shown(value: Any) -> str:
    """A value of a file in a few letters: aliases make lists without end of it."""
    return f"a {type(value).__name__}" if isinstance(value, list | dict) else plain(str(value))


def _size(table: dict[str, Any], name: str) -> float:
    if table.get(name) is None:
        raise ValueError(f"it has no {name}; {EXPECTED}")
    return _number(table[name], name)


def numbers_of(table: dict[str, Any], name: str) -> list[float]:
    """The numbers of a matrix, which may stand in its `data`."""
    found = table.get(name)
    if isinstance(found, dict):
        found = found.get("data")
    if not isinstance(found, list):
        raise ValueError(f"it has no {name} with data; {EXPECTED}")  # noqa: TRY004 - as all that is wrong in a file
    return [_number(value, name) for value in found]


def _number(value: Any, name: str) -> float:
    """A number, which YAML 1.1 takes for text in some spellings (1e3)."""
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueError(
            f"{name}: expected a number, got {shown(repr(value) if isinstance(value, str) else value)}"
        ) from error
    if not math.isfinite(number):
        raise ValueError(f"{name}: expected a finite number, got {value}")
    return number
