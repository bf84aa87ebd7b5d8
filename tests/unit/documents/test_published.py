"""Generated parts of the documents are up to date: the schema, the README's table, the figures."""

import importlib
import json
import re
import shutil
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from onboard.messages import schemas
from tests.support import documents
from tests.support.programs import ROOT

GROUPS = json.loads((documents.DOCS / "figures.json").read_text(encoding="utf-8"))
FIGURES: dict[str, str] = GROUPS["measured"] | GROUPS["noted"]


def load_render() -> ModuleType:
    return importlib.import_module("render")


@pytest.fixture
def render(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """docs/render.py on copies of what it writes."""
    module = load_render()
    for name in ("FIGURES", "README", "PUBLISHED"):
        monkeypatch.setattr(module, name, Path(shutil.copy(getattr(module, name), tmp_path)))
    monkeypatch.setattr(module, "PAGES", Path(shutil.copytree(module.PAGES, tmp_path / "pages")))
    return module


def generated(path: Path, marker: str) -> str:
    pattern = rf"<!-- {marker}: begin[^>]*-->\n(.*)\n<!-- {marker}: end -->"
    found = re.search(pattern, documents.text(path), re.DOTALL)
    assert found is not None
    return found[1].strip()


def test_the_page_of_what_is_published_is_what_the_program_says() -> None:
    assert generated(documents.DOCS / "published.md", "schema") == schemas.describe().strip()


def test_the_readme_s_table_is_made_of_the_figures() -> None:
    assert generated(ROOT / "README.md", "figures") == load_render().readme_table(FIGURES)


def test_every_figure_named_exists_and_every_figure_is_named() -> None:
    named = {name for path in documents.ALL for name in re.findall(r"<!--(\w+)-->", documents.text(path))}
    in_readme = set(re.findall(r"\{(\w+)\}", load_render().README_TABLE))
    assert named | in_readme == set(FIGURES)
    assert not set(GROUPS["measured"]) & set(GROUPS["noted"])


def test_pages_carry_the_figures_as_committed() -> None:
    for path in documents.ALL:
        text = documents.text(path)
        assert "{{" not in text, path
        assert text == load_render().replace_figures(text, FIGURES), path
        assert not re.search(r"^\s*<!--\w+-->", text, re.MULTILINE), path  # Markdown would take the line as HTML
        assert text.count("<!--/-->") == len(load_render().FIGURE.findall(text)), path


def test_a_scorecard_changes_its_figures_and_the_readme(render: Any, tmp_path: Path) -> None:
    score = {
        "scenario": "formation",
        "own_state": None,
        "range_error_rms_percent": 7.07,
        "position_rmse_m": 0.987,
        "velocity_rmse_m_s": 0.1,
        "nis_mean": 6.0,
        "nis_dof": 6,
        "inside_95_percent": 93.4,
    }
    file = tmp_path / "score.json"
    file.write_text(json.dumps(score))
    render.main(["--score", str(file)])
    measured = json.loads(documents.text(render.FIGURES))["measured"]
    assert measured == GROUPS["measured"] | {
        "demo_range_percent": "7.1",
        "demo_position_m": "0.99",
        "demo_velocity_m_s": "0.10",
        "demo_nis": "6.00",
        "demo_nis_dof": "6",
        "demo_inside_percent": "93",
    }
    assert "<!--demo_position_m-->0.99<!--/-->" in documents.text(render.PAGES / "measurements.md")
    assert "range 7.1 %, position 0.99 m at 28 m" in documents.text(render.README)
    both = {
        "scenario": "mission",
        "valid_percent": 98.7,
        "own_state": {"velocity_rmse_m_s": 0.123, "attitude_rmse_deg": 0.456, "nees_mean": 5.04},
        "fault": {"after_s": 0.291},
    }
    file.write_text(json.dumps(score | both))
    render.main(["--score", str(file)])
    text = documents.text(render.README)
    assert "leader: valid 99 % of the time, range 7.1 %, position 0.99 m at 25 m" in text
    assert "own state: velocity 0.12 m/s, attitude 0.46°; motor named after 0.29 s" in text
    assert "range 7.1 %, position 0.99 m at 28 m" in text
