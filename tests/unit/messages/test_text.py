"""Text from outside, such as a detector's class or a file's name: plain and short at the door, and again wherever
a person reads it."""

import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest
from matplotlib.figure import Figure
from msgspec.structs import replace
from rich.table import Table

from onboard.analysis.report.page import FlightReport, html, write_pdf
from onboard.analysis.report.verdict import Check, Grade
from onboard.autopilot.notices import Notices
from onboard.commands.status import describe
from onboard.config import Config, parse_config
from onboard.health.refusals import Refusals
from onboard.messages import CameraHealth, Cause, Datagram, Encoding, Exposure, Health, Reason, Refusal
from onboard.messages.text import MAX_LINE_LENGTH, plain, plain_record
from onboard.pipeline import Pipeline
from onboard.terminal import output as terminal
from onboard.terminal.console import Console
from tests.support.leader import S

EVIL = {
    "a terminal's escapes": "drone\x1b[2J\x1b]0;mine\x07",
    "escapes of eight bits": "drone\x9b2J",
    "marks of direction": "dr\u202eeno\u2066",
    "line ends": "drone\r\nvehicle 1: healthy\u2028",
    "styles": "[/red] [bold]drone[link=file:///]",
    "mathematics": "$\\frac{$",
    "60,000 letters": "d" * 60_000,
}


def detections(name: str) -> bytes:
    box = {"u_px": 320.0, "v_px": 240.0, "width_px": 40.0, "height_px": 10.0}
    return msgspec.json.encode({"t_ns": S, "clock": "boot", "detections": [{"box": box, "class": name}]})


def heard(name: str) -> Health:
    """The health after detections of a class that is not followed, from a source of that name."""
    pipeline = Pipeline(parse_config({"camera": {"classes": ["plane"]}}))
    way = {"channel": f"key/{name}", "encoding": Encoding.DETECTIONS}
    pipeline.feed(Datagram(**way, t_recv_ns=2 * S, data=detections(name)))
    return pipeline.health(2 * S)


def forged(text: str) -> Health:
    """What somebody else published as a vehicle's health."""
    health, many = heard("drone"), (text,) * 3
    return replace(
        health,
        autopilot=text,
        refusals=(Refusal(source=text, reason=text, count=1, t_recv_ns=0),),
        cameras={text: CameraHealth(count=1, rate=1.0, age=0.0, targets=many, classes=many)},
        reasons=dict.fromkeys(health.states, text),
    )


def printed(text: str, _: Path) -> str:
    out = io.StringIO()
    console, table = Console(file=out, width=200, force_terminal=False), Table("figure", text, title=text)
    table.add_row(text, text)
    console.print(text, highlight=False, soft_wrap=True)
    console.print(table)
    return out.getvalue()


def lined(text: str, tmp_path: Path) -> str:
    with (tmp_path / "lines").open("wb") as file:
        lines = terminal.Lines(file.fileno())
        lines(text)
        lines.close()
    return (tmp_path / "lines").read_text()


def page(text: str, tmp_path: Path) -> str:
    check = Check(text, text, text, Grade.FAIL, text)
    report = FlightReport(text, [(text, text)], [check], {"range": Figure()}, {text: [(text,), (text,)]}, "{}")
    write_pdf(report, tmp_path / "report.pdf")
    return html(report)


def statustext(text: str, _: Path) -> str:
    notices = Notices()
    notices.add(4, text)
    (message,) = notices.due(0)
    return message.text


READERS: dict[str, Callable[[str, Path], str]] = {
    "the daemon's lines": lined,
    "a command's line": lambda text, _: terminal.one_line(text),
    "a command's table": printed,
    "onboard status": lambda text, _: describe("1", plain_record(forged(text))),
    "a report's page": page,
    "STATUSTEXT": statustext,
    "the health": lambda text, _: msgspec.json.encode(heard(text)).decode(),
}


@pytest.mark.parametrize("evil", EVIL)
@pytest.mark.parametrize("reader", READERS)
def test_no_text_from_outside_reaches_a_person_as_it_came(reader: str, evil: str, tmp_path: Path) -> None:
    text = EVIL[evil]
    read = READERS[reader](text, tmp_path)
    lines = read.split("\n")
    assert all(line.isprintable() for line in lines)
    assert text not in read or (text.isprintable() and len(text) <= MAX_LINE_LENGTH)
    assert "d" * (MAX_LINE_LENGTH + 1) not in read
    assert "vehicle 1: healthy" not in lines


@pytest.mark.parametrize("evil", EVIL)
def test_a_class_is_64_plain_letters_from_the_door_on(evil: str) -> None:
    way = {"channel": "key", "encoding": Encoding.DETECTIONS}
    (exposure,) = Pipeline(Config()).decode(Datagram(**way, t_recv_ns=2 * S, data=detections(EVIL[evil])))
    assert isinstance(exposure, Exposure)
    (image,) = exposure.detections
    assert 4 < len(image.class_name) <= 64
    assert image.class_name.isprintable()


def test_what_is_plain_stays_as_it_is() -> None:
    for text in ("drone", "leader lost: FOLLOW brakes within 3 s", "无人机", "ALÉRION-2", "", "x" * 64):
        assert plain(text) == text
    assert plain("x" * 65) == "x" * 61 + "..."
    assert plain(" drone\n") == " drone?"
    health: Any = heard("drone")
    assert plain_record(health) == health


def test_a_source_without_end_costs_the_health_little() -> None:
    refusals = Refusals()
    refusals.add("s" * 10**6, Reason(Cause.DOCUMENT, "r" * 10**6), 0)
    assert len(msgspec.json.encode(refusals.latest)) < 1000


def test_status_stays_narrow() -> None:
    shown = describe("1", plain_record(forged("d" * 60_000)))
    assert max(map(len, shown.split("\n"))) < 3 * MAX_LINE_LENGTH
