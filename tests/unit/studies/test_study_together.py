"""All studies at once: each in a process of its own, their results by name, their progress reported."""

from pathlib import Path

import pytest

from studies.together import run_all

SMALL = "cwpa-kalman-tracker-3d"


def test_studies_run_in_processes_of_their_own_and_report_their_progress_3_seeds(tmp_path: Path) -> None:
    calls: list[tuple[str, int, int]] = []
    found = run_all([SMALL], 3, tmp_path, lambda name, done, total: calls.append((name, done, total)))
    assert list(found) == [SMALL]
    assert found[SMALL]["seeds"] == 3
    assert {name for name, _, _ in calls} == {SMALL}
    assert calls[-1][1] == calls[-1][2] > 0
    assert (tmp_path / SMALL / "report.md").exists()


def test_run_all_raises_the_error_of_a_study(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="seed"):
        run_all([SMALL], 0, tmp_path, lambda *_: None)
