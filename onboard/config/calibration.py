"""Files of a camera's calibration: camera_info of ROS (camera_calibration, `ros2 topic echo`, OpenCV's FileStorage
with the same names), and a camchain of Kalibr."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, NamedTuple

from onboard.geometry.lens import COUNTS, Lens, LensError, Model
from onboard.messages.text import plain

MODELS: Final[dict[str, Model]] = {
    "plumb_bob": "radial-tangential",
    "rational_polynomial": "radial-tangential",
    "radtan": "radial-tangential",
    "equidistant": "fisheye",
    "fisheye": "fisheye",
}
EXPECTED: Final = "expected a camera_info file of ROS or a camchain of Kalibr"
MOST_SKEW_PX: Final = 1.0
SAME_SHAPE: Final = 0.01  # of the ratio of width to height: sizes are rounded to pixels


def read_calibration(path: Path) -> Lens:
    """The lens of a file: of the image as it is, so that the rectification and projection matrices are not used.
    Raises ValueError, which names the file and the field."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, ValueError) as error:
        raise ValueError(f"calibration: cannot read {path}: {error}") from error
    try:
        table = _load(text)
        if isinstance(table, dict) and any(isinstance(v, dict) and "camera_model" in v for v in table.values()):
            return _kalibr(table)
        if not isinstance(table, dict):
            raise ValueError(EXPECTED)  # noqa: TRY004, TRY301 - as all that is wrong in a file
        return _camera_info(table)
    except ValueError as error:
        raise ValueError(f"calibration: {path}: {error}") from error


def part_of(
    lens: Lens, crop_px: tuple[float, ...] | None, width_px: float | None, height_px: float | None
) -> Lens:
    """The lens of a part of its image (left, upper, width, height; None: all of it), resized to a width and a
    height (None: not). Raises LensError where that is another shape, or the part is not within the image."""
    left, upper, width, height = crop_px or (0.0, 0.0, lens.width_px, lens.height_px)
    if left + width > lens.width_px or upper + height > lens.height_px:
        raise LensError(f"crop_px: beyond the image, which has {lens.width_px:g} x {lens.height_px:g} pixels")
    if width_px is None:
        width_px = width if height_px is None else width * height_px / height
    if height_px is None:
        height_px = height * width_px / width
    x, y = width_px / width, height_px / height
    if abs(x / y - 1.0) > SAME_SHAPE:
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


def _load(text: str) -> Any:
    """The first document of a YAML file. Raises ValueError."""
    import yaml  # noqa: PLC0415 - 30 ms that most starts do not need

    class Loader(yaml.SafeLoader):
        """OpenCV's FileStorage writes a tag that nobody else knows."""

    def matrix(loader: yaml.SafeLoader, node: yaml.MappingNode) -> Any:
        return loader.construct_mapping(node, deep=True)

    Loader.add_constructor("tag:yaml.org,2002:opencv-matrix", matrix)
    first, _, rest = text.partition("\n")
    text = rest if first.startswith("%YAML:") else text  # OpenCV's, which is not YAML
    try:
        return next(yaml.load_all(text, Loader), None)
    except (yaml.YAMLError, RecursionError) as error:
        raise ValueError(f"it is not YAML: {' '.join(str(error).split())}") from error


class _Names(NamedTuple):
    """How a file names the fields of a camera_info."""

    width: str
    height: str
    matrix: str
    coefficients: str


FILE: Final = _Names("image_width", "image_height", "camera_matrix", "distortion_coefficients")
MESSAGE: Final = _Names("width", "height", "k", "d")  # sensor_msgs/CameraInfo, as `ros2 topic echo` prints it


def _camera_info(table: dict[str, Any]) -> Lens:
    """Raises ValueError."""
    names = MESSAGE if MESSAGE.matrix in table else FILE
    k, d = (_numbers(table, name) for name in (names.matrix, names.coefficients))
    size = [_size(table, name) for name in (names.width, names.height)]
    model = _model(table, "distortion_model")
    if len(k) != 9:
        raise ValueError(f"{names.matrix}: expected 3x3 numbers, got {len(k)}")
    if abs(k[1]) > MOST_SKEW_PX:
        raise ValueError(f"{names.matrix}: a skew of {k[1]:g} px is not supported")
    lens = _lens((k[0], k[4], k[2], k[5]), size, model, d)
    return _as_sent(lens, table)


def _as_sent(lens: Lens, table: dict[str, Any]) -> Lens:
    """The lens of the images that the message is of: of a region of interest, with pixels binned. Raises
    ValueError."""
    roi = table.get("roi") or {}
    crop = tuple(_number(roi.get(name, 0), f"roi.{name}") for name in ("x_offset", "y_offset", "width", "height"))
    binning = [max(1.0, _number(table.get(name, 0), name)) for name in ("binning_x", "binning_y")]
    _, _, width, height = crop = crop if crop[2] and crop[3] else (0.0, 0.0, lens.width_px, lens.height_px)
    return part_of(lens, crop, width / binning[0], height / binning[1])


def _kalibr(table: dict[str, Any]) -> Lens:
    """Raises ValueError."""
    cameras = {name: value for name, value in table.items() if isinstance(value, dict) and "camera_model" in value}
    if len(cameras) > 1:
        raise ValueError(f"it is of several cameras: {', '.join(cameras)}; expected a file of one")
    ((name, camera),) = cameras.items()
    if camera["camera_model"] != "pinhole":
        raise ValueError(f"{name}.camera_model is {_shown(camera['camera_model'])}, known: pinhole")
    k, size = _numbers(camera, "intrinsics"), _numbers(camera, "resolution")
    if len(k) != 4 or len(size) != 2:
        raise ValueError(f"{name}: expected 4 intrinsics and 2 of resolution, got {len(k)} and {len(size)}")
    if camera.get("distortion_model") in (None, "none"):
        return _lens((k[0], k[1], k[2], k[3]), size, "radial-tangential", [])
    d = _numbers(camera, "distortion_coeffs")
    return _lens((k[0], k[1], k[2], k[3]), size, _model(camera, "distortion_model"), d)


def _lens(k: tuple[float, float, float, float], size: list[float], model: Model, d: list[float]) -> Lens:
    """Raises ValueError for what no lens has."""
    fx, fy, cx, cy = k
    most = max(COUNTS[model])
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


def _model(table: dict[str, Any], name: str) -> Model:
    found = table.get(name)
    model = MODELS.get(found) if isinstance(found, str) else None
    if model is None:
        raise ValueError(f"{name} is {_shown(found)}, known: {', '.join(MODELS)}")
    return model


def _shown(value: Any) -> str:
    """A value of a file in a few letters: aliases make lists without end of it."""
    return f"a {type(value).__name__}" if isinstance(value, list | dict) else plain(str(value))


def _size(table: dict[str, Any], name: str) -> float:
    if table.get(name) is None:
        raise ValueError(f"it has no {name}; {EXPECTED}")
    return _number(table[name], name)


def _numbers(table: dict[str, Any], name: str) -> list[float]:
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
            f"{name}: expected a number, got {_shown(repr(value) if isinstance(value, str) else value)}"
        ) from error
    if not math.isfinite(number):
        raise ValueError(f"{name}: expected a finite number, got {value}")
    return number
