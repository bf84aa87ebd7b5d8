"""`onboard report`: the verdict and its thresholds, and a page that needs no other file."""

import re
from copy import deepcopy
from functools import cache
from pathlib import Path

import msgspec
import numpy as np
import pytest

from onboard.analysis.flights.replay import ReplayResult, replay
from onboard.analysis.report.figures import figures
from onboard.analysis.report.page import FlightReport, _table_pages, summary, write_pdf
from onboard.analysis.report.series import FlightSeries
from onboard.analysis.report.verdict import (
    AUTOPILOT_RATES,
    OUR_RATES,
    STREAM_RATES,
    Check,
    Grade,
    judge,
    worst,
)
from onboard.commands.cli import main
from onboard.messages import Output, Verdict
from onboard.scoring.leader import LeaderScorer
from tests.support.records import record
from tests.support.streams import TRUTH_COLUMNS, Stream, make_config

SIZE = ("--set", "estimator.leader.size_prior_m=2.0")
TRUTH = f"{TRUTH_COLUMNS}\n1,30,0,0,0,0,0,2\n99,30,0,0,0,0,0,2\n"


def seen(t: float) -> bool:
    """Whether the leader is in the image: it is away for five and a half seconds."""
    return not 20.5 < t < 26.0


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("report") / "flight.mcap"
    record(path, Stream(t1=30.0, images=seen, sparse=True).datagrams())
    return path


@cache
def collected(log: Path, *overrides: str) -> tuple[FlightSeries, list[Check], ReplayResult]:
    """Of one replay for all that ask for the same: nobody changes it."""
    series, scorer = FlightSeries("leader"), LeaderScorer(None)

    def take(output: Output) -> None:
        series.add(output)
        if getattr(output, "name", "") == "leader":
            scorer.add(output)

    replayed = replay(log, make_config(*overrides), take=take, keep=False)
    return series, judge(series, scorer.score(replayed.end), replayed), replayed


def grades(checks: list[Check]) -> dict[str, Grade]:
    return {check.name: check.grade for check in checks}


def test_a_gap_is_amber_and_is_measured(log: Path) -> None:
    series, checks, replayed = collected(log)
    found = grades(checks)
    assert found["leader: longest gap"] is Grade.AMBER
    assert series.longest_gap_s == pytest.approx(3.5, abs=0.3)  # five and a half seconds less two of prediction
    assert found["images: NIS, of its expectation"] is Grade.PASS
    assert found["rate: Attitude"] is Grade.PASS
    assert worst(checks) is Grade.AMBER
    assert "leader: longest gap" in summary(checks)
    assert series.counts[Verdict.FUSED] == replayed.health.verdicts["leader.fused"]


def test_a_wrong_camera_is_no_pass_and_says_what_to_do(log: Path) -> None:
    _, checks, _ = collected(log, "camera.mount_rpy_deg=[30,0,40]")
    assert worst(checks) is not Grade.PASS
    bad = [
        check for check in checks if check.name.startswith(("leader", "images")) and check.grade is not Grade.PASS
    ]
    assert bad
    assert all(check.advice for check in bad)


