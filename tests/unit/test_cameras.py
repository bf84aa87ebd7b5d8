"""Several cameras: each by its name, with its own mount, lens and delay, from the configuration to the
estimate."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from onboard.config import Config, ConfigError, load_config, parse_config
from onboard.config.calibration import read_calibration
from onboard.config.cameras import lens_of
from onboard.geometry.camera import in_view, project
from onboard.geometry.rotations import matrix_from_euler
from onboard.messages import Datagram, Encoding, TargetPoints, Verdict
from onboard.pipeline.needs import needs
from tests.support.streams import CIRCLE, EPOCH, MS, SIZE, Run, S, Stream, encode, feed, position_error
from tests.unit.wire.test_points import document

BARREL = (-0.2812, 0.0711, 0.0012, -0.0009, 0.011)
TILTED = (10.0, 20.0, -15.0)
CAMERA_INFO = """\
image_width: 640
image_height: 480
camera_name: narrow_stereo
camera_matrix:
  rows: 3
  cols: 3
  data: [520.3, 0. , 318.9,
           0. , 518.7, 243.1,
           0. ,   0. ,   1. ]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.2812, 0.0711, 0.0012, -0.0009, 0.011000]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]
projection_matrix:
  rows: 3
  cols: 4
  data: [480.0, 0.0, 318.0, 0.0, 0.0, 500.0, 244.0, 0.0, 0.0, 0.0, 1.0, 0.0]
"""


def config(**tables: Any) -> Config:
    leader = {"estimator": {"leader": {"size_prior_m": SIZE}}}
    return parse_config(leader | tables)


def flown(settings: Config, camera: str, *, delay_ns: int = 0, sigma_px: float = 1.0) -> Run:
    """A flight whose images are detections of one camera: in its pixels, distorted, stamped too late by a
    delay."""
    one = settings.cameras.get(camera, settings.camera)
    lens, R_bc = lens_of(one), matrix_from_euler(*np.radians(one.mount_rpy_deg))
    rng = np.random.default_rng(1)
    datagrams = []
    for item in Stream(t1=12.0, seed=None, sparse=True).items():
        if not isinstance(item.message, TargetPoints):
            datagrams += encode([item])
            continue
        t_ns = item.message.t_ns
        rays_b = np.column_stack([np.ones(3), CIRCLE.points(t_ns / S)])
        pixels = [lens.pixel(*p) for p in project(rays_b @ R_bc).tolist()]
        noisy = (np.array(pixels) + sigma_px * rng.normal(size=(3, 2))).tolist()
        points = {n: {"u_px": u, "v_px": v} for n, (u, v) in zip(("center", "left", "right"), noisy, strict=True)}
        detection = {"points": points, "target": "leader"}
        sent = {"t_ns": t_ns + delay_ns, "clock": "boot", "camera": camera, "detections": [detection]}
        datagrams.append(
            Datagram(
                channel=f"onboard/1/camera/{camera}/detections",
                encoding=Encoding.DETECTIONS,
                t_recv_ns=item.t_recv_ns,
                data=json.dumps(sent).encode(),
            )
        )
    return feed(datagrams, settings)


def errors(run: Run) -> float:
    """Root mean square of the position's error after five seconds of images, m."""
    late = [position_error(e) for e in run.estimates if e.t_ns > 10 * S]
    return float(np.sqrt(np.mean(np.square(late))))


PLAIN = {"f_px": 520.0}
LENS = {"f_px": 520.3, "fy_px": 518.7, "cx_px": 318.9, "cy_px": 243.1, "distortion": list(BARREL)}


def test_each_camera_has_a_mount_of_its_own_seed_1() -> None:
    settings = config(camera=PLAIN, cameras={"side": PLAIN | {"mount_rpy_deg": list(TILTED), "width_px": 1280.0}})
    run = flown(settings, "side")
    assert run.verdicts()[Verdict.FUSED] > 75
    assert errors(run) < 1.5
    assert {r.source for r in run.reports} == {"side"}


def test_each_camera_has_a_delay_of_its_own_seed_1() -> None:
    settings = config(camera=PLAIN, cameras={"late": PLAIN | {"delay_s": 0.04}}, delay={"camera_s": 0.5})
    run = flown(settings, "late", delay_ns=40 * MS)
    assert errors(run) < 1.5
    assert run.reports[-1].t_ns % (80 * MS) == 0


def test_points_of_an_unknown_camera_are_refused_by_name() -> None:
    data = json.dumps(document(camera="rear")).encode()
    run = feed([Datagram(channel="k", encoding=Encoding.POINTS, t_recv_ns=EPOCH, data=data)])
    assert run.rejected["bad_points"] == 1
    (refusal,) = run.pipeline.health(EPOCH).refusals
    assert refusal.reason == "no camera is called `rear`; known: front - at `$.camera`"


