"""The table of what guidance remembers: every state ends, and what is sent depends on no doubt that has passed."""

import re
from collections.abc import Sequence
from enum import Enum
from itertools import chain
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from onboard.autopilot.guidance import Guidance, follower_of
from onboard.autopilot.guidance.ardupilot import FOLLOW
from onboard.autopilot.guidance.course import wrapped
from onboard.autopilot.guidance.px4 import FOLLOW_ME
from onboard.autopilot.guidance.states import MOTIONS, PHASES, Activity, Event, Machine, Phase, StateChange
from onboard.config import GuidanceConfig
from onboard.messages import Heartbeat
from onboard.messages.mavlink_enums import PX4
from tests.support.leader import S, T
from tests.support.programs import ROOT
from tests.unit.autopilot.test_guidance import state

TICK = S // 20
FORGETS_S = 30.0  # after which nothing of a doubt is left
ARDUPILOT = 3


@pytest.mark.parametrize("phase", Phase)
def test_a_leader_that_is_seen_is_followed_from_every_phase(phase: Phase) -> None:
    machine = Machine(PHASES, phase)
    machine.step({Event.SEEN: True}, 0.05)
    assert machine.state is Phase.FOLLOWED


@pytest.mark.parametrize("phase", Phase)
def test_one_that_is_lost_is_given_up_from_every_phase(phase: Phase) -> None:
    machine = Machine(PHASES, phase)
    for k in range(300):
        machine.step({Event.LOST: True, Event.HELD: k > 60}, 0.05)
    assert machine.state in {Phase.SILENT, Phase.UNLED}


@pytest.mark.parametrize("motion", Activity)
@pytest.mark.parametrize(
    ("events", "end"),
    [
        ({Event.SLOW: True, Event.CREEPS: True}, Activity.RESTS),
        ({Event.MOVES: True, Event.FAST: True}, Activity.FLIES),
        ({Event.MOVES: True, Event.FAST: True, Event.AGAINST: True}, Activity.FLIES),
        ({Event.MOVES: True, Event.ALONG: True}, Activity.FLIES),
    ],
)
def test_whatever_a_leader_did_ends_by_what_it_does(
    motion: Activity, events: dict[Event, bool], end: Activity
) -> None:
    machine = Machine(MOTIONS, motion)
    for _ in range(180):  # 9 s
        machine.step(events, 0.05)
    assert machine.state is end


def test_a_transition_waits_for_as_long_as_its_event_lasts() -> None:
    machine = Machine(MOTIONS, Activity.FLIES)
    for is_slow in (*[True] * 11, False, *[True] * 12):
        assert not machine.step({Event.SLOW: is_slow}, 0.25)
    assert machine.step({Event.SLOW: True}, 0.25)
    assert machine.state is Activity.RESTS


def test_the_page_has_the_table() -> None:
    page = (ROOT / "docs" / "follow.md").read_text(encoding="utf-8")
    shown = re.findall(r"^\| ([a-z, ]+) \| (.+) \| ([a-z ]+) \| ([0-9.]+ s|at once) \|$", page, re.MULTILINE)
    assert shown == [row_of(row) for row in chain[StateChange[Any]](PHASES, MOTIONS)]


def row_of(row: StateChange[Any]) -> tuple[str, str, str, str]:
    return words(row.of), row.when.value, row.to.value, f"{row.after_s:g} s" if row.after_s else "at once"


def words(states: Sequence[Enum]) -> str:
    return ", ".join(s.value for s in states)


@pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4])
@pytest.mark.parametrize("seed", range(5))
def test_what_is_sent_depends_on_no_doubt_that_has_passed(autopilot: int, seed: int) -> None:
    """20 s of doubts and modes in a random order, and then the leader is seen, sure, and flies on. What is sent is
    what a guidance sends that has never doubted anything."""
    rng = np.random.default_rng(seed)
    doubted, plain = (made(autopilot) for _ in range(2))
    v = np.array([-5.0, 0.0, 0.0])
    plain.virtual_leader(state(T, (0.0, 0.0, 0.0), v), np.array([30.0, 0.0, 3.0]), v)
    doubt: dict[str, Any] = {}
    for k in range(round((20.0 + FORGETS_S) * 20)):
        is_over = k >= 20 * 20
        if is_over or k % 7 == 0:
            doubt = {} if is_over else drawn(rng)
        t_ns, r = T + (k + 1) * TICK, v * (k / 20.0)
        r_F = r + np.array([30.0, 0.0, 3.0])
        for one, its in ((doubted, doubt), (plain, {})):
            mode(one, autopilot, entered=its.get("entered", True))
            speed = v * its.get("speed", 1.0)
            seen = state(t_ns, r, speed, sigma=its.get("sigma", 0.5), valid=its.get("valid", True))
            sent = one.virtual_leader(seen, r_F + its.get("off", 0.0), v)
            if one is doubted:
                compared = sent
    assert doubted.phase is plain.phase is Phase.FOLLOWED
    assert compared is not None
    assert sent is not None
    for name, within in (("r_OL_n", 0.5), ("v_L_n", 0.1), ("a_L_n", 0.1)):
        assert_allclose(getattr(compared, name), getattr(sent, name), atol=within)
    assert abs(wrapped(compared.course - sent.course)) < 0.02


def made(autopilot: int) -> Guidance:
    config = GuidanceConfig()
    return Guidance(config, None, follower_of(autopilot, config))


def mode(guidance: Guidance, autopilot: int, *, entered: bool) -> None:
    number = (FOLLOW_ME if autopilot == PX4 else FOLLOW) if entered else 5
    beat = {"t_ns": 0, "t_recv_ns": 0, "vehicle_type": 2, "autopilot": autopilot, "armed": True, "status": 4}
    guidance.note_mode(Heartbeat(**beat, custom_mode=number))


def drawn(rng: np.random.Generator) -> dict[str, Any]:
    """A doubt: of the range, of the leader, of its velocity, of the mode, or of the place."""
    return {
        "sigma": rng.choice([0.5, 8.0, 20.0]),
        "valid": rng.random() > 0.3,
        "speed": rng.choice([1.0, 0.1, -1.0]),
        "entered": rng.random() > 0.4,
        "off": rng.choice([0.0, 1.0]) * np.array([rng.uniform(-60.0, 10.0), rng.uniform(-30.0, 30.0), 0.0]),
    }
