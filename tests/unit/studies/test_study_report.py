"""The kit of the studies' reports: verdicts, bounds, figures over runs, Markdown."""

import math

import pytest

from studies.report.findings import Claim, Findings, Table, verdict, within
from studies.report.markdown import interval, markdown, number
from studies.report.runs import half_unit, mean, rms


@pytest.mark.parametrize(
    ("value", "low", "high", "inside"),
    [(1.0, 1.0, 1.0, True), (1.0, None, 0.9, False), (1.0, 1.1, None, False), (math.nan, None, None, False)],
)
def test_a_value_lies_within_bounds_that_may_be_open(
    value: float, low: float | None, high: float | None, inside: bool
) -> None:
    assert within(value, low, high) == inside
    assert not within(None, low, high)


def test_figures_over_runs_have_the_error_of_their_scatter_and_are_unknown_without_runs() -> None:
    found = rms([3.0, 4.0])
    assert found.value == pytest.approx(12.5**0.5)
    assert found.standard_error == pytest.approx(3.5 / (2 * 12.5**0.5))
    assert mean([1.0, 3.0]).standard_error == pytest.approx(1.0)
    assert mean([1.0]).standard_error is None
    assert rms([]).value is mean([math.nan, 1.0]).value is None


@pytest.mark.parametrize(("printed", "half"), [("2.72", 0.005), ("0.003", 0.0005), ("24", 0.5), (".1", 0.05)])
def test_half_a_unit_of_the_last_digit(printed: str, half: float) -> None:
    assert half_unit(printed) == pytest.approx(half)


def test_a_report_shows_tables_and_claims_and_leaves_out_what_there_is_not() -> None:
    claim = Claim(claim="It flies.", where="eq 1", verdict=verdict(False, only_if=True), evidence="a | b")
    table = Table(title="Errors", note="", header=("m", "s"), rows=((None, 2.0), ("|", 1.5)))
    text = markdown(
        Findings(
            study="paper",
            title="A paper",
            setting="One flight.",
            seeds=1,
            first_seed=7,
            tables=(table,),
            claims=(claim,),
        )
    )
    assert "## Errors\n\n| m | s |\n| --- | --- |\n| – | 2 |\n| \\| | 1.5 |" in text
    assert "| It flies. | eq 1 | **holds only if** | a \\| b |" in text
    assert "independent" not in text
    assert "Misprints" not in text
    assert [number(None), number(math.nan), number(1.23456)] == ["–", "–", "1.23"]
    assert [interval(None, 2.0), interval(2.0, None), interval(1.0, 2.5)] == ["≤ 2", "≥ 2", "1 to 2.5"]
