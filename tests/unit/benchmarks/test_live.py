"""The daemon under load: its bytes, its figures and their page; how fast anything is, no test says."""

import importlib
import json
import os
from types import ModuleType

import pytest

from benchmarks import live, soak
from tests.support import documents
from tests.support.programs import ROOT


def render() -> ModuleType:
    return importlib.import_module("render")


def test_the_page_shows_the_newest_line_of_the_history() -> None:
    history = (ROOT / "benchmarks" / "history.jsonl").read_text(encoding="utf-8")
    measured = json.loads((documents.DOCS / "figures.json").read_text(encoding="utf-8"))["measured"]
    found = render().live_figures(history)
    shown = {key: value for key, value in measured.items() if key.startswith("live_")}
    assert {key: found[key] for key in shown} == shown


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
