"""All studies at once: each in a process of its own, their numbers by name, their progress told."""

from pathlib import Path

import pytest

from onboard.studies.together import run_all

SMALL = "cwpa-kalman-tracker-3d"


def test_studies_run_in_processes_of_their_own_and_tell_how_far_they_are_3_seeds(tmp_path: Path) -> None:
    told: list[tuple[str, int, int]] = []
    found = run_all([SMALL], 3, tmp_path, lambda name, done, total: told.append((name, done, total)))
    assert list(found) == [SMALL]
    assert found[SMALL]["seeds"] == 3
    assert {name for name, _, _ in told} == {SMALL}
    assert told[-1][1] == told[-1][2] > 0
    assert (tmp_path / SMALL / "report.md").exists()


def test_what_one_of_them_raises_is_raised(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="seed"):
        run_all([SMALL], 0, tmp_path, lambda *_: None)
