"""A miss of a real autopilot is told from a computer that did not keep up."""

from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.formation_flown import Field, Row

ORIGIN = np.zeros(3)


def flown(folder: Path, steps: list[float], log: str = "") -> Field:
    (folder / "onboard-1.log").write_text(log, encoding="utf-8")
    vehicle: Any = None
    world = Field(folder, vehicle, vehicle, ExitStack())
    for t in np.cumsum([0.0, *steps]).tolist():
        world.rows.append(Row(t, ORIGIN, ORIGIN, np.array([30.0, 0.0, 0.0]), ORIGIN, 0.0, 0.0, in_view=True))
    return world


def test_a_miss_is_a_failure_where_the_computer_kept_up(tmp_path: Path) -> None:
    world = flown(tmp_path, [0.1] * 100)
    world.require(True, "near")
    with pytest.raises(AssertionError, match="12 m"):
        world.require(False, "12 m")


@pytest.mark.parametrize(
    ("steps", "log"),
    [([0.1] * 90 + [0.5] * 10, ""), ([0.1] * 100, "this program stood still for 4.0 s")],
)
def test_on_a_busy_one_it_is_skipped(tmp_path: Path, steps: list[float], log: str) -> None:
    world = flown(tmp_path, steps, log)
    with pytest.raises(pytest.skip.Exception, match="12 m"):
        world.require(False, "12 m")
    world.require(True, "near")


def test_a_follower_is_on_its_side_behind_the_leader(tmp_path: Path) -> None:
    (row,) = flown(tmp_path, []).rows
    assert row.aside == pytest.approx(0.0)
    assert row._replace(r_F=np.array([30.0, 20.0, 0.0])).aside == pytest.approx(np.pi / 2)
