"""The scorecard in words."""

import pytest
from msgspec.structs import replace
from rich.console import Console

from onboard.scoring.fault import FaultScore
from onboard.scoring.leader import score_leader
from onboard.scoring.own_state import score_own_state
from onboard.scoring.scorecard import fault_rows, own_state_rows, print_own_state_score, score_rows
from tests.support.vehicle_records import nav_state

NAMED = FaultScore(
    happened="motor 1", at_s=70.0, named="motor 1", after_s=0.3, magnitude=0.24, unit="share", wrong=()
)


@pytest.mark.parametrize(("nis", "words"), [(4.1, "4.10, too cautious"), (6.0, "6.00"), (9.0, "9.00, too sure")])
def test_outside_its_bounds_a_nis_says_what_that_means(nis: float, words: str) -> None:
    score = replace(score_leader([], None), nis_mean=nis, nis_dof=6, nis_bounds=(5.7, 6.3), images_scored=500)
    assert ("NIS (6)", words, "5.70 to 6.30 (95 % of means)") in score_rows(score, None)


@pytest.mark.parametrize(
    ("nees", "words"), [(1.0, "1.00, too cautious"), (5.0, "5.00"), (15.0, "15.00, too sure")]
)
def test_so_does_a_nees_of_our_own_state(nees: float, words: str) -> None:
    score = score_own_state([nav_state()], [])
    assert score is not None
    flown = replace(
        score, velocity_rmse_m_s=0.1, nees_mean=nees, nees_dof=6, nees_bounds=(1.24, 14.45), nis_ratio=0.13
    )
    rows = own_state_rows(flown)
    assert ("NEES (6)", words, "1.24 to 14.45 (95 % of flights)") in rows
    assert ("NIS, of its expectation", "0.13", "1") in rows


def test_a_fault_is_named_or_not() -> None:
    named, wrongly = fault_rows(NAMED)
    assert named == ("fault named", "motor 1 (0.24), after 0.30 s", "motor 1, at 70.00 s")
    assert wrongly == ("named wrongly", "nothing", "nothing")
    missed, wrongly = fault_rows(replace(NAMED, named=None, wrong=("motor 3",)))
    assert missed[1] == "NOT NAMED"
    assert wrongly[1] == "motor 3"
    assert [row[0] for row in fault_rows(replace(NAMED, happened=None))] == ["named wrongly"]


def test_our_own_state_and_its_fault_stand_in_one_table() -> None:
    console = Console(record=True, width=100, quiet=False)
    score = score_own_state([nav_state()], [])
    assert score is not None
    print_own_state_score(console, "Own state", score, NAMED)
    text = console.export_text()
    assert "1 (1 valid)" in text
    assert "motor 1 (0.24), after 0.30 s" in text
