"""The study of encounters over a folder of logs: what it flies, what it refuses in words, what it claims."""

from pathlib import Path

import numpy as np
import pytest

from studies.encounters import recorded, study
from studies.encounters.flights import NOT_FLOWN, Case, Flight, encounter_of, known
from tests.unit.simlink.test_recorded import as_csv, recording
from tests.unit.studies.test_study_encounters_assumptions import made


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """One log of use, one too short, and a file that is none."""
    as_csv(tmp_path / "circle.csv", recording(hz=20.0))
    whole = recording()
    as_csv(tmp_path / "short.csv", whole._replace(places=whole.places[:50]))
    (tmp_path / "notes.txt").write_text("no log", encoding="utf-8")
    return tmp_path


def test_every_log_is_flown_from_every_side_and_others_are_named(folder: Path) -> None:
    part = study.options(None, None, departures=False, leaders_from=folder)
    assert [case.name for case in part["cases"]] == [f"circle.csv, {side}" for side in recorded.GEOMETRIES]
    (why,) = part["refused"]
    assert why.startswith("short.csv: no 20 s of flight")
    assert len(study.options(None, "orbit,steep", departures=False, leaders_from=folder)["cases"]) == 2
    with pytest.raises(ValueError, match="no geometry 'below'; there are: behind"):
        study.options(None, "below", departures=False, leaders_from=folder)
    (folder / "circle.csv").unlink()
    with pytest.raises(ValueError, match=r"holds no flight: short\.csv"):
        study.options(None, None, departures=False, leaders_from=folder)


def test_size_and_follower_are_drawn_by_the_seed_seeds_1_to_8(folder: Path) -> None:
    case = Case("hover", log=str(folder / "circle.csv"))
    drawn = [encounter_of(case, seed) for seed in range(1, 9)]
    sizes = [one.size_prior for one in drawn if one is not None]
    assert len(set(sizes)) == len(sizes) == 8
    assert all(0.35 <= size <= 1.2 for size in sizes)
    again = encounter_of(case, 1)
    assert again is not None
    assert drawn[0] is not None
    assert np.array_equal(again.truth.follower.r, drawn[0].truth.follower.r)
    assert f"estimator.leader.size_prior_m={sizes[0]}" in known(drawn[0])
    assert encounter_of(Case("hover", log=str(folder / "short.csv")), 1) is None


@pytest.mark.parametrize(("wrong", "expected"), [(6, "holds"), (7, "does not hold")])
def test_three_percent_of_a_log_may_be_wrong_and_what_is_not_flown_counts_nowhere(
    wrong: int, expected: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fly(case: Case, seed: int, settings: tuple[str, ...]) -> Flight:
        del settings
        return NOT_FLOWN if case.family == "trail" or seed > 40 else made(wrong)

    monkeypatch.setattr(study, "fly", fly)
    cases = [Case(side, log="logs/a.bin") for side in ("hover", "trail")]
    found = study.run(41, 1, 1, cases=cases, compared=0, broken=0)
    (claim,) = (c for c in found.claims if "confidently wrong in each log" in c.claim)
    assert claim.verdict == expected
    table = next(t for t in found.tables if t.title == "Leaders that others flew")
    assert [row[:2] for row in table.rows] == [("a.bin", 40.0)]
