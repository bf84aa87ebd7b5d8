"""`onboard report`: the verdict and its thresholds, and a page that needs no other file."""

import re
from pathlib import Path

import pytest

from onboard.commands.cli import main
from onboard.commands.log_replay import ReplayResult, replay
from onboard.commands.report_page import summary
from onboard.commands.report_series import FlightSeries
from onboard.commands.report_verdict import Check, Grade, judge, worst
from onboard.config import Config
from onboard.messages import Output, Verdict
from onboard.scoring.leader import LeaderScorer
from onboard.sinks.recorder import Recorder
from tests.support.streams import Stream, make_config

SIZE = ("--set", "estimator.leader.size_prior_m=2.0")


def seen(t: float) -> bool:
    """Whether the leader is in the image: it is away for six seconds."""
    return not 24.0 < t < 30.0


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("report") / "flight.mcap"
    record(path, Stream(t1=35.0, images=seen))
    return path


def record(path: Path, stream: Stream) -> None:
    recorder = Recorder(path)
    recorder.open()
    recorder.write(stream.datagrams())
    recorder.close()


def collected(log: Path, config: Config) -> tuple[FlightSeries, list[Check], ReplayResult]:
    series, scorer = FlightSeries("leader"), LeaderScorer(None)

    def take(output: Output) -> None:
        series.add(output)
        if getattr(output, "name", "") == "leader":
            scorer.add(output)

    replayed = replay(log, config, take=take, keep=False)
    return series, judge(series, scorer.score(replayed.end), replayed), replayed


def grades(checks: list[Check]) -> dict[str, Grade]:
    return {check.name: check.grade for check in checks}


def test_a_gap_is_amber_and_is_measured(log: Path) -> None:
    series, checks, replayed = collected(log, make_config())
    found = grades(checks)
    assert found["leader: longest gap"] is Grade.AMBER
    assert series.longest_gap_s == pytest.approx(4.0, abs=0.3)  # six seconds less two of prediction
    assert found["images: NIS, of its expectation"] is Grade.PASS
    assert found["rate: Attitude"] is Grade.PASS
    assert worst(checks) is Grade.AMBER
    assert "leader: longest gap" in summary(checks)
    assert series.counts[Verdict.FUSED] == replayed.health.verdicts["leader.fused"]


def test_a_wrong_camera_is_no_pass_and_says_what_to_do(log: Path) -> None:
    _, checks, _ = collected(log, make_config("camera.mount_rpy_deg=[30,0,40]"))
    assert worst(checks) is not Grade.PASS
    bad = [
        check for check in checks if check.name.startswith(("leader", "images")) and check.grade is not Grade.PASS
    ]
    assert bad
    assert all(check.advice for check in bad)


def test_rejected_images_have_their_times(log: Path) -> None:
    series, _, _ = collected(log, make_config("estimator.leader.edge_px=239"))
    rejected = series.rejected[Verdict.OUT_OF_VIEW]
    assert rejected.number == series.counts[Verdict.OUT_OF_VIEW] > 10
    assert 5.0 <= rejected.first_s < rejected.last_s < 35.0


def test_the_page_needs_no_other_file_and_is_the_same_every_time(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pages = [tmp_path / "a.html", tmp_path / "b.html"]
    for page in pages:
        assert main(["report", str(log), *SIZE, "--out", str(page), "--pdf", str(tmp_path / "a.pdf")]) == 0
    text = pages[0].read_text("utf-8")
    assert capsys.readouterr().out.startswith("AMBER: leader: valid")
    assert re.findall(r"<b>(PASS|AMBER|FAIL)</b>", text) == ["AMBER"]
    assert text.count("<svg") == 3
    assert not re.search(r"(src|href)=['\"](?!#)", text)
    assert "size_prior_m" in text
    assert text == pages[1].read_text("utf-8")
    assert (tmp_path / "a.pdf").read_bytes().startswith(b"%PDF")


def test_a_fail_is_exit_code_1(tmp_path: Path) -> None:
    record(tmp_path / "short.mcap", Stream(t1=8.0))  # no estimate after the first 15 s
    assert main(["report", str(tmp_path / "short.mcap"), *SIZE, "--out", str(tmp_path / "out.html")]) == 1


def test_an_autopilot_alone_has_a_report(tmp_path: Path) -> None:
    path = tmp_path / "alone.mcap"
    record(path, Stream(t1=7.0, images=lambda _: False))
    assert main(["report", str(path), "--out", str(tmp_path / "out.html")]) == 0
