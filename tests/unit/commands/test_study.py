"""`onboard study NAME`: what is given reaches the study, and nothing else does."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from onboard.commands import cli, study
from onboard.studies.report.workers import Computers


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
    monkeypatch.setattr(study, "run_study", run_study)
    monkeypatch.setattr(study, "_compile", lambda _names: None)
    assert cli.main(["study", "traffic", *options, "--out", str(tmp_path)]) == 0
    assert received == [given | where]
