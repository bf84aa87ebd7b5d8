"""A flight's folder: the autopilot's log, and beside it the detector's documents, a line each."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np
import pytest

from onboard import UserError
from onboard.analysis.flights.replay import ReplayResult, check_log, replay
from onboard.commands.cli import main
from tests.support.dataflash import BOOT_TIME_S, dataflash
from tests.support.streams import FOCAL_LENGTH_PX, Flight, make_config, write_truth

FLIGHT: Final = Flight(radius=None, gap=25.0)
SECONDS: Final = 9.0
BEGIN: Final = 5.0
DAY_NS: Final = 86_400 * 10**9
TRUE_FROM: Final = BEGIN - 11.0  # the first 15 s of the truth are not scored
CAMERA: Final = ("camera.cx_px=320", "camera.cy_px=240", f"camera.f_px={FOCAL_LENGTH_PX}")


def document(t_ns: int, clock: str, rng: np.random.Generator) -> str:
    pixels = FLIGHT.points(t_ns * 1e-9) * FOCAL_LENGTH_PX + (320, 240) + rng.normal(size=(3, 2))
    points = {
        name: {"u_px": u, "v_px": v}
        for name, (u, v) in zip(("center", "left", "right"), pixels.tolist(), strict=True)
    }
    shift = BOOT_TIME_S * 1_000_000_000 if clock == "host" else 0
    return json.dumps({"t_ns": t_ns + shift, "clock": clock, "detections": [{"points": points}]})


def lines(clock: str) -> list[str]:
    rng = np.random.default_rng(1)
    times = range(round((BEGIN + 0.5) * 1e9), round((BEGIN + SECONDS - 0.5) * 1e9), 40_000_000)
    return [document(t_ns, clock, rng) for t_ns in times]


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("log") / "flight.bin"
    dataflash(FLIGHT, SECONDS, path, begin=BEGIN)
    return path


def folder(tmp_path: Path, log: Path, documents: list[str]) -> Path:
    (tmp_path / "flight").mkdir()
    (tmp_path / "flight" / log.name).write_bytes(log.read_bytes())
    (tmp_path / "flight" / "detections.jsonl").write_text("\n".join(documents) + "\n", encoding="utf-8")
    return tmp_path / "flight"


def ranges(replayed: ReplayResult) -> list[float]:
    last = [e.mean[:3] for e in replayed.estimates[-100:] if e.valid and e.mean is not None]
    assert len(last) > 90
    return [float(np.linalg.norm(r)) for r in last]


@pytest.mark.parametrize("clock", ["boot", "host"])
def test_detections_of_either_clock_are_fused_with_a_dataflash_log(tmp_path: Path, log: Path, clock: str) -> None:
    replayed = replay(folder(tmp_path, log, lines(clock)), make_config(*CAMERA))
    assert max(abs(r - 25.0) for r in ranges(replayed)) < 1.5
    assert replayed.health.verdicts["leader.fused"] > 0.8 * len(lines(clock))
    assert replayed.health.refusals == ()


def test_a_broken_line_costs_that_line_and_is_named(tmp_path: Path, log: Path) -> None:
    documents = lines("boot")
    documents[100:100] = ['{"t_ns": 3', "", '{"detections": []}']
    replayed = replay(folder(tmp_path, log, documents), make_config(*CAMERA))
    assert replayed.health.verdicts["leader.fused"] > 0.8 * len(documents)
    assert {refusal.source for refusal in replayed.health.refusals} == {"detections.jsonl"}
    assert sum(refusal.count for refusal in replayed.health.refusals) == 2


@pytest.mark.parametrize(
    ("clock", "change", "stated", "words"),
    [
        ("host", lambda t: t, "boot", "is Unix time, but `clock` is `boot` "),
        ("boot", lambda t: t, "host", "is the autopilot's time since its boot, but `clock` is `host` "),
        (
            "host",
            lambda t: t // 10**6,
            "host",
            "is Unix time in milliseconds, expected are nanoseconds (images 17",
        ),
        ("boot", lambda t: t // 10**3, "boot", "is the autopilot's time since its boot in microseconds"),
        ("host", lambda t: t - 7 * DAY_NS, "host", "of a clock that is 7 days behind (images 2024-12-24 "),
        ("host", lambda t: t + 1024 * 7 * DAY_NS, "host", "of a clock that is 1 x 1,024 weeks ahead"),
        ("host", lambda t: t + DAY_NS // 12, "host", "of a clock that is 2 hours ahead"),
        ("boot", lambda t: t + 10**16, "boot", " lines are later than the log's end, the first with `t_ns` of 1"),
    ],
)
def test_stamps_of_the_wrong_clock_are_explained(
    clock: str, change: Callable[[int], int], stated: str, words: str, tmp_path: Path, log: Path
) -> None:
    """And the detector is not blamed for a camera that sees nothing."""
    documents = [json.loads(line) for line in lines(clock)]
    changed = [json.dumps(d | {"t_ns": change(d["t_ns"]), "clock": stated}) for d in documents]
    health = replay(folder(tmp_path, log, changed), make_config(*CAMERA)).health
    (refusal,) = [r for r in health.refusals if r.source == "detections.jsonl"]
    assert words in refusal.reason
    assert "camera-silent" not in {advice.cause for advice in health.advice}


def test_a_folder_s_own_configuration_and_truth_are_used(
    tmp_path: Path, log: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    flight = folder(tmp_path, log, lines("boot"))
    (flight / "config.toml").write_text(
        f"[camera]\nf_px = {FOCAL_LENGTH_PX}\ncx_px = 320.0\ncy_px = 240.0\n"
        "[estimator.leader]\nsize_prior_m = 2.0\n",
        encoding="utf-8",
    )
    write_truth(flight / "truth.csv", FLIGHT, np.arange(TRUE_FROM, BEGIN + SECONDS, 0.1).tolist())
    assert main(["replay", str(flight), "--json", str(tmp_path / "score.json")]) == 0
    score = json.loads((tmp_path / "score.json").read_text("utf-8"))
    assert score["range_error_rms_percent"] < 5
    assert score["scored"] > 50
    assert "flight" in capsys.readouterr().out


def test_a_folder_without_one_log_is_refused(tmp_path: Path, log: Path) -> None:
    flight = folder(tmp_path, log, [])
    (flight / "second.tlog").write_bytes(b"")
    with pytest.raises(UserError, match=r"expected one log .*flight.bin, second.tlog"):
        replay(flight, make_config())


@pytest.mark.parametrize(
    ("head", "words"),
    [
        (b"\x1f\x8b\x08", "`gunzip` it"),
        (b"\xfe\x09\x00", "as Mission Planner's .rlog: replay the .tlog"),
        (b"PK\x03\x04", "ZIP archive: unpack"),
        (b"SQLite format 3\0", "bag of ROS 2"),
        (b"#ROSBAG V2.0", "bag of ROS 1"),
        (b"FMT, 128, 89, FMT", "DataFlash log as text"),
    ],
)
def test_a_log_of_another_kind_is_named_for_what_it_is(head: bytes, words: str, tmp_path: Path) -> None:
    (tmp_path / "flight.log").write_bytes(head + bytes(100))
    with pytest.raises(UserError, match=rf"is no \.tlog.*{words}"):
        check_log(tmp_path / "flight.log")
