"""Files of calibrations as people have them, and images that were resized or cropped before the detector."""

from pathlib import Path
from typing import Any

import pytest

from onboard.config import ConfigError, load_config
from onboard.config.calibration import read_calibration
from onboard.config.cameras import lens_of
from onboard.geometry.lens import Lens, LensError
from onboard.messages import Intrinsics
from onboard.wire.documents.points import lens_of as intrinsics_lens

K = "900.0, 0.0, 640.0, 0.0, 905.0, 360.0, 0.0, 0.0, 1.0"
D = "-0.3, 0.1, 0.001, -0.001, 0.0"
LENS = Lens(
    fx_px=900.0,
    fy_px=905.0,
    cx_px=640.0,
    cy_px=360.0,
    width_px=1280.0,
    height_px=720.0,
    distortion=(-0.3, 0.1, 0.001, -0.001, 0.0),
)
INFO = f"""image_width: 1280
image_height: 720
camera_matrix:
  rows: 3
  cols: 3
  data: [{K}]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [{D}]
"""
ROWS = "".join(f"\n    - {x}" for x in K.split(", "))
ECHO = f"""header: {{frame_id: cam}}
height: 720
width: 1280
distortion_model: plumb_bob
d: [{D}]
k: [{K}]
binning_x: 0
binning_y: 0
roi: {{x_offset: 0, y_offset: 0, height: 0, width: 0, do_rectify: false}}
---
"""
KALIBR = """cam0:
  camera_model: pinhole
  intrinsics: [900.0, 905.0, 640.0, 360.0]
  distortion_model: radtan
  distortion_coeffs: [-0.3, 0.1, 0.001, -0.001]
  resolution: [1280, 720]
"""


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "camera.yaml"
    path.write_bytes(text.encode())
    return path


SPELLINGS = {
    "a comment behind a number": INFO.replace("1280", "1280  # after binning"),
    "a comment behind a key": INFO.replace("camera_matrix:", "camera_matrix: # K"),
    "a comment within brackets": INFO.replace("900.0, 0.0, 640.0,", "900.0, 0.0, 640.0, # row\n   "),
    "another order": INFO.replace("  rows: 3\n  cols: 3\n", "  cols: 3\n  dt: d\n"),
    "a list of lines": INFO.replace(f" [{K}]", ROWS),
    "quotes": INFO.replace("plumb_bob", "'plumb_bob'").replace("image_width", '"image_width"'),
    "a flow mapping": INFO.replace(f"\n  rows: 3\n  cols: 3\n  data: [{K}]", f" {{data: [{K}]}}"),
    "OpenCV": "%YAML:1.0\n---\n" + INFO.replace("camera_matrix:", "camera_matrix: !!opencv-matrix"),
    "numbers of YAML": INFO.replace(K, "900., .0, 6.4e+2, 0, +905, 36e1, 0, 0, 1"),
    "lines of Windows": "\ufeff" + INFO.replace("\n", "\r\n"),
    "ros2 topic echo": ECHO,
}


@pytest.mark.parametrize("name", SPELLINGS)
def test_every_spelling_of_a_file_is_the_same_lens(tmp_path: Path, name: str) -> None:
    assert read_calibration(written(tmp_path, SPELLINGS[name])) == LENS


def test_a_camchain_of_kalibr_is_read(tmp_path: Path) -> None:
    lens = read_calibration(written(tmp_path, KALIBR))
    assert lens == Lens(**{**vars_of(LENS), "distortion": LENS.distortion[:4]})
    fisheye = read_calibration(written(tmp_path, KALIBR.replace("radtan", "equidistant")))
    assert fisheye.model == "fisheye"


def vars_of(lens: Lens) -> dict[str, Any]:
    return {name: getattr(lens, name) for name in lens.__dataclass_fields__}


def test_a_region_of_interest_and_binning_of_a_message_are_heard(tmp_path: Path) -> None:
    text = ECHO.replace("binning_x: 0\nbinning_y: 0", "binning_x: 2\nbinning_y: 2")
    text = text.replace(
        "x_offset: 0, y_offset: 0, height: 0, width: 0", "x_offset: 40, y_offset: 60, height: 600, width: 1000"
    )
    lens = read_calibration(written(tmp_path, text))
    assert (lens.fx_px, lens.fy_px, lens.cx_px, lens.cy_px) == (450.0, 452.5, 300.0, 150.0)
    assert (lens.width_px, lens.height_px) == (500.0, 300.0)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (INFO.replace("900.0", ".nan"), "camera_matrix: expected a finite number, got nan"),
        (INFO.replace("900.0", "-900.0"), "focal lengths must be positive"),
        (INFO.replace(K, "0, 0, 0, 0, 0, 0, 0, 0, 0"), "focal lengths must be positive, not 0 and 0"),
        (INFO.replace("-0.3", "inf"), "distortion_coefficients: expected a finite number"),
        (INFO.replace("1280", "0"), "the image has 0 x 720 pixels"),
        (INFO.replace("1280", "wide"), "image_width: expected a number, got 'wide'"),
        (INFO.replace("900.0, 0.0", "900.0, 40.0"), "a skew of 40 px"),
        (INFO.replace("[", "[[", 1), "it is not YAML"),
        ("- 1\n", "expected a camera_info file of ROS or a camchain"),
        ("", "expected a camera_info file of ROS or a camchain"),
        (KALIBR.replace("pinhole", "omni"), "cam0.camera_model is omni, known: pinhole"),
        (KALIBR + KALIBR.replace("cam0", "cam1"), r"several cameras \(cam0, cam1\)"),
    ],
)
def test_what_no_lens_has_is_refused_in_one_line(tmp_path: Path, text: str, reason: str) -> None:
    with pytest.raises(ConfigError, match=reason.replace("[", r"\[")) as caught:
        load_config(None, (f"camera.calibration='{written(tmp_path, text)}'",))
    assert "\n" not in str(caught.value)
    assert "camera.yaml" in str(caught.value)


