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


def test_every_notebook_is_run_here() -> None:
    assert {path.stem for path in FOLDER.glob("*.ipynb")} == {"bearings-only", "own-model"}
