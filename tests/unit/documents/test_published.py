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


def test_without_files_nothing_changes(render: Any) -> None:
    written = (render.FIGURES, render.README, render.PUBLISHED)
    before = [documents.text(path) for path in written]
    render.main([])
    assert before == [documents.text(path) for path in written]


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


def test_several_benchmarks_give_a_range() -> None:
    render = load_render()
    radar = {"times_faster_than_filterpy": 80.0, "times_faster_than_stonesoup": 300.0, "us_in_two_calls": 8.0}
    one = {
        "radar_ukf": {"us": 4.0} | radar,
        "radar_ukf_own_model": {"us": 5.0, "times_faster_than_filterpy": 70.0},
        "vision_ukf": {"us": 6.0, "times_faster_than_filterpy": 150.0},
        "square_root": {"us": 7.0},
        **{
            name: {"us_per_step": 2.0, "times_faster_than_filterpy": 250.0}
            for name in ("batch_radar", "batch_ukf")
        },
        "leader_targets": {"one_core": 0.9, "without_id": 1.04},
    }
    found = render.bench_figures([one, one | {"radar_ukf": {"us": 5.0} | radar}])
    assert found["bench_radar_us"] == "4.0 to 5.0"
    assert found["bench_radar_filterpy"] == "80"
    assert found["bench_two_calls_filterpy"] == "40 to 50"
    assert set(found) >= {key for key in FIGURES if key.startswith("bench_")}


def test_studies_give_the_figures_of_their_pages() -> None:
    render = load_render()
    rows = [
        *(
            ["quadrotor", "csvsf-adaptive", 0.0541, 0.13, 0.002, 0.0],
            ["quadrotor-motor", "ckf", 9.0, 9.0, 9.0, 0.0],
        ),
        ["quadrotor-gust", "csvsf-adaptive, no barometer", 0.088, 0.301, 0.002, 0.0],
    ]
    naming = [["quadrotor-gust", 100.0, 0.3, 0.4, 0.1, "none"], ["quadrotor", None, None, None, None, "none"]]
    own = {"study": "own-state", "seeds": 60, "tables": [{"rows": rows}, {"rows": naming}]}
    assert render.of_studies(own) == {
        "own_seeds": "60",
        "own_nothing_velocity_m_s": "0.054",
        "own_nothing_worst_m_s": "0.13",
        "own_gust_named_percent": "100",
        "own_gust_delay_median_s": "0.30",
        "own_gust_delay_longest_s": "0.40",
    }
    aircraft = [["glider", 93.81, 0.41, 2.0, 0.0, 10.0, 9.0], ["silent", 96.6, 0.2, 2.0, 0.0, 30.0, 30.0]]
    checks = [{"ours": ours} for ours in (0, 0, 0.0, 95.71)]
    traffic = {"seeds": 72, "tables": [{"rows": aircraft}], "checks": checks}
    found = render.of_studies({"traffic": traffic})
    assert found["traffic_least_inside_percent"] == "93.8 ± 0.4"
    assert found["traffic_approaches_percent"] == "97.5"
    assert set(found) == {key for key in FIGURES if key.startswith("traffic_")}
    row = [100.0, 0.0, 2.298, 0.263, 2.2, 3.29, 2.643, 96.53, 2.884, 0.0, 0.0]
    unknown = [0.0, 0.0, *[None] * 9]
    rows = [["behind", 40.0, *row], ["hover, center on wing", 40.0, *unknown]]
    tables = [{"title": "Family by family", "rows": rows}]
    assert render.of_studies({"encounters": {"seeds": 40, "tables": tables}}) == {
        "encounters_flights": "40",
        "encounters_behind": "100.0 | 2.3 (3.3) | 2.6 | 96.5±2.9 | 0.0±0.0",
        "encounters_hover_center_on_wing": "0.0 | – (–) | – | –±– | –±–",
    }
    names = ("range_percent", "nees", "inside_percent", "valid_percent")
    values = {name: {"value": x} for name, x in zip(names, (2.06, 6.36, 96.51, 100.0), strict=True)}
    measured = {"position_m": 0.612, "velocity_m_s": 0.1234, "quantities": values}
    flown = [{"variant": "a", "method": name, "runs": 20, **measured} for name in ("paper", "shipped")]
    assert render.of_studies({"targets": [], "rows": flown}) == {
        "relative_motion_runs": "20",
        "relative_motion_a": "2.1 | 0.61 | 0.12 | 6.4 | 96.5 | 100.0",
        "steady_turn_nees": "6.4",
    }
