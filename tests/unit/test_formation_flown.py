"""Flights of real autopilots are drawn by a seed, and judged by the truth alone."""

import math
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.support.courses import ACCELERATION, COMMAND_PERIOD_S, SIDES, Kind, draw, draw_plan
from tests.support.formation_flown import SLOT, Field, Row

COURSE = draw(Kind.STRAIGHT, "N", np.random.default_rng(1))._replace(heading=math.pi)
ORIGIN = np.zeros(3)


def flown(steps: list[float], texts: tuple[str, ...] = (), log: str = "", distance: float = 30.0) -> Field:
    follower: Any = SimpleNamespace(texts=texts)
    world = Field(Path(), follower, follower, ExitStack())
    world.daemons.append(SimpleNamespace(output=lambda: log))
    at = np.array([distance, 0.0, -SLOT[2]])
    for t in np.cumsum([0.0, *steps]).tolist():
        world.rows.append(Row(t, ORIGIN, ORIGIN, at, ORIGIN, 0.0, 0.0, in_view=True))
    return world


def test_a_follower_in_its_slot_is_as_asked() -> None:
    verdict = flown([0.1] * 100).judge(COURSE)
    assert verdict.misses == ()
    assert not verdict.is_void
    assert verdict.slot_rms_m == pytest.approx(0.0)
    assert verdict.in_place == 1.0


@pytest.mark.parametrize(
    ("texts", "distance", "miss"),
    [
        ((), 12.0, "too near"),
        ((), 50.0, "not in place at the end"),
        (("camera mount is off",), 30.0, "false words"),
    ],
)
def test_each_miss_is_named(texts: tuple[str, ...], distance: float, miss: str) -> None:
    assert miss in flown([0.1] * 100, texts, distance=distance).judge(COURSE).misses


@pytest.mark.parametrize(
    ("steps", "log"),
    [([0.1] * 90 + [0.5] * 10, ""), ([0.1] * 100, "this program stood still for 4.0 s")],
)
def test_a_flight_on_a_busy_computer_is_void(steps: list[float], log: str) -> None:
    assert flown(steps, log=log).judge(COURSE).is_void


def test_a_plan_has_each_course_once_and_is_begun_from_all_sides() -> None:
    plan = draw_plan(3)
    assert {course.kind for course in plan} == set(Kind)
    assert {course.side for course in plan} == set(SIDES)
    assert plan == draw_plan(3)
    assert plan != draw_plan(4)


@pytest.mark.parametrize("kind", Kind)
def test_a_course_is_flown_within_a_flight(kind: Kind) -> None:
    course = draw(kind, "E", np.random.default_rng(2))
    commands = list(course.commands())
    seconds = len(commands) * COMMAND_PERIOD_S
    assert 45.0 <= seconds <= 75.0
    speeds = np.array([math.hypot(*command.v_n[:2]) for command in commands])
    assert float(np.max(speeds)) <= course.speed + 1e-9
    assert float(np.max(np.abs(np.diff(speeds)))) <= ACCELERATION * COMMAND_PERIOD_S + 1e-9
    if course.outage is not None:
        assert course.outage[1] < seconds - 20.0
