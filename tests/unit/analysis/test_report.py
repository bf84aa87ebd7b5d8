"""`onboard report` of a flight made by hand: every check, table, curve and page."""

import math
import re
from collections.abc import Iterator
from pathlib import Path

import matplotlib as mpl
import pytest
from msgspec.structs import replace

from onboard import __version__
from onboard.analysis.flights.replay import replay
from onboard.analysis.report import figures, page
from onboard.analysis.report.page import FlightReport, html
from onboard.analysis.report.series import FlightSeries
from onboard.analysis.report.vehicle import MAX_EVENT_ROWS, MAX_PARAMETER_ROWS, VehicleSeries, mode_name
from onboard.analysis.report.verdict import (
    AT_LEAST,
    AUTOPILOT_RATES,
    LIMITS,
    STREAM_RATES,
    _check,
    _consistency,
    _own_state,
    _truth,
    judge,
)
from onboard.commands import report
from onboard.commands.cli import main
from onboard.messages import Heartbeat, ParamValue, StatusText
from onboard.scoring.leader import LeaderScorer
from tests.support import made_flight
from tests.support.dataflash import dataflash
from tests.support.golden import assert_golden, picture
from tests.support.records import record
from tests.support.streams import Flight, Stream, make_config


@pytest.fixture
def written(monkeypatch: pytest.MonkeyPatch) -> list[FlightReport]:
    """The reports that a command writes, of the flight made by hand in place of a replay."""
    made: list[FlightReport] = []

    def keep(one: FlightReport) -> str:
        made.append(one)
        return html(one)

    monkeypatch.setattr(report, "replay", made_flight.replay)
    monkeypatch.setattr(page, "html", keep)
    monkeypatch.setattr(figures, "MAX_CURVE_SAMPLES", 150)
    monkeypatch.setattr(page, "PAGE_ROWS", 3)
    return made


def text_of(made: FlightReport) -> str:
    text = html(made._replace(figures={}, configuration="configuration"))
    return text[text.index("<h1>") :].replace("<tr>", "\n<tr>").replace(__version__, "VERSION")


def drawn(made: FlightReport) -> Iterator[str]:
    for title, figure in made.figures.items():
        yield from [f"FIGURE {title}", *picture(figure)]
    tables = {**made.tables, page.PARAMETERS_HEADING: page._shorten(made.parameters)}
    with mpl.rc_context({"text.parse_math": False}):
        for sheet in [page._first_page(made), *page._table_pages(tables)]:
            yield from ["PAGE", *picture(sheet)]


