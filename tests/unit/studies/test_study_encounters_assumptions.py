"""The study of encounters with one assumption false: what is flown, what is claimed of it, and one flight."""

import numpy as np
import pytest

from simlink.encounters.encounter import make_encounter
from simlink.encounters.families import FAMILIES
from studies.encounters import peers, study
from studies.encounters.assumptions import ASSUMPTIONS, BROKEN, MAX_WRONG_PERCENT, name_of
from studies.encounters.flights import Case, Flight, known, mount_off

STEPS = 200


def made(wrong: int) -> Flight:
    """A flight at 20 m whose last `wrong` estimates are 2 m off at a sigma of 0.5 m."""
    range_ = np.full(STEPS, 20.0)
    range_[STEPS - wrong :] += 2.0
    ones = np.ones(STEPS)
    return Flight(np.linspace(5.0, 45.0, STEPS), 20.0 * ones, range_, 0.5 * ones, 3.0 * ones)


def test_each_assumption_is_broken_in_every_family_that_has_it() -> None:
    assert len(set(BROKEN)) == len(BROKEN)
    for name, assumption in ASSUMPTIONS.items():
        families = {case.family for case in BROKEN if name_of(case) == name}
        assert families == set(FAMILIES) - set(assumption.without)
    assert name_of(Case("hover")) == ""


@pytest.mark.parametrize(("wrong", "expected"), [(10, "holds"), (11, "does not hold")])
def test_five_percent_of_one_case_may_be_confidently_wrong(wrong: int, expected: str) -> None:
    astray = {case: [made(0)] * 2 for case in BROKEN} | {BROKEN[-1]: [made(wrong)] * 2}
    found = study.findings({Case("hover"): [made(0)] * 2}, 1, astray=astray)
    claim = next(claim for claim in found.claims if "assumption" in claim.claim)
    assert (str(claim.verdict), f"{MAX_WRONG_PERCENT:g} %" in claim.claim) == (expected, True)
    table, together = found.tables[-2:]
    assert sum(float(row[2] or 0.0) for row in together.rows) == 2.0 * len(BROKEN)
    assert [row[0] for row in together.rows] == list(ASSUMPTIONS)
    assert [len(row) for row in table.rows] == [len(table.header)] * len(BROKEN)
    assert table.rows[-1][:4] == (name_of(BROKEN[-1]), BROKEN[-1].name, 2.0, 0.5 * wrong)


def test_the_camera_is_configured_wrongly_about_one_axis_that_differs_by_seed() -> None:
    found = [mount_off(1.0, seed) for seed in range(6)]
    assert len(set(found)) == 6
    assert all(sorted(map(abs, off)) == [0.0, 0.0, 1.0] for off in found)
    encounter = make_encounter("hover", 1, 1.0)
    true = encounter.scenario.camera.mount_rpy_deg
    expected = f"camera.mount_rpy_deg={[true[0], true[1] + 1.0, true[2]]}"
    assert expected in known(encounter, mount_off(1.0, 1))


def test_the_first_seeds_fly_astray_too(monkeypatch: pytest.MonkeyPatch) -> None:
    def flight(case: Case, seed: int, *_: object) -> Flight:
        return made(int(seed == 501 and case == BROKEN[2]))

    monkeypatch.setattr(study, "fly", flight)
    monkeypatch.setattr(peers, "fly", lambda *_: peers.Pair(made(1), made(2)))
    found = study.run(8, 501, 1, None, cases=(Case("hover"),), compared=0)
    assert [len(table.rows) for table in found.tables[3:]] == [len(BROKEN), len(ASSUMPTIONS), len(peers.BESIDE)]
    rows = found.tables[3].rows
    assert (len(rows), {row[2] for row in rows}) == (len(BROKEN), {2.0})
    assert [row[3] for row in rows[:4]] == [0.0, 0.0, 0.25, 0.0]
