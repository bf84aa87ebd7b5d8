"""Whether a fault was named, of flights made by hand: states at 10 Hz from 1 s to 41 s."""

import pytest

from onboard.messages import Fault, FaultKind, NavState, Truth
from onboard.scoring.fault import FaultScore, score_fault
from tests.support.vehicle_records import nav_state, truth

MOTOR, MASS, GUST, OUTLIERS = FaultKind.MOTOR, FaultKind.MASS, FaultKind.GUST, FaultKind.OUTLIERS
Span = tuple[str, float, float]


def flown(*happened: Span, named: tuple[tuple[FaultKind, str, float, float], ...] = ()) -> FaultScore:
    """The score of what `happened` and what was `named`, each from when to when (s)."""
    states: list[NavState] = []
    truths: list[Truth] = []
    for t_ms in range(1000, 41000, 100):
        t = t_ms * 1e-3
        faults = tuple(
            Fault(kind=kind, part=part, t_onset_ns=round(begin * 1e9), magnitude=t / 100, unit="lost")
            for kind, part, begin, end in named
            if begin <= t < end
        )
        states.append(nav_state(t_ms, faults=faults))
        there = ", ".join(name for name, begin, end in happened if begin <= t < end)
        truths.append(truth(t_ms * 1_000_000, fault=there))
    score = score_fault(states, truths)
    assert score is not None
    return score


def test_a_fault_is_named_after_a_while_with_its_latest_size() -> None:
    score = flown(("motor 1", 20.0, 99.0), named=((MOTOR, "motor 1", 20.3, 99.0),))
    assert (score.happened, score.named, score.wrong) == ("motor 1", "motor 1", ())
    assert (score.at_s, score.after_s) == pytest.approx((20.0, 0.3))
    assert (score.magnitude, score.unit) == (pytest.approx(0.409), "lost")


def test_another_motor_or_the_same_one_too_early_is_named_wrongly() -> None:
    other = flown(("motor 1", 20.0, 99.0), named=((MOTOR, "motor 2", 20.3, 99.0),))
    assert (other.named, other.after_s, other.magnitude, other.wrong) == (None, None, None, ("motor 2",))
    early = flown(("motor 1", 20.0, 99.0), named=((MOTOR, "motor 1", 12.0, 13.0),))
    assert (early.named, early.wrong) == (None, ("motor 1",))


def test_of_a_gust_and_a_fault_the_fault_counts_and_the_gust_is_not_wrong() -> None:
    score = flown(
        *(("gust", 10.0, 13.0), ("motor 1", 20.0, 99.0)),
        named=((GUST, "", 10.5, 14.5), (MOTOR, "motor 1", 20.4, 99.0)),
    )
    assert (score.happened, score.named, score.wrong) == ("motor 1", "motor 1", ())
    later = flown(("gust", 10.0, 13.0), named=((GUST, "", 18.0, 19.0),))
    assert (later.happened, later.named, later.wrong) == ("gust", None, ("gust",))


@pytest.mark.parametrize("cause", ["mass", "inputs"])
def test_more_mass_and_weaker_inputs_are_one_kind(cause: str) -> None:
    assert flown((cause, 20.0, 99.0), named=((MASS, "", 20.5, 99.0),)).named == "mass"


def test_without_a_fault_only_what_the_truth_tells_of_can_be_wrong() -> None:
    score = flown(named=((OUTLIERS, "attitude.roll", 20.0, 21.0), (MASS, "", 25.0, 26.0)))
    assert (score.happened, score.at_s, score.named, score.wrong) == (None, None, None, ("mass",))


def test_without_states_or_truth_there_is_no_score() -> None:
    assert score_fault([], [truth(0)]) is None
    assert score_fault([nav_state()], []) is None
