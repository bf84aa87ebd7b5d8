"""The daemon under load: its bytes, its figures and their page; how fast anything is, no test says."""

import importlib
import json
import os
import re
from types import ModuleType
from typing import Any

import msgspec
import numpy as np
import pytest

from benchmarks import floor, live, soak
from benchmarks.live_flight import START_TIME_MS, datagrams
from onboard.messages import CameraPoints, Encoding
from tests.support import documents
from tests.support.programs import ROOT

FLOWN = {
    "arrival_ms": {"p50": 0.61, "p99": 1.9, "max": 4.04},
    "exposure_ms": {"p50": 40.61, "p99": 41.9, "max": 44.04},
    "images": 300,
    "answered": 299,
    "cpu_percent": 7.6,
    "memory_mb": 149.6,
    "dropped": 0,
}
STAGES = ("read_us", "decode_us", "align_us", "estimate_us", "encode_us", "replay_times", "messages_per_s")
FLOOR: dict[str, Any] = FLOWN | {"start_s": 0.5, "replay_times": 100.0}
RUN: dict[str, Any] = {
    "machine": {"date": "2026-11-22", "cpu": "a", "cores": 2, "load_average": 0.04},
    "start": {"warm_s": 0.96},
    "stages": dict.fromkeys(STAGES, 10.0),
    "alone": FLOWN,
    "floor": FLOOR,
    "ratios": live.ratios(
        {"alone": FLOWN, "floor": FLOOR, "start": {"warm_s": 1.0}, "stages": {"replay_times": 20.0}}
    ),
    "beside_two_busy_loops": FLOWN,
    "half_of_one_core": FLOWN,
    "input": [
        {"asked": r, "sent_per_s": r, "received": r, "sent": r, "dropped": 0, "cpu_us_per_message": 20.0}
        for r in live.RATES
    ],
}


def render() -> ModuleType:
    return importlib.import_module("render")


def test_every_figure_of_the_page_comes_from_the_history() -> None:
    used = set(re.findall(r"<!--(live_\w+)-->", documents.text("measurements")))
    found = render().live_figures("{}\n" + json.dumps(RUN))
    assert used <= set(found)
    assert len(used) > 20
    assert found["live_alone_arrival_p50_ms"] == "0.6"
    assert found["live_alone_answered"] == "299 of 300"


def test_ratios_are_of_the_floor_and_more_than_one_where_the_daemon_takes_more() -> None:
    ours = {"arrival_ms": {"p50": 2.0, "p99": 9.0}, "cpu_percent": 12.0, "memory_mb": 150.0}
    floor = {"arrival_ms": {"p50": 1.0, "p99": 3.0}, "cpu_percent": 6.0, "memory_mb": 100.0}
    floor |= {"start_s": 0.5, "replay_times": 200.0}
    run = {"alone": ours, "floor": floor, "start": {"warm_s": 1.0}, "stages": {"replay_times": 25.0}}
    ratios = live.ratios(run)
    assert ratios == {
        "arrival_p50": 2.0,
        "arrival_p99": 3.0,
        "cpu": 2.0,
        "memory": 1.5,
        "replay": 8.0,
        "start": 2.0,
    }
    table = live.floor_table(run | {"ratios": ratios})
    assert [*table.columns[3].cells] == ["2.0", "3.0", "2.0", "1.5", "8.0", "2.0"]


def test_the_floor_reads_what_the_flight_sends_and_corrects_by_what_it_sees() -> None:
    """A leader where the hypotheses expect it is expected; one that looks twice as large is not."""
    sent = [d for d in datagrams(1) if d.encoding is Encoding.MAVLINK]
    fields = [f for d in sent if (f := floor.unpack(d.data)) is not None]
    assert len(fields) == 300
    assert fields[-1][0] == 5_995_000  # the newest sample of the IMU, us
    image = msgspec.json.decode(
        next(d.data for d in datagrams(1) if d.encoding is Encoding.POINTS), type=CameraPoints
    )
    u, v, half_u, half_v = floor.measurement(image)
    assert 0.01 < half_u < 0.1
    assert abs(half_v) < 0.01
    assert max(abs(u), abs(v)) < 0.6
    nis = [float(np.median(floor.Arithmetic().image(np.array([0.0, 0.0, half, 0.0])))) for half in (0.07, 0.14)]
    assert nis[0] < 10.0 < nis[1]


def test_the_page_shows_the_newest_line_of_the_history() -> None:
    history = (ROOT / "benchmarks" / "history.jsonl").read_text(encoding="utf-8")
    measured = json.loads((documents.DOCS / "figures.json").read_text(encoding="utf-8"))["measured"]
    found = render().live_figures(history)
    shown = {key: value for key, value in measured.items() if key.startswith("live_")}
    assert {key: found[key] for key in shown} == shown


def test_a_flight_has_the_rates_that_the_page_states_in_order_of_arrival() -> None:
    flown = datagrams(2)
    assert [d.t_recv_ns for d in flown] == sorted(d.t_recv_ns for d in flown)
    images = [json.loads(d.data) for d in flown if d.encoding is Encoding.POINTS]
    assert len(images) == 60
    assert {image["target"] for image in images} == {"leader"}
    assert len(flown) - len(images) == 2 * (200 + 2 * 50 + 1)
    assert images[0]["t_ns"] == START_TIME_MS * 1_000_000


def test_percentiles_are_in_milliseconds() -> None:
    assert live.percentiles([1_000_000, 2_000_000, 3_000_000]) == pytest.approx(
        {"p50": 2.0, "p99": 2.98, "max": 3.0}
    )


def test_a_soak_is_flat_and_its_clock_does_not_drift() -> None:
    found = list(soak.soak(0.004, 200, 0.001))
    assert [row["hours"] for row in found] == [0.001, 0.002, 0.003]
    for what in ("threads", "files"):  # fewer: another test's session has ended only now
        assert max(row[what] for row in found) == found[0][what]
    assert all(abs(row["offset_error_ms"]) < 1.0 for row in found)
    assert found[-1]["valid_percent"] > 90
    assert found[-1]["rejected"] == found[0]["rejected"]


@pytest.mark.slow
def test_the_daemon_under_load_answers_every_image() -> None:
    for kind in (live.Daemon, live.Floor):
        flown = live.under_load(3, kind=kind)
        assert (flown["images"], flown["answered"], flown["dropped"]) == (90, 90, 0)
    (rate,) = live.input_rates(1, (2000,))
    assert rate["received"] == rate["sent"] > 1000
    assert live.start_in(dict(os.environ)) > 0
    assert live.start_in(dict(os.environ), live.Floor) > 0
