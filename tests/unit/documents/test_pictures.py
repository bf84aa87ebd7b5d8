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


def test_an_arrow_that_others_replace_is_not_drawn(drawings: Any) -> None:
    assert drawings.essential({("a", "b"), ("b", "c"), ("a", "c")}) == {("a", "b"), ("b", "c")}


def test_drawings_have_colours_for_light_and_dark(drawings: Any) -> None:
    """Each has a contrast of 3 and more on white and on the theme's dark background."""

    def luminance(colour: str) -> float:
        parts = [int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)]
        linear = [p / 12.92 if p <= 0.04045 else ((p + 0.055) / 1.055) ** 2.4 for p in parts]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    for colour in (drawings.INK, drawings.BLUE, drawings.ORANGE, drawings.PINK, drawings.GREEN):
        for background in ("#ffffff", "#131416"):
            light, dark = sorted((luminance(colour), luminance(background)), reverse=True)
            assert (light + 0.05) / (dark + 0.05) >= 3.0, (colour, background)


@pytest.mark.parametrize("path", sorted(documents.DOCS.rglob("*.svg")), ids=documents.name)
def test_a_drawing_shows_names_and_no_path(path: Any) -> None:
    """Of pictures in pixels, `test_report` sees to it: those of the view show a flight, and no file."""
    shown = re.findall(r">([^<]+)<", path.read_text(encoding="utf-8"))
    assert [text for text in shown if re.search(r"(^|\s)/\w+/", text)] == []


def test_every_picture_is_shown_and_can_be_drawn() -> None:
    programs = ("pictures", "error_plots", "drawings", "real_flights")
    made = "".join((documents.DOCS / f"{name}.py").read_text(encoding="utf-8") for name in programs)
    shown = {name for path in documents.ALL for name in re.findall(r"pictures/([\w.-]+)\)", documents.text(path))}
    assert shown == {path.name for path in PICTURES.iterdir()}
    for name in shown:
        stem = name.partition(".")[0]
        assert stem in made or stem.startswith("page-"), name
    assert (ROOT / "docs" / "view.md").exists()
