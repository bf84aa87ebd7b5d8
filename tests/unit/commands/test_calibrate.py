"""Calibration from a flight that weaves behind a calm leader: the corrections that were put in come out."""

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

from onboard import UserError
from onboard.arrays import Array
from onboard.commands import cli
from onboard.commands.calibrate import Calibration, Images, calibrate, described
from onboard.config import load_config
from onboard.geometry.camera import make_camera
from onboard.geometry.rotations import matrix_from_euler, quaternion_from_euler
from onboard.health.camera_errors import Poses
from onboard.messages import Attitude, LocalPosition, Message, TargetPoints
from tests.support.records import record
from tests.support.streams import EPOCH, Item, S, encode, heartbeat

F_PX = 554.0
CAMERA = make_camera(f_px=F_PX, width_px=640.0, height_px=480.0)
SPEED, SIZE = 12.0, 2.0
DELAY, FOCAL = 0.08, 1.04
MOUNT_DEG = (1.5, -2.0, 2.5)  # roll, pitch, yaw


class Weaving:
    """We weave by `weave` degrees to either side every six seconds, banked; the leader flies on, hardly moving."""

    def __init__(self, weave: float = 15.0) -> None:
        self._weave = np.radians(weave)
        fine = np.arange(0.0, 80.0, 0.001)
        heading = self._weave * np.sin(fine * np.pi / 3)
        self._fine, self._x = fine, np.cumsum(SPEED * np.cos(heading)) * 0.001
        self._y, self._mean = np.cumsum(SPEED * np.sin(heading)) * 0.001, float(np.mean(np.cos(heading)))

    def own(self, t: float) -> tuple[Array, tuple[float, float, float]]:
        rate = self._weave * np.pi / 3 * np.cos(t * np.pi / 3)
        roll, pitch = np.arctan(SPEED * rate / 9.81), np.radians(4.0) * np.sin(2 * np.pi / 4.3 * t)
        x, y = np.interp(t, self._fine, self._x), np.interp(t, self._fine, self._y)
        r = np.array([x, y, -50 + 1.5 * np.sin(0.7 * t)])
        return r, (float(roll), float(pitch), float(self._weave * np.sin(t * np.pi / 3)))

    def leader(self, t: float) -> Array:
        return np.array([28 + SPEED * self._mean * t, 2 * np.sin(0.15 * t), -51 + np.sin(0.2 * t)])

    def points(self, t: float, rng: np.random.Generator) -> Array:
        """Center, left and right in nominal focal lengths, with a pixel of noise."""
        r, rpy = self.own(t)
        R_cn = (matrix_from_euler(*rpy) @ matrix_from_euler(*np.radians(MOUNT_DEG))).T
        wing = np.array([0.0, SIZE / 2, 0.0])
        c = np.array([R_cn @ (self.leader(t) + side * wing - r) for side in (0, -1, 1)])
        points: Array = FOCAL * c[:, 1:] / c[:, :1] + rng.normal(size=(3, 2)) / F_PX
        return points


def flight(seed: int, weave: float = 15.0, seconds: float = 50.0) -> tuple[Images, Poses]:
    flown, rng = Weaving(weave), np.random.default_rng(seed)
    t = np.arange(0.0, seconds + 2, 0.02)
    own = [flown.own(float(x)) for x in t]
    motion = Poses(t, np.array([r for r, _ in own]), np.array([quaternion_from_euler(*rpy) for _, rpy in own]))
    exposed = np.arange(2.0, seconds, 1 / 8)
    points = np.array([flown.points(float(x), rng) for x in exposed])
    span = np.linalg.norm(points[:, 2] - points[:, 1], axis=1)
    return Images(exposed + DELAY, points[:, 0], span, np.full(len(exposed), 1 / F_PX)), motion


def assert_found(found: Calibration) -> None:
    assert found.delay == pytest.approx(DELAY, abs=0.010)
    assert found.focal == pytest.approx(FOCAL, rel=0.01)
    assert np.degrees(found.mount) == pytest.approx(MOUNT_DEG, abs=0.3)


def test_delay_mount_and_focal_length_are_found_seed_1() -> None:
    found = calibrate(*flight(1), CAMERA, SIZE)
    assert_found(found)
    assert np.sqrt(np.mean(found.after**2)) == pytest.approx(1.0, abs=0.1)
    assert np.mean(found.before**2) > 1.05 * np.mean(found.after**2)