def test_a_pixel_beyond_the_lens_is_refused_by_its_point() -> None:
    detection = {"points": {"left": {"u_px": 9000.0, "v_px": 0.0}}}
    data = json.dumps({"t_ns": 1, "clock": "boot", "detections": [detection]}).encode()
    one = Datagram(channel="k", encoding=Encoding.DETECTIONS, t_recv_ns=EPOCH, data=data)
    strong = LENS | {"distortion": [-0.28, 0.0, 0.0, 0.0]}
    (refusal,) = feed([one], config(camera=strong)).pipeline.health(EPOCH).refusals
    assert refusal.reason.startswith(
        "pixel (9000, 0) is outside of what the lens's distortion describes - at `$.det"
    )


def test_camera_info_of_ros_is_read_as_it_is(tmp_path: Path) -> None:
    file = tmp_path / "camera.yaml"
    file.write_text(CAMERA_INFO)
    lens = lens_of(load_config(None, (f"camera.calibration='{file}'",)).camera)
    assert (lens.fx_px, lens.fy_px, lens.cx_px, lens.cy_px) == (520.3, 518.7, 318.9, 243.1)
    assert (lens.width_px, lens.height_px, lens.model, lens.distortion) == (640, 480, "radial-tangential", BARREL)
    file.write_text(CAMERA_INFO.replace("plumb_bob", "equidistant").replace(", 0.011000]", "]"))
    assert read_calibration(file).model == "fisheye"
    as_lines = "data:\n" + "".join(f"  - {x}\n" for x in BARREL)
    file.write_text(CAMERA_INFO.replace("data: [-0.2812, 0.0711, 0.0012, -0.0009, 0.011000]\n", as_lines))
    assert read_calibration(file).distortion == BARREL


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("image_width: 640\n", "", "has no image_width"),
        ("plumb_bob", "thin_prism", "distortion_model is thin_prism, known: plumb_bob, rational"),
        ("data: [-0.2812", "data: [x", "distortion_coefficients: expected a number, got 'x'"),
        ("camera_matrix:", "matrix:", "has no camera_matrix with data"),
        (", 0.011000]", "]\n", None),
        (", -0.0009, 0.011000]", "]", "coefficients, not 3"),
        ("0.011000]", "0.011, 0, 0, 0, 0.2, 0, 0, 0]", "thin prism"),
    ],
)
def test_other_files_are_refused_in_one_line(tmp_path: Path, old: str, new: str, expected: str | None) -> None:
    file = tmp_path / "camera.yaml"
    assert old in CAMERA_INFO
    file.write_text(CAMERA_INFO.replace(old, new))
    if expected is None:
        load_config(None, (f"camera.calibration='{file}'",))
        return
    with pytest.raises(ConfigError, match=expected) as caught:
        load_config(None, (f"camera.calibration='{file}'",))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("tables", "expected"),
    [
        ({"cameras": {"front": {}}}, r"cameras.front: \[camera\] already has this name"),
        ({"cameras": {"a b": {}}}, "cameras.a b: use at most 64 letters"),
        ({"cameras": {"tele": {"name": "x"}}}, "cameras.tele.name: remove it"),
        ({"cameras": {"tele": {"f": 1}}}, "unknown key cameras.tele.f"),
        ({"cameras": {"tele": {"f_px": -1.0}}}, "cameras"),
        ({"camera": {"distortion": [0.1, 0.2]}}, "camera: distortion: radial-tangential has 4, 5, 8 coeff"),
        ({"camera": {"calibration": "/nowhere.yaml"}}, "calibration: cannot read /nowhere.yaml"),
        ({"camera": {"cx_px": -500.0}}, r"cx_px, cy_px: \(-500, 240\) is outside the image of 640 x 480 pixels"),
        ({"camera": {"cx_px": 5000.0}}, r"cx_px, cy_px: \(5000, 240\) is outside the image"),
        ({"camera": {"cy_px": 480.0}}, r"cx_px, cy_px: \(320, 480\) is outside the image"),
        ({"camera": {"crop_px": [0.0, 0.0, 1.0, 1.0]}}, "crop_px needs `calibration`"),
    ],
)
def test_a_camera_that_cannot_be_is_a_configuration_error(tables: dict[str, Any], expected: str) -> None:
    with pytest.raises(ConfigError, match=expected):
        parse_config(tables)


def test_a_fisheye_without_coefficients_sees_to_its_sides_and_needs_no_distortion() -> None:
    """Of 183 degrees; what is 75 degrees aside is in its image, and the pinhole of its focal length ends at 58."""
    size = {"f_px": 400.0, "width_px": 1280.0, "height_px": 1280.0}
    config = parse_config({"camera": {**size, "distortion_model": "fisheye", "distortion": [0.0] * 4}})
    pinhole = parse_config({"camera": size})
    assert in_view((3.7, 0.0), config.camera_model())
    assert not in_view((3.7, 0.0), pinhole.camera_model())
    usual = parse_config({"camera": {**size, "f_px": 1110.0}})  # 60 degrees: nothing there is far off
    assert [needs(c).undistorted for c in (config, pinhole, usual)] == [(), ("front",), ()]
