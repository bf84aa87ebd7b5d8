"""The notebooks of docs/notebooks, run cell by cell, as a reader would."""

import json
from typing import Any

import numpy as np
import pytest

from tests.support.programs import ROOT

FOLDER = ROOT / "docs" / "notebooks"


def cells(name: str) -> list[str]:
    book = json.loads((FOLDER / f"{name}.ipynb").read_text(encoding="utf-8"))
    assert book["nbformat"] == 4
    return ["".join(cell["source"]) for cell in book["cells"] if cell["cell_type"] == "code"]


def ran(name: str) -> dict[str, Any]:
    names: dict[str, Any] = {}
    for cell in cells(name):
        exec(cell, names)  # noqa: S102 - what a reader runs
    return names


def test_the_tracker_by_bearings_is_of_20_lines_and_finds_the_range_once_it_has_turned() -> None:
    body = "\n".join(cells("bearings-only")[1:]).splitlines()  # without the imports
    assert len([line for line in body if line.strip() and not line.startswith("print")]) <= 20
    names = ran("bearings-only")
    error = np.linalg.norm((names["found"].beliefs.mean - names["truth"])[:, :2], axis=1)
    smoothed = np.linalg.norm((names["smoothed"].mean - names["truth"])[:, :2], axis=1)
    assert error[29] > 300
    assert error[59] < 100
    assert smoothed[29] < 0.5 * error[29]


def test_the_pendulum_is_five_lines_and_follows() -> None:
    assert len(cells("own-model")[1].splitlines()) == 5
    names = ran("own-model")
    error = names["found"].beliefs.mean[20:, 0] - names["angles"][20:]
    assert np.sqrt(np.mean(error**2)) < 0.07
    assert names["found"].nis[20:].mean() == pytest.approx(1.0, abs=0.35)


def test_the_five_papers_notebook_is_a_program_whose_imports_are_there() -> None:
    first, *others = cells("five-papers")
    exec(first, {})  # noqa: S102 - what a reader runs
    for cell in others:
        compile(cell, "five-papers", "exec")


@pytest.mark.slow  # each study has tests of its own
def test_the_five_papers_results_are_those_of_their_studies() -> None:
    """The figures are the text's, wide enough for the scatter of a few runs."""
    names = ran("five-papers")
    vision, quadrotor = names["vision"], names["quadrotor"]
    assert vision["paper"]["nees"] < 1
    assert 4 < vision["honest"]["nees"] < 14
    assert quadrotor["none", "ckf"] < 0.5 * quadrotor["none", "svsf"]
    assert quadrotor["weak", "ckf"] > 2 * quadrotor["weak", "svsf"] > 2 * quadrotor["weak", "csvsf-adaptive"]
    settled = {name: names["validation"].outcomes[name].windows["settled"] for name in ("ukf", names["JOSEPH"])}
    assert settled["ukf"].position == pytest.approx(settled[names["JOSEPH"]].position, rel=0.01)
    failed = {name: names["sharp"].outcomes[name].failed for name in ("srukf-textbook", names["JOSEPH"])}
    assert failed["srukf-textbook"] > 0 == failed[names["JOSEPH"]]
    last = names["launch"].outcomes["ukf"].windows["262-500 s"]
    assert last.position == pytest.approx(70, rel=0.2)
    assert names["launch"].gap < 0.01
    assert names["right"].position == pytest.approx(names["right"].bound, rel=0.1)
    assert names["printed"].failed


def test_every_notebook_is_run_here() -> None:
    assert {path.stem for path in FOLDER.glob("*.ipynb")} == {"bearings-only", "five-papers", "own-model"}
