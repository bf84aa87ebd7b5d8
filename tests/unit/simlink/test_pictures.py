"""Drawn pictures, and the example detectors on them: what is found is where it is."""

import importlib.util
import sys
from itertools import islice
from pathlib import Path
from types import ModuleType
from typing import Any

import cv2
import numpy as np
import pytest
from msgspec.structs import replace

from onboard.messages import Clock
from simlink.cli import main
from simlink.scenarios.scenario import Scenario, load_scenario
from simlink.sensors.camera import mount_quaternion, project
from simlink.sensors.pictures import Painter, picture_detector
from simlink.world.truth import State, states, true_size

EXAMPLES = Path(__file__).parents[3] / "examples"
EVERY = 960  # steps between two pictures
NAMES = ("center", "left", "right")


def example(name: str) -> ModuleType:
    """A module of the folder of examples."""
    sys.path.insert(0, str(EXAMPLES))
    try:
        spec = importlib.util.spec_from_file_location(f"example_{name}", EXAMPLES / f"{name}.py")
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module
    finally:
        sys.path.remove(str(EXAMPLES))


def painted(kind: str, seed: int = 1, count: int = 5) -> tuple[Scenario, list[tuple[State, Any]], Painter]:
    base = load_scenario("formation")
    scenario = replace(base, camera=replace(base.camera, pictures=kind))
    painter = Painter(scenario.camera, true_size(scenario, seed), seed)
    some = islice(states(scenario, seed), 0, count * EVERY, EVERY)
    return scenario, [(state, painter.paint(state)) for state in some], painter


@pytest.mark.parametrize(
    ("kind", "name", "largest"), [("aircraft", "contour", (0.9, 0.3)), ("tag", "tag", (0.6, 0.4))]
)
def test_an_example_detector_finds_the_leader_to_a_pixel_seed_1(
    kind: str, name: str, largest: tuple[float, float]
) -> None:
    scenario, pictures, _ = painted(kind)
    find, camera = example(name).find, scenario.camera
    for state, picture in pictures:
        found = find(picture)
        truth = project(state, true_size(scenario, 1), camera, mount_quaternion(camera))
        assert found is not None
        assert truth is not None
        pixels = {
            n: camera.f_px * np.array([y, z]) + [320.0, 240.0] for n, (y, z) in zip(NAMES, truth, strict=True)
        }
        for n, (u, v, _) in found.items():
            off = np.array([u, v]) - pixels[n]
            assert (np.abs(off) < largest).all(), (n, off)


@pytest.mark.parametrize("name", ["contour", "tag"])
def test_a_detector_finds_nothing_where_nothing_is(name: str) -> None:
    _, ((state, _), *_), painter = painted("tag" if name == "tag" else "aircraft", count=1)
    away = state._replace(r_OL_n=tuple(np.array(state.r_OF_n) - 1000 * (np.array(state.r_OL_n) - state.r_OF_n)))
    empty = painter.paint(away)
    assert empty.shape == (480, 640)
    assert example(name).find(empty) is None
    assert example(name).find(np.zeros((480, 640), dtype=np.uint8)) is None


def test_pictures_are_the_same_again_and_survive_jpeg_seed_1() -> None:
    _, ((state, first), *_), _ = painted("aircraft", count=1)
    _, _, painter = painted("aircraft", count=0)
    picture = painter.picture(state, 7)
    grey = cv2.imdecode(np.frombuffer(picture.jpeg, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert (picture.t_ns, picture.clock, picture.camera) == (7, Clock.BOOT, "front")
    assert np.abs(grey.astype(float) - first).mean() < 2.0
    assert len(picture.jpeg) < 150_000  # of 262,144 in our Zenoh; JSON needs a third more


def test_what_a_detector_finds_is_an_image_of_the_leader_and_nothing_is_none_seed_1() -> None:
    _, ((state, _), *_), painter = painted("aircraft", count=1)
    points = {"left": (1.0, 2.0, 0.5), "right": (3.0, 4.0, 0.25)}
    image = picture_detector(lambda picture: points if picture.shape == (480, 640) else None, painter)(state, 7)
    assert image is not None
    ((found,), t_ns) = image.detections, image.t_ns
    assert (t_ns, found.target) == (7, "leader")
    assert {n: (p.u_px, p.v_px, p.sigma_px) for n, p in found.points.items()} == points
    assert picture_detector(lambda _: None, painter)(state, 7) is None


def test_without_opencv_a_run_with_pictures_says_what_is_missing(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "cv2", None)
    assert (
        main(["run", "pictures", "--mavlink", "none", "--tcp", "none", "--zenoh", "none", "--camera", "none"]) == 2
    )
    assert "simlink: pictures need OpenCV; run `pip install opencv-python-headless`" in capsys.readouterr().err