def configured(tmp_path: Path, *more: str) -> Lens:
    return lens_of(load_config(None, (f"camera.calibration='{written(tmp_path, INFO)}'", *more)).camera)


@pytest.mark.parametrize(
    "size",
    [("camera.width_px=640", "camera.height_px=360"), ("camera.width_px=640",), ("camera.height_px=360",)],
)
def test_a_size_beside_a_calibration_is_that_of_the_resized_image(tmp_path: Path, size: tuple[str, ...]) -> None:
    lens = configured(tmp_path, *size)
    assert (lens.fx_px, lens.fy_px, lens.cx_px, lens.cy_px) == (450.0, 452.5, 320.0, 180.0)
    assert (lens.width_px, lens.height_px, lens.distortion) == (640.0, 360.0, LENS.distortion)


def test_another_shape_is_refused_unless_the_crop_is_known(tmp_path: Path) -> None:
    square = ("camera.width_px=640", "camera.height_px=640")
    with pytest.raises(ConfigError, match="another shape; expected the same shape, or `crop_px`"):
        configured(tmp_path, *square)
    lens = configured(tmp_path, *square, "camera.crop_px=[280, 0, 720, 720]")
    assert (lens.fx_px, lens.cx_px, lens.cy_px) == pytest.approx((800.0, 320.0, 320.0))
    with pytest.raises(ConfigError, match="crop_px: beyond the image, which has 1280 x 720"):
        configured(tmp_path, "camera.crop_px=[600, 0, 720, 720]")


@pytest.mark.parametrize(
    "key", ["f_px=450", "fy_px=450", "cx_px=1", "cy_px=1", "distortion=[0, 0, 0, 0]", "distortion_model='fisheye'"]
)
def test_a_key_that_has_no_effect_beside_a_calibration_is_refused(tmp_path: Path, key: str) -> None:
    with pytest.raises(ConfigError, match=f"^camera.{key.partition('=')[0]}: the file of camera.calibration also"):
        configured(tmp_path, f"camera.{key}")


@pytest.mark.parametrize("change", [{"fx_px": -1.0}, {"cx_px": float("nan")}, {"distortion": (float("inf"),) * 4}])
def test_no_lens_is_made_of_numbers_that_none_has(change: dict[str, Any]) -> None:
    with pytest.raises(LensError):
        Lens(**vars_of(LENS) | change)


@pytest.mark.parametrize("binning", [2, 4])
def test_intrinsics_of_binned_pixels_beside_the_size_of_all_are_scaled_and_noted(
    tmp_path: Path, binning: int
) -> None:
    """As drivers send them: K of the binned image, the size of the sensor, and the binning."""
    echo = ECHO.replace("width: 1280", f"width: {1280 * binning}").replace(
        "height: 720", f"height: {720 * binning}"
    )
    lens = read_calibration(written(tmp_path, echo))
    assert (lens.fx_px, lens.fy_px, lens.cx_px, lens.cy_px) == tuple(binning * x for x in (900, 905, 640, 360))
    assert f"(640, 360) is the middle of 1/{binning} of the image of" in lens.note
    echo = echo.replace("binning_x: 0", f"binning_x: {binning}").replace("binning_y: 0", f"binning_y: {binning}")
    binned = read_calibration(written(tmp_path, echo))
    assert Lens(**{**vars_of(binned), "note": "", "binning": 1}) == LENS
    assert binned.note == lens.note


def test_a_principal_point_far_from_the_middle_is_noted_and_used_as_it_is(tmp_path: Path) -> None:
    off = read_calibration(written(tmp_path, INFO.replace("640.0", "400.0")))
    assert (off.cx_px, off.fx_px) == (400.0, 900.0)
    assert off.note.startswith("the principal point (400, 360) is far from the middle of the image of 1280 x 720")
    for near in ("520.0", "700.0"):
        assert not read_calibration(written(tmp_path, INFO.replace("640.0", near))).note


def test_keys_of_a_camera_and_intrinsics_of_images_are_judged_alike() -> None:
    keys = (
        "camera.width_px=2560",
        "camera.height_px=1440",
        "camera.f_px=900",
        "camera.cx_px=640",
        "camera.cy_px=360",
    )
    lens = lens_of(load_config(None, keys).camera)
    assert (lens.fx_px, lens.cx_px, lens.cy_px) == (1800.0, 1280.0, 720.0)
    numbers = {"fx_px": 900.0, "fy_px": 900.0, "cx_px": 640.0, "cy_px": 360.0}
    sent = intrinsics_lens(Intrinsics(**numbers, width_px=2560.0, height_px=1440.0))
    assert sent == lens
    assert not intrinsics_lens(Intrinsics(**numbers)).note