def test_all_of_a_report(
    written: list[FlightReport],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    record(tmp_path / "flight.mcap", Stream(t1=5.1).datagrams())
    (tmp_path / "truth.csv").write_text(made_flight.truth(), encoding="utf-8")
    (tmp_path / "c.toml").write_text("[estimator.leader]\nsize_prior_m = 3.0\n", encoding="utf-8")
    outs = ["--out", "a.html", "--pdf", "a.pdf"]
    assert main(["report", "flight.mcap", "--set", "estimator.leader.size_prior_m=2"]) == 1
    assert main(["report", "flight.mcap", "--truth", "truth.csv", "--config", "c.toml", *outs]) == 1
    plain, whole = written
    first, second = (Path(name).read_text("utf-8") for name in ("flight-report.html", "a.html"))
    assert "size_prior_m&quot;: 2.0" in first
    assert "size_prior_m&quot;: 3.0" in second
    assert second.count("<svg") == len(whole.figures)
    gps = [text.partition("<h2>GPS</h2>")[2].partition("<h2>")[0] for text in (first, second)]
    assert gps[0] == gps[1] != ""  # the same bytes for the same figure
    assert not re.search(r"(src|href)=['\"](?!#)", second)
    lines = [*drawn(whole)]
    pages = len(whole.figures) + lines.count("PAGE")
    assert (tmp_path / "a.pdf").read_bytes().count(b"/Type /Page ") == pages
    assert_golden("report.txt", [text_of(whole), *lines, text_of(plain), capsys.readouterr().out])


@pytest.mark.parametrize("name", LIMITS)
def test_a_limit_itself_is_still_within(name: str) -> None:
    limit = LIMITS[name]
    below = -1.0 if limit.sense == AT_LEAST else 1.0
    values = (limit.good, limit.good + below * 1e-6, limit.fair, limit.fair + below * 1e-6)
    expected = "PASS FAIL PASS FAIL" if limit.good == limit.fair else "PASS AMBER AMBER FAIL"
    assert " ".join(_check(name, value).grade for value in values) == expected


def test_innovations_and_rates_are_graded() -> None:
    """Also: neither a .bin nor a stranger's .tlog has `rates_hz`, since nobody asked for it."""
    series, replayed = FlightSeries("leader"), made_flight.replay(None, make_config(), take=lambda _: None)
    score, lines = LeaderScorer(None).score(), []
    for nis in (0.19, 0.2, 0.79, 0.8, 2.0, 3.0, 3.01, 5.0, 5.01):
        found = [*_consistency(replace(score, nis_mean=nis, nis_dof=2))]
        lines += [f"NIS {nis} of 2: {check.grade} {check.value} {check.advice}" for check in found]
    lines += [f"none: {[*_consistency(score)]}, {[*_consistency(replace(score, nis_mean=1.0))]}"]
    for rates in (AUTOPILOT_RATES, STREAM_RATES):
        lines += [check.advice for check in judge(series, score, replayed, rates=rates) if "rate: L" in check.name]
    lost = replace(score, diverged=True, range_error_rms_percent=9.0)
    lines += [str(check) for one in (lost, replace(score, diverged=True)) for check in _truth(one)]
    assert_golden("grades.txt", lines)


@pytest.mark.parametrize(
    ("valid", "nis", "grades"),
    [
        ([0] * 50 + [1] * 50, 1.0, "PASS PASS"),  # half of it on the ground
        ([1] * 100, 2.01, "PASS AMBER"),
        ([1] * 100, 2.0, "PASS PASS"),
        ([1] * 100, 0.3, "PASS PASS"),
        ([1] * 100, 0.29, "PASS AMBER"),
        ([1] * 80 + [0] * 20, 1.0, "AMBER PASS"),
        ([0] * 50 + [1] * 20 + [0] * 80, 1.0, "FAIL PASS"),
        ([0] * 100, math.nan, "FAIL"),
    ],
)
def test_our_own_state_is_graded_by_what_it_was_in_flight(valid: list[int], nis: float, grades: str) -> None:
    series = FlightSeries("leader")
    for k, one in enumerate(valid):
        series.own_state.append(0.1 * k, one, nis if one else math.nan, 0.0, 0.0, 0.0)
    assert " ".join(check.grade for check in _own_state(series)) == f"{grades} PASS"  # the last: no faults


OF_ARDUPILOT = {(2, 23): "FOLLOW", (1, 10): "AUTO", (25, 10): "AUTO", (26, 23): "FOLLOW"} | {
    (10, 15): "GUIDED",
    (11, 15): "GUIDED",
    (12, 19): "MANUAL",
    (2, 250): "250",
}
OF_PX4 = {1: "MANUAL", 3: "POSCTL", 6: "OFFBOARD", 7: "STABILIZED", 99: "6488064"}
OF_AUTO = {1: "READY", 3: "LOITER", 6: "LAND", 8: "FOLLOW_TARGET", 9: "PRECLAND", 99: "99"}
MODES = {
    (0, 2, 7): "7",
    **{(3, *key): name for key, name in OF_ARDUPILOT.items()},
    **{(12, 2, main << 16): name for main, name in OF_PX4.items()},
    **{(12, 2, sub << 24 | 4 << 16): f"AUTO {name}" for sub, name in OF_AUTO.items()},
}


def test_modes_have_the_names_that_pilots_know() -> None:
    named = {(a, kind, mode): mode_name(heartbeat(a, kind, mode)) for a, kind, mode in MODES}
    assert named == MODES


def heartbeat(autopilot: int, kind: int, mode: int, *, armed: bool = False) -> Heartbeat:
    at = {"t_ns": 0, "t_recv_ns": 0, "system": 1, "status": 4}
    return Heartbeat(**at, vehicle_type=kind, autopilot=autopilot, armed=armed, custom_mode=mode)


def test_many_words_and_parameters_are_counted() -> None:
    series, at = VehicleSeries(), {"t_ns": 0, "t_recv_ns": 0, "system": 1}
    for t, (mode, armed) in enumerate(((5, True), (5, True), (23, False), (5, False))):
        series.hear(heartbeat(3, 2, mode, armed=armed), float(t))
    assert series.words == [
        *((0.0, "mode", "LOITER"), (0.0, "armed", "")),
        *((2.0, "mode", "FOLLOW"), (2.0, "disarmed", ""), (3.0, "mode", "LOITER")),
    ]
    for k in range(MAX_EVENT_ROWS + 2):
        series.hear(StatusText(**at, severity=k, text=str(k)), float(k))
    assert report._words(series)[1:][5:14:4] == [
        ("0.00", "emergency", "0"),
        ("4.00", "warning", "4"),
        ("8.00", "debug", "8"),
    ]
    assert report._words(series)[MAX_EVENT_ROWS + 1 :] == [("", "", "and 7 more")]
    for k in range(MAX_PARAMETER_ROWS + 5):
        series.hear(
            ParamValue(**at, extended=False, name=f"P{k:05}", value=math.nan if k else 1.0, default=None), 1.0
        )
    series.hear(ParamValue(**at, extended=False, name="P00000", value=math.nan, default=None), 2.0)
    series.hear(ParamValue(**at, extended=False, name="P00001", value=math.nan, default=None), 2.0)
    rows = report._parameters(series)
    assert rows[1:3] == [("P00000", "nan", "", "at 2.00 s, from 1"), ("P00001", "nan", "", "")]
    assert rows[MAX_PARAMETER_ROWS + 1 :] == [("and 5 more", "", "", "")]


def test_an_autopilot_s_own_log_has_a_report_and_shows_its_vehicle(tmp_path: Path) -> None:
    path, series = tmp_path / "a.bin", VehicleSeries()
    dataflash(Flight(), 3.0, path)
    replay(path, make_config(), hear=series.hear, keep=False)
    assert series.battery.table()[-1, 1] == pytest.approx(12.1, abs=0.01)
    assert series.outputs.table()[-1, 1:5].tolist() == [1500.0, 1501.0, 1502.0, 1503.0]
    assert series.gps.table()[-1, 1:5].tolist() == pytest.approx([4.0, 12.0, 0.5, 0.8])
    assert len(series.vibration.table()) >= 4
    assert series.words[0][1:] == ("mode", "STABILIZE")
    assert main(["report", str(path), "--out", str(tmp_path / "out.html")]) == 0
