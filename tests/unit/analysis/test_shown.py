"""What commands print of scores, comparisons and calibrations that are made by hand."""

import argparse
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from onboard import UserError
from onboard.analysis.calibration.airframe import AirframeFit, AirframeMeasures, FittedValue
from onboard.analysis.flights.baseline import Baseline
from onboard.analysis.flights.compare import print_comparison, variants
from onboard.analysis.flights.many import FlightScores
from onboard.commands import demo, demo_flight
from onboard.commands.calibrate import Calibration, described, picture
from onboard.commands.calibrate_airframe import described_airframe
from onboard.commands.demo_flight import DemoFlight
from onboard.commands.evaluate import print_rows, rows_of
from onboard.config import load_config
from onboard.geometry.camera import make_camera
from onboard.messages import SimStatus
from onboard.scoring.leader import LeaderScore, score_leader
from onboard.scoring.scorecard import OwnStateSummary
from onboard.terminal.console import Console
from onboard.view.client import PublishedRecord
from tests.support import made_flight
from tests.support.golden import assert_golden, numbers, rounded
from tests.support.vehicle_records import truth

CALIBRATION = """
image_width: 640
image_height: 480
camera_matrix: {rows: 3, cols: 3, data: [554, 0, 320, 0, 554, 240, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [0, 0, 0, 0, 0]}
"""
ABOUT = load_config(None, ("estimator.leader.size_prior_m=2.0",))


@pytest.fixture(autouse=True)
def wide(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "160")


def scored(**changed: Any) -> LeaderScore:
    return replace(score_leader([], None), **changed)


def test_scores_of_many_flights(capsys: pytest.CaptureFixture[str]) -> None:
    good = {
        "valid_percent": 98.0,
        "range_error_rms_percent": 3.0,
        "position_rmse_m": 1.0,
        "velocity_rmse_m_s": 0.5,
    }
    share = {"confidently_wrong_percent": 1.25, "inside_95_percent": 90.0}
    flights = [
        FlightScores("a/1", "a", 10.0, {"leader": scored(**good, **share), "paper": scored(valid_percent=50.0)}),
        FlightScores(
            "a/2", "a", 10.0, {"leader": scored(**(good | {"range_error_rms_percent": 4.0}), diverged=True)}
        ),
        FlightScores("b/1", "b", 10.0, {"leader": scored(position_rmse_m=7.0), "paper": scored(diverged=True)}),
    ]
    print_rows(Console(), rows_of(flights))
    print_rows(Console(), {"empty": {"none": rows_of(flights)["b"]["paper"]}}, "log")
    own = OwnStateSummary()
    for k in range(1, 199):
        own.add(made_flight.own_state(k))
    own.print(Console())
    scores = {"leader": scored(**good, **share), "flown": scored(valid_percent=12.0)}
    print_comparison(Console(), scores, {"own_state": own, "nothing": OwnStateSummary()})
    print_comparison(Console(), scores, {})
    assert_golden("scores.txt", [capsys.readouterr().out])


def test_words_of_a_comparison() -> None:
    sets = ("estimator.leader={}", "estimator.own_state={}", "camera.cy_px=200")
    words = ["flown", "paper", "svsf", "cubature", "near:camera.f_px=500;camera.cx_px=300", "camera.f_px=600"]
    lines = []
    for name, config in variants(words, None, sets).items():
        sections = {key: getattr(section, "filter", "") for key, section in config.estimator.items()}
        camera = config.camera
        lines.append(f"{name}: {sections} {camera.f_px} {camera.cx_px} {camera.cy_px}")
    for wrong in ("nonsense", "leader:camera.f_px=1", "flown"):
        with pytest.raises(UserError) as caught:
            variants(["flown", wrong], None, sets)
        lines.append(str(caught.value)[:150])
    lines.append(demo_flight.flown_beside("paper", ABOUT))
    assert_golden("compare.txt", lines)


