"""What a scenario's detector finds of the leader, as documents in the bytes of a flight."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

from onboard.config import load_config
from onboard.messages import CameraDetections, CameraPoints, Datagram, Detection, Encoding, Estimate
from onboard.pipeline import Pipeline
from simlink.cli import main
from simlink.scenarios.camera import SEES, Sees
from simlink.scenarios.describe import daemon_config
from simlink.scenarios.scenario import Scenario, ScenarioError, load_scenario
from simlink.simulation import datagrams, simulate

HAS = {
    "points": ({"center", "left", "right", "nose", "tail"}, False, False),
    "box": (set(), True, False),
    "center_box": ({"center"}, True, False),
    "rotor_box": (set(), True, False),
    "pose": (set(), False, True),
    "wing_pose": ({"center", "left", "right"}, False, True),
}


def seen_as(sees: Sees, **changed: object) -> Scenario:
    scenario = load_scenario("formation")
    return msgspec.structs.replace(scenario, camera=msgspec.structs.replace(scenario.camera, sees=sees, **changed))


def detections(scenario: Scenario, seed: int = 1, seconds: float = 1.6) -> list[Detection]:
    found = [d for d in datagrams(scenario, seed, seconds) if isinstance(d, Datagram)]
    documents = [d for d in found if d.encoding is Encoding.DETECTIONS]
    assert not any(d.encoding is Encoding.POINTS for d in found)
    return [x for d in documents for x in msgspec.json.decode(d.data, type=CameraDetections).detections]


@pytest.mark.parametrize("sees", HAS)
def test_each_detector_finds_what_it_is_named_for_seed_1(sees: Sees) -> None:
    found = detections(seen_as(sees))
    assert len(found) > 30
    for one in found:
        assert (set(one.points), one.box is not None, one.pose is not None) == HAS[sees]
        assert one.target == "leader"


def test_a_box_is_around_the_points_of_the_same_flight_seed_1() -> None:
    boxes, points = detections(seen_as("box")), detections(seen_as("points", sigma_px=0.0))
    wide = []
    for one, other in zip(boxes, points, strict=True):
        u = [p.u_px for p in other.points.values()]
        assert abs(one.box.u_px - 0.5 * (min(u) + max(u))) < 0.15 * one.box.width_px
        wide.append(one.box.width_px / np.ptp(u))
    assert 0.8 < np.mean(wide) < 1.2


def test_a_pose_is_where_the_center_is_seen_seed_1() -> None:
    poses, points = detections(seen_as("pose")), detections(seen_as("points", sigma_px=0.0))
    for one, other in zip(poses, points, strict=True):
        x, y, z = one.pose.position_m
        assert (320.0 + 554.256 * x / z, 240.0 + 554.256 * y / z) == pytest.approx(
            (other.points["center"].u_px, other.points["center"].v_px), abs=4.0
        )


def test_noise_is_stated_or_not_seed_1() -> None:
    for states_sigma, expected in ((True, 1.0), (False, None)):
        scenario = seen_as("points", states_sigma=states_sigma)
        scenario = msgspec.structs.replace(scenario, spread=1.0)
        assert {p.sigma_px for d in detections(scenario) for p in d.points.values()} == {expected}
        wing = msgspec.structs.replace(scenario, camera=msgspec.structs.replace(scenario.camera, sees="wing"))
        stated = {e.message.center.sigma_px for e in simulate(wing, 1, 1.0) if isinstance(e.message, CameraPoints)}
        assert stated == {expected}


@pytest.mark.parametrize("sees", SEES)
def test_a_daemon_follows_it_with_what_simlink_config_says_seed_1(sees: Sees, tmp_path: Path) -> None:
    scenario, path = seen_as(sees), tmp_path / "onboard.toml"
    path.write_text(daemon_config(scenario), encoding="utf-8")
    pipeline = Pipeline(load_config(path))
    flown = datagrams(scenario, 1, 2.0)
    outputs = [o for d in flown if isinstance(d, Datagram) for o in pipeline.feed(d)]
    last = [o for o in outputs if isinstance(o, Estimate) and o.name == "leader"][-1]
    assert last.valid, last.reason
    assert last.mean is not None
    assert np.linalg.norm(last.mean[:3]) == pytest.approx(27.7, rel=0.3)
    refused = {name for name in pipeline.health(0).rejected if name.startswith(("bad_", "ignored", "unknown"))}
    assert refused == set()


def test_mavlink_carries_the_wing_only(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(ScenarioError, match="sees is 'pose', but LANDING_TARGET carries 'wing' only"):
        next(simulate(seen_as("pose"), 1, 1.0, "mavlink"))
    path = tmp_path / "boxes.toml"
    path.write_text('[camera]\nsees = "box"\n', encoding="utf-8")
    assert main(["log", str(path), "--out", str(tmp_path / "x.tlog")]) == 2
    assert "boxes: camera.sees is 'box', but LANDING_TARGET" in capsys.readouterr().err
    assert not (tmp_path / "x.tlog").exists()