def test_outliers_do_not_turn_the_result_seed_2() -> None:
    images, own = flight(2)
    images.center[::20] += 0.2
    found = calibrate(images, own, CAMERA, SIZE)
    assert found.delay == pytest.approx(DELAY, abs=0.010)
    assert np.degrees(found.mount) == pytest.approx(MOUNT_DEG, abs=0.5)


def test_a_leader_that_is_far_from_calm_ends_in_no_error_seed_3() -> None:
    images, own = flight(3, seconds=25.0)
    swerving = images._replace(center=images.center + 0.3 * np.sin(np.arange(len(images.t)) / 3.0)[:, None])
    found = calibrate(swerving, own, CAMERA, SIZE)
    assert abs(found.delay) <= 0.45
    for off in (found._replace(mount=np.array([0.0, 0.9, 0.0])), found._replace(delay=0.44)):
        assert described(off, load_config(None), CAMERA)[-1].startswith("not to be trusted: so large an error")
    assert np.isfinite([found.delay_sigma, found.focal_sigma, *found.mount_sigma]).all()


def test_too_few_images_are_refused() -> None:
    images, own = flight(1, seconds=5.0)
    with pytest.raises(UserError, match="images with our own pose: at least 100"):
        calibrate(images, own, CAMERA, SIZE)


def recording(folder: Path) -> Path:
    """The same flight as the daemon records it."""
    flown, rng, items = Weaving(), np.random.default_rng(1), []
    for ms in range(0, 42_000, 20):
        t_ns, t = ms * 1_000_000 + 5 * S, ms / 1000
        head = {"t_ns": t_ns, "t_recv_ns": EPOCH + t_ns}
        r, rpy = flown.own(t)
        q, ahead = quaternion_from_euler(*rpy), flown.own(t + 1e-3)[0]
        messages: list[Message] = [heartbeat(t_ns)] if ms % 1000 == 0 else []
        velocity = tuple(((ahead - r) * 1e3).tolist())
        messages += [
            Attitude(**head, q_nb=tuple(q.tolist()), omega_b=(0.0, 0.0, 0.0)),
            LocalPosition(**head, r_OF_n=tuple(r.tolist()), v_F_n=velocity),
        ]
        if ms % 80 == 0 and t >= DELAY:
            center, left, right = map(tuple, flown.points(t - DELAY, rng).tolist())
            messages.append(TargetPoints(**head, camera="landing_target", center=center, left=left, right=right))
        items += [Item(EPOCH + t_ns + 2_000_000, m) for m in messages]
    return record(folder / "weave.mcap", encode(items))


def test_the_command_prints_lines_to_paste_and_draws_the_residuals_seed_1(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, svg = recording(tmp_path), tmp_path / "r.svg"
    sets = [f"camera.f_px={F_PX}", f"estimator.leader.size_prior_m={SIZE}"]
    arguments = ["calibrate", str(log), "--svg", str(svg), "--set", *sets]
    assert cli.main(arguments) == 0
    printed = capsys.readouterr().out
    pasted = dict(re.findall(r"^(\w+) = (.+)$", printed, re.MULTILINE))
    assert float(pasted["delay_s"]) == pytest.approx(DELAY, abs=0.010)
    assert float(pasted["f_px"]) == pytest.approx(FOCAL * F_PX, rel=0.01)
    angles = [float(x) for x in pasted["mount_rpy_deg"].strip("[]").split(",")]
    assert angles == pytest.approx(MOUNT_DEG, abs=0.35)
    assert len(ET.parse(svg).findall(".//{*}circle")) > 1000  # noqa: S314 - our own picture


def test_another_camera_is_calibrated_by_its_name_seed_1(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Advice on it said that `onboard calibrate` finds what is wrong, which knew the first one alone."""
    name, log = "landing_target", recording(tmp_path)
    sets = [f"cameras.{name}.f_px={F_PX}", f"cameras.{name}.delay_s=0.05", f"estimator.leader.size_prior_m={SIZE}"]
    assert cli.main(["calibrate", str(log), "--camera", name, "--set", *sets]) == 0
    pasted = capsys.readouterr().out.partition(f"[cameras.{name}]\n")[2]
    assert float(pasted.partition("delay_s = ")[2].splitlines()[0]) == pytest.approx(DELAY, abs=0.010)
    assert cli.main(["calibrate", str(log), "--camera", "rear", "--set", *sets]) == 2
    assert "`--camera` is front or landing_target" in capsys.readouterr().err