def test_the_baseline_is_as_good_as_its_images() -> None:
    pytest.importorskip("filterpy", reason="needs filterpy: the baseline")
    baseline, found = Baseline(ABOUT), []
    for k in range(1, 300):
        t = k / 10
        pose = made_flight.own_pose(t - 0.06)
        baseline.follow(replace(pose, q_nb=(1.0, 0.0, 0.0, 0.0)))
        estimate = made_flight.leader(k)
        if not 20.0 < t < 23.0:
            found += [one for one in (baseline.follow(estimate), baseline.follow(estimate)) if one is not None]
    assert baseline.follow(made_flight.leader(330)) is None  # no pose at its time
    off = [np.array(one.mean[:6]) - made_flight.true_motion(one.t_ns * 1e-9)[:6] for one in found]
    sigmas = [np.sqrt(np.diag(one.covariance)) for one in found]
    lines = [f"{one.sequence} {one.t_ns}" for one in found[:: len(found) - 1]]
    lines += [
        f"{numbers(errors)}; sigma {numbers(sigma)}"
        for errors, sigma in zip(np.transpose(off), np.transpose(sigmas)[:6], strict=True)
    ]
    assert_golden("baseline.txt", [*lines, numbers(np.transpose(sigmas)[6:])])


def calibrations() -> Iterator[tuple[str, Calibration]]:
    rng = np.random.default_rng(1)
    t, before, after = np.arange(0.0, 4.0, 0.5) + 7.0, rng.normal(size=(8, 2)) * 3.0, rng.normal(size=(8, 2))
    known = Calibration(
        t, 0.0123, 0.004, np.radians([1.5, -2.0, 2.5]), np.radians([0.2, 0.3, 0.1]), 1.04, 0.005, before, after
    )
    yield "known", known
    yield "delay unknown", known._replace(delay_sigma=0.02)
    yield "mount unknown", known._replace(mount_sigma=np.radians([0.2, 0.5, 0.1]))
    yield "focal unknown", known._replace(focal_sigma=0.02)
    yield (
        "nothing known",
        known._replace(delay_sigma=0.02, mount_sigma=np.radians([1.0, 1.0, 1.0]), focal_sigma=1.0),
    )
    yield "turned", known._replace(mount=np.radians([0.0, -20.01, 0.0]))
    yield "hardly", known._replace(mount=np.radians([0.0, -20.0, 0.0]), delay=-0.4)
    yield "late", known._replace(delay=-0.401)


def test_calibrations(tmp_path: Path) -> None:
    lens = {"f_px": 554.0, "width_px": 640.0, "height_px": 480.0}
    rear = load_config(None, ("cameras.rear.f_px=400", "cameras.rear.fy_px=410", "cameras.rear.delay_s=0.05"))
    delayed = load_config(None, ("delay.camera_s=0.03",))
    file = tmp_path / "camera.yaml"
    file.write_text(CALIBRATION, encoding="utf-8")
    measured = load_config(None, (f"camera.calibration={file}",))
    lines, found = [], dict(calibrations())
    for name, one in found.items():
        lines += [f"CAMERA {name}", *described(one, ABOUT, make_camera(**lens))]
    for config, camera in (
        (rear, rear.camera_model().named("rear")),
        (delayed, make_camera(**lens)),
        (measured, make_camera(**lens)),
    ):
        lines += ["OTHER", *described(found["known"], config, camera)]
    lines += [rounded(picture(found["known"]))]
    known = AirframeMeasures(
        0.6, np.array([[0.2, 0.0, 1.0], [0.0, 0.2, -1.0], [-0.2, 0.0, 1.0], [0.0, -0.2, -1.0]]), 0.02, 1.0
    )
    fit = AirframeFit(
        *(FittedValue(value, 0.1 * value) for value in (3.4, 0.13, 5.5e-3, 4.1e-3, 3.125)),
        hover=0.61,
        windows=80,
        window=0.6,
    )
    cases = {
        "all": fit,
        "no drag": fit._replace(drag=FittedValue(0.1, 0.05)),
        "no torque": fit._replace(torque_over_izz=FittedValue(3.0, 0.45)),
        "nothing": fit._replace(thrust=FittedValue(-1.0, 0.1), ixx=FittedValue(0.0, 0.1)),
    }
    for name, one in cases.items():
        lines += [f"AIRFRAME {name}", *described_airframe(one, known, (1000.0, 2000.0))]
    lines += ["VOLTAGE", *described_airframe(fit, known._replace(full_voltage=16.8), (1100.0, 1900.0))]
    assert_golden("calibrations.txt", lines)


