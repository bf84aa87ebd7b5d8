"""Every study from its flights to its report, one seed each, so that none breaks unnoticed. The tests of each
study check its results."""

import json
from pathlib import Path

import pytest

from onboard.commands.cli import main
from studies import command

SHORT = {"cwpa-kalman-tracker-3d"}
WITHOUT_FIGURES = {"own-state", "traffic"}


@pytest.mark.slow  # beside the shortest one, below
@pytest.mark.parametrize("name", command.study_names())
def test_a_study_runs_to_its_report_one_seed(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("os.cpu_count", lambda: 1)  # in this process: another test runs beside it
    numbers = tmp_path / "numbers.json"
    assert main(["study", name, "--seeds", "1", "--out", str(tmp_path), "--json", str(numbers)]) == 0
    result = json.loads((tmp_path / name / "result.json").read_bytes())
    assert result["seeds"] == 1
    assert bool(result["figures"]) is (name not in WITHOUT_FIGURES)
    assert all((tmp_path / name / f).read_bytes().startswith(b"\x89PNG") for f in result["figures"])
    assert len((tmp_path / name / "report.md").read_text(encoding="utf-8").splitlines()) > 10
    assert json.loads(numbers.read_bytes()).keys() == result.keys()
    assert f"written: {tmp_path / name}/report.md" in capsys.readouterr().out.replace("\n", "")


def test_all_studies_are_in_one_table_and_one_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """`onboard study --all`, of the shortest."""
    (name,) = SHORT
    assert set(command.study_names()) > SHORT
    monkeypatch.setattr(command, "study_names", lambda: [name])
    numbers = tmp_path / "all.json"
    assert main(["study", "--all", "--seeds", "2", "--out", str(tmp_path), "--json", str(numbers)]) == 0
    found = json.loads(numbers.read_bytes())
    assert list(found) == [name]
    figures = found[name]["figures"]
    assert figures
    assert all((tmp_path / name / f).read_bytes().startswith(b"\x89PNG") for f in figures)
    assert len((tmp_path / name / "report.md").read_text(encoding="utf-8").splitlines()) > 10
    assert found[name]["seeds"] == 2
    (row,) = [line for line in capsys.readouterr().out.splitlines() if line.strip().startswith(name)]
    verdicts = [claim["verdict"] for claim in found[name]["claims"]]
    held = [verdicts.count(verdict) for verdict in ("holds", "holds only if", "does not hold", "not decided")]
    assert row.split()[1:5] == [str(count) for count in held]
