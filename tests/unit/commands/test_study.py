"""`onboard study NAME`: what is given reaches the study, and nothing else does; where studies are found."""

import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from onboard.analysis.parallel import cluster
from onboard.analysis.parallel.workers import Computers
from onboard.commands import cli
from studies import command


@pytest.mark.parametrize(
    ("options", "given"),
    [
        ((), {}),
        (("--first-seed", "7", "--jobs", "1"), {"first_seed": 7, "jobs": 1}),
        (("--seeds", "2", "--first-seed", "0"), {"seeds": 2, "first_seed": 0}),
    ],
)
def test_what_is_given_reaches_the_study(
    options: tuple[str, ...], given: dict[str, int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    received: list[Mapping[str, int]] = []

    def run_study(name: str, given: Mapping[str, int], out: Path, _progress: object) -> dict[str, Any]:
        received.append(given)
        (out / name / "report.md").write_text("# nothing\n", encoding="utf-8")
        return {}

    where = {"jobs": Computers(jobs=given.pop("jobs", None))}
    monkeypatch.setattr(command, "run_study", run_study)
    assert cli.main(["study", "traffic", *options, "--out", str(tmp_path)]) == 0
    assert received == [given | where]


def test_an_installed_package_names_the_source_tree(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(cluster, "SOURCE_TREE", tmp_path)
    assert cli.main(["study", "traffic"]) == 2
    assert "studies are in the source tree" in capsys.readouterr().err


def test_the_studies_are_found_from_any_folder(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "onboard", "study", "none"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "no study named 'none'; there are: closed-loop, " in done.stderr


@pytest.mark.parametrize(
    ("file", "numbers"),
    [
        ("figure-03-05-steps.png", [3, 4, 5]),
        ("figure-01-and-11-trajectories.png", [1, 11]),
        ("figure-08-relative-position.png", [8]),
        ("overview.png", []),
    ],
)
def test_a_file_s_name_gives_the_paper_s_figures(file: str, numbers: list[int]) -> None:
    assert list(command.paper_figures(file)) == numbers


def test_a_figure_is_drawn_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    name = "cwpa-kalman-tracker-3d"
    call = ["study", name, "--jobs", "1", "--out", str(tmp_path), "--figure"]
    assert cli.main([*call, "4"]) == 0
    assert [path.name for path in tmp_path.rglob("*")] == [name, "figure-03-05-steps.png"]
    assert "figure-03-05-steps.png" in capsys.readouterr().out
    assert cli.main([*call, "9"]) == 2
    assert "no figure 9 of its paper; there are: 1, 2, 3, 4, 5" in capsys.readouterr().err