class Records:
    """The daemon and the simulator of a demo, which send the flight made by hand."""

    def __init__(self) -> None:
        health = made_flight.health(ABOUT)
        offset_ns = health.clock_offset_ns or 0
        sent: list[tuple[Any, int | None]] = [(health, 0)]
        for output in made_flight.outputs():
            if output.t_ns % 200_000_000 == 0 and getattr(output, "name", "") == "leader":
                r, v = (
                    made_flight.true_motion(output.t_ns * 1e-9)[:3],
                    made_flight.true_motion(output.t_ns * 1e-9)[3:6],
                )
                sent.append((truth(output.t_ns, r_FL_n=r, v_FL_n=v), None))
            if output.t_ns != 5_000_000_000:  # one estimate is lost
                sent.append((output, offset_ns + output.t_ns + output.t_ns // 10_000))
        sent.append((made_flight.leader(399, "paper", 0.3), offset_ns))
        self._sent = [
            PublishedRecord(*one) for one in (*sent, (SimStatus(t_ns=1, images=360, frames=9, finished=True), 0))
        ]
        self.popen = SimpleNamespace(poll=lambda: None)
        self.checked = 0

    def take(self, _: float) -> PublishedRecord | None:
        return self._sent.pop(0) if self._sent else None

    def check(self) -> None:
        self.checked += 1

    def flight(self, progress: list[str]) -> DemoFlight:
        def on_progress(seconds: float, newest: Any) -> None:
            progress.append(f"{seconds:.1f} s {demo.in_words(newest)}")

        return demo_flight._watch(self, None, (self, self), (self,), on_progress, lambda: None)


def test_a_demo(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(demo_flight, "LINGER_TIME_S", 0.0)
    monkeypatch.setattr(demo_flight, "_health_wait", lambda _: 0.0)
    progress: list[str] = []
    records = Records()
    report = demo_flight._report(records.flight(progress), "formation", 1, 40.0)
    monkeypatch.setattr(demo, "run_demo", lambda **_: report)
    given = {"detector": None, "beside": None, "scenario": "formation", "seed": 1, "duration": 40.0, "set": []}
    monkeypatch.chdir(tmp_path)
    arguments = argparse.Namespace(**given, out=Path("out"), json=Path("score.json"), headless=True)
    assert demo.main(arguments) == 0
    shown, written = capsys.readouterr().out, rounded(Path("score.json").read_text("utf-8"))
    report = replace(report, score=replace(report.score, diverged=True))
    assert demo.main(arguments) == 1
    lines = [*progress[:12], *progress[-2:], shown, written]
    assert_golden("demo.txt", lines)


@pytest.mark.parametrize(
    ("change", "own", "images", "failed"),
    [
        ({"diverged": True}, None, 100, True),
        ({"diverged": True}, 100.0, 100, True),
        ({"diverged": True}, 100.0, 0, False),  # alone, there is no leader to be seen
        ({"diverged": True}, None, 0, True),
        ({"confidently_wrong_percent": 50.0}, 50.0, 100, False),
        ({"confidently_wrong_percent": 50.1}, 50.0, 100, True),
        ({}, 49.9, 100, True),
        ({}, 49.9, 0, True),
        ({}, None, 100, False),
    ],
)
def test_a_demo_fails_by_what_it_showed(
    change: dict[str, Any], own: float | None, images: int, failed: bool
) -> None:
    report = demo_flight._report(Records().flight([]), "formation", 1, 40.0)
    state = None if own is None or report.own_state is None else replace(report.own_state, valid_percent=own)
    drops = replace(report.drops, images_sent=images)
    assert demo.has_failed(replace(report, score=scored(**change), own_state=state, drops=drops)) is failed
