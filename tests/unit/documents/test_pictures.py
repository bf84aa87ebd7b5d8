"""Pictures of the documents: drawings are what the code draws, and every picture can be drawn anew."""

import re
import sys
from importlib import import_module
from typing import Any

import pytest

from tests.support import documents
from tests.support.programs import ROOT
from tests.unit.house import test_import_rules as rules

PICTURES = documents.DOCS / "pictures"


@pytest.fixture
def drawings(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(str(documents.DOCS))
    yield import_module("drawings")
    sys.modules.pop("drawings", None)


@pytest.mark.parametrize("name", ["geometry", "flow"])
def test_a_drawing_is_what_the_code_draws(drawings: Any, name: str, tmp_path: Any, monkeypatch: Any) -> None:
    monkeypatch.setattr(drawings, "PICTURES", tmp_path)
    assert getattr(drawings, name)().save("x.svg") == (PICTURES / f"{name}.svg").read_text(encoding="utf-8")


def test_the_house_has_every_part_on_its_floor() -> None:
    text = (PICTURES / "house.svg").read_text(encoding="utf-8")
    heights = {name: float(y) for y, name in re.findall(r'y="([\d.]+)"[^>]*>([^<]+)</text>', text)}
    assert heights.keys() == set(rules.FLOOR)
    for name, height in heights.items():
        below = [other for other in heights if rules.FLOOR[other] < rules.FLOOR[name]]
        assert all(heights[other] > height for other in below)


def test_every_picture_is_shown_and_can_be_drawn() -> None:
    programs = ("pictures", "error_plots", "drawings", "real_flights")
    made = "".join((documents.DOCS / f"{name}.py").read_text(encoding="utf-8") for name in programs)
    shown = {name for path in documents.ALL for name in re.findall(r"pictures/([\w.-]+)\)", documents.text(path))}
    assert shown == {path.name for path in PICTURES.iterdir()}
    for name in shown:
        stem = name.partition(".")[0]
        assert stem in made or stem.startswith("page-"), name
    assert (ROOT / "docs" / "view.md").exists()
