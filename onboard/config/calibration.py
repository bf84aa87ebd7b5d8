"""Camera calibration files: ROS camera_info, and Kalibr camchains.

camera_info is read from camera_calibration, from `ros2 topic echo`, and from OpenCV's FileStorage with the same
names.
"""

from pathlib import Path
from typing import Any, Final

from onboard.geometry.lens import Lens
from onboard.wire.ros.camera_info import EXPECTED, lens_of_info, make_lens, model_of, numbers_of, shown

MAX_CALIBRATION_SIZE: Final = 1 << 20


def read_calibration(path: Path) -> Lens:
    """Return the lens in a file, for the raw image.

    Rectification and projection matrices are ignored. Raises ValueError, which names the file and the field.
    """
    try:
        if path.exists() and not (path.is_file() and path.stat().st_size <= MAX_CALIBRATION_SIZE):
            raise ValueError(f"expected a file of at most {MAX_CALIBRATION_SIZE} bytes")  # noqa: TRY301 - as for what is no text
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error  # the path stands before it
        raise ValueError(f"calibration: cannot read {path}: {reason}") from error
    try:
        table = _load(text)
        if isinstance(table, dict) and any(isinstance(v, dict) and "camera_model" in v for v in table.values()):
            return _kalibr(table)
        if not isinstance(table, dict):
            raise ValueError(EXPECTED)  # noqa: TRY004, TRY301 - as for all errors in a file
        return lens_of_info(table)
    except ValueError as error:
        raise ValueError(f"calibration: {path}: {error}") from error


def _load(text: str) -> Any:
    """Return the first document of a YAML file. Raises ValueError."""
    import yaml  # noqa: PLC0415 - 30 ms that most starts do not need

    class Loader(yaml.SafeLoader):
        """A loader for the additional tag of OpenCV's FileStorage."""

    def matrix(loader: yaml.SafeLoader, node: yaml.MappingNode) -> Any:
        return loader.construct_mapping(node, deep=True)

    Loader.add_constructor("tag:yaml.org,2002:opencv-matrix", matrix)
    first, _, rest = text.partition("\n")
    text = rest if first.startswith("%YAML:") else text  # OpenCV's, which is not YAML
    try:
        return next(yaml.load_all(text, Loader), None)
    except (yaml.YAMLError, RecursionError) as error:
        raise ValueError(f"it is not YAML: {' '.join(str(error).split())}") from error


def _kalibr(table: dict[str, Any]) -> Lens:
    """Return the lens of a Kalibr camchain. Raises ValueError."""
    cameras = {name: value for name, value in table.items() if isinstance(value, dict) and "camera_model" in value}
    if len(cameras) > 1:
        raise ValueError(f"it holds several cameras ({', '.join(cameras)}); use a file with one")
    ((name, camera),) = cameras.items()
    if camera["camera_model"] != "pinhole":
        raise ValueError(f"{name}.camera_model is {shown(camera['camera_model'])}, known: pinhole")
    k, size = numbers_of(camera, "intrinsics"), numbers_of(camera, "resolution")
    if len(k) != 4 or len(size) != 2:
        raise ValueError(f"{name}: expected 4 intrinsics and 2 of resolution, got {len(k)} and {len(size)}")
    if camera.get("distortion_model") in (None, "none"):
        return make_lens((k[0], k[1], k[2], k[3]), size, "radial-tangential", [])
    d = numbers_of(camera, "distortion_coeffs")
    return make_lens((k[0], k[1], k[2], k[3]), size, model_of(camera, "distortion_model"), d)
