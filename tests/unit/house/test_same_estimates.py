"""The comparison of tables of estimates: what counts as the same on two processors."""

import math
from pathlib import Path

import pytest

from tests.support.exact_estimates import row_of, write_rows
from tests.support.records import make_estimate
from tests.support.same_estimates import TOLERANCE, largest_difference, main, rows

HEAD = "t_ns,state,x\n"


def table(path: Path, *lines: str) -> Path:
    path.write_text(HEAD + "".join(f"{line}\n" for line in lines), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("one", "other", "expected"),
    [
        ("1,tracking,2.0", "1,tracking,2.0", 0.0),
        ("1,tracking,nan", "1,tracking,nan", 0.0),
        ("1,tracking,2000.0", "1,tracking,2000.002", 1e-6),
        ("1,tracking,0.0", "1,tracking,0.001", 1e-3),
    ],
)
def test_a_difference_is_relative_above_1(one: str, other: str, expected: float, tmp_path: Path) -> None:
    paths = table(tmp_path / "one", "0,lost,", one), table(tmp_path / "other", "0,lost,", other)
    assert largest_difference(*paths) == pytest.approx(expected, rel=1e-5)
    assert main([*map(str, paths)]) == (expected > TOLERANCE)


@pytest.mark.parametrize("other", ["1,coasting,2.0", "1,tracking,nan", "1,tracking,", "1,tracking,inf"])
def test_other_states_and_missing_numbers_are_no_difference_in_numbers(other: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="and"):
        largest_difference(table(tmp_path / "one", "1,tracking,2.0"), table(tmp_path / "other", other))


def test_an_estimate_is_written_with_all_its_digits(tmp_path: Path) -> None:
    """Those of `onboard replay --out` end after six decimals: what differs by less would be the same."""
    numbers = math.nextafter(24.1, 25.0), 24.1 + 1e-7
    estimates = [make_estimate(mean=(x, 2.0), covariance=((1.0, 0.1), (0.1, 3.0))) for x in (24.1, *numbers)]
    for k, one in enumerate(estimates):
        write_rows([row_of(one), row_of(make_estimate(mean=None, covariance=None))], tmp_path / str(k))
    first, second, third = (tmp_path / str(k) for k in range(3))
    assert 0.0 < largest_difference(first, second) < 1e-15
    assert largest_difference(first, third) > TOLERANCE
    assert {"mean_1", "covariance_0_0", "covariance_1_0", "covariance_1_1"} <= rows(first)[0].keys()


def test_a_row_too_few_or_none_is_not_the_same(tmp_path: Path) -> None:
    two, one = table(tmp_path / "two", "1,a,1", "2,a,1"), table(tmp_path / "one", "1,a,1")
    for pair in ((two, one), (table(tmp_path / "none"), table(tmp_path / "no"))):
        with pytest.raises(ValueError, match="rows"):
            largest_difference(*pair)