def test_rejected_images_have_their_times(log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("onboard.estimators.leader.config.Config.edge_px", 239.0)
    series, _, _ = collected.__wrapped__(log)
    rejected = series.rejected[Verdict.OUT_OF_VIEW]
    assert rejected.number == series.counts[Verdict.OUT_OF_VIEW] > 10
    assert 5.0 <= rejected.first_s < rejected.last_s < 30.0


def test_the_page_needs_no_other_file_and_is_the_same_every_time(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pages = [tmp_path / "a.html", tmp_path / "b.html"]
    for page, pdf in zip(pages, (["--pdf", str(tmp_path / "a.pdf")], []), strict=True):
        assert main(["report", str(log), *SIZE, "--out", str(page), *pdf]) == 0
    text = pages[0].read_text("utf-8")
    assert capsys.readouterr().out.startswith("AMBER: leader: valid")
    assert re.findall(r"<b>(PASS|AMBER|FAIL)</b>", text) == ["AMBER"]
    assert text.count("<svg") == 4
    assert "Our own vehicle, as the autopilot has it" in text
    assert not re.search(r"(src|href)=['\"](?!#)", text)
    assert "size_prior_m" in text
    assert text == pages[1].read_text("utf-8")
    assert (tmp_path / "a.pdf").read_bytes().startswith(b"%PDF")


def test_the_page_names_files_and_shows_no_path(log: Path, tmp_path: Path) -> None:
    page, truth = tmp_path / "report.html", tmp_path / "truth.csv"
    truth.write_text(TRUTH, encoding="utf-8")
    main(["report", str(log), *SIZE, "--out", str(page), "--truth", str(truth)])
    text = page.read_text(encoding="utf-8")
    assert f"{log.name}, " in text
    assert truth.name in text
    assert str(log.parent) not in text
    assert str(tmp_path) not in text


def test_the_pdf_has_the_tables_that_the_page_has(tmp_path: Path) -> None:
    rows = [(str(k), "of our own motion", "12.5") for k in range(60)]
    tables = {"Streams": [("message", "what", "rate, Hz"), *rows], "Faults": [("fault", "from, s")]}
    pages = [[text.get_text() for text in page.texts] for page in _table_pages(tables)]
    assert [page[0] for page in pages] == ["Streams", "Streams, from row 53"]
    assert [page[1] for page in pages] == ["message"] * 2
    shown = [cell for page in pages for cell in page[4::3]]
    assert shown == [row[0] for row in rows]
    report = FlightReport("a", [], [], {}, tables, "")
    write_pdf(report, tmp_path / "a.pdf")
    assert len(re.findall(rb"/Type /Page\b", (tmp_path / "a.pdf").read_bytes())) == 3


def test_advice_is_that_of_who_wrote_the_log(log: Path) -> None:
    """Neither a .bin nor a stranger's .tlog has `rates_hz`: nobody asked for it."""
    series, _, replayed = collected(log)
    streams = {name: msgspec.structs.replace(s, count=1) for name, s in replayed.health.streams.items()}
    slow = replayed._replace(health=msgspec.structs.replace(replayed.health, streams=streams))
    rows = (AUTOPILOT_RATES, "LOG_BITMASK"), (OUR_RATES, "rates_hz"), (STREAM_RATES, "SRn_EXTRA1")
    for rates, named in rows:
        score = LeaderScorer(None).score(replayed.end)
        advice = [c.advice for c in judge(series, score, slow, rates=rates) if "rate:" in c.name]
        assert len(advice) == 2
        assert [[name for _, name in rows if name in one] for one in advice] == [[named]] * 2


def test_own_motion_and_how_far_our_own_state_is_off_are_drawn(log: Path) -> None:
    series, _, _ = collected(log)
    series = deepcopy(series)
    own = series.own.table()
    assert own.shape[1] == 10
    assert np.abs(own[:, 7:9]).max() < 90.0
    drawn = figures(series, None, None)["Our own vehicle, as the autopilot has it"]
    np.testing.assert_allclose(drawn.axes[0].lines[0].get_ydata(), -own[:, 3])
    series.own_state.append(own[5, 0], 1.0, 1.0, *(own[5, 4:7] + [0.3, 0.0, 0.4]))
    below = figures(series, None, None)["Our own state: do its sensors agree?"].axes[1]
    np.testing.assert_allclose(below.lines[0].get_ydata(), [0.5])


def test_a_fail_is_exit_code_1(tmp_path: Path) -> None:
    record(tmp_path / "short.mcap", Stream(t1=8.0, sparse=True).datagrams())  # no estimate after the first 15 s
    assert main(["report", str(tmp_path / "short.mcap"), *SIZE, "--out", str(tmp_path / "out.html")]) == 1


def test_an_autopilot_alone_has_a_report(tmp_path: Path) -> None:
    path = tmp_path / "alone.mcap"
    record(path, Stream(t1=7.0, sparse=True, images=lambda _: False).datagrams())
    assert main(["report", str(path), "--out", str(tmp_path / "out.html")]) == 0
