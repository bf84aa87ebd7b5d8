"""A good flight is no FAIL."""

import math

import pytest

from onboard.analysis.report.series import FlightSeries
from onboard.analysis.report.verdict import Grade, _own_state


@pytest.mark.parametrize(
    ("valid", "nis", "grades"),
    [
        ([0] * 50 + [1] * 50, 1.0, [Grade.PASS, Grade.PASS]),  # half of it on the ground
        ([1] * 100, 5.0, [Grade.PASS, Grade.AMBER]),  # by which velocity was 0.03 m/s off
        ([1] * 100, 0.1, [Grade.PASS, Grade.AMBER]),
        ([1] * 80 + [0] * 20, 1.0, [Grade.AMBER, Grade.PASS]),
        ([0] * 50 + [1] * 20 + [0] * 80, 1.0, [Grade.FAIL, Grade.PASS]),
        ([0] * 100, math.nan, [Grade.FAIL]),
    ],
)
def test_our_own_state_is_graded_by_what_it_was_in_flight(
    valid: list[int], nis: float, grades: list[Grade]
) -> None:
    series = FlightSeries("leader")
    for k, one in enumerate(valid):
        series.own_state.append(0.1 * k, one, nis if one else math.nan, 0.0, 0.0, 0.0)
    assert [check.grade for check in _own_state(series)] == [*grades, Grade.PASS]  # the last: no faults
