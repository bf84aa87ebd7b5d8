"""A real ArduCopter follows another one in FOLLOW mode, on nothing but what `onboard run` sends, as the guide in
docs/ardupilot.md says: configs/sitl.toml, configs/ardupilot-follow.parm, and `simlink camera` between them.

It takes four minutes, and a computer that keeps up with two simulators. Set ARDUCOPTER to the binary that
`./waf copter` of ArduPilot's SITL builds (build/sitl/bin/arducopter)."""

import math
import time
from pathlib import Path

import numpy as np
import pytest

from tests.support.arducopter import BINARY, Copter
from tests.support.formation_flown import SLOT, Field, Row, field

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not Path(BINARY).is_file(), reason="ARDUCOPTER names no binary of ArduCopter's SITL"),
]

SPEED = 8.0  # m/s
TWO_THIRDS = float(np.linalg.norm(SLOT)) * 2.0 / 3.0


def least(rows: list[Row]) -> float:
    return min(row.distance for row in rows)


def lost_percent(rows: list[Row]) -> float:
    return 100.0 * float(np.mean([not row.in_view for row in rows]))


def error(rows: list[Row]) -> float:
    """The median error of the slot in the plane: in a turn it is higher, to see the leader."""
    return float(np.median([row.slot_error(height=0.0) for row in rows]))


def behind_at_the_end(world: Field) -> None:
    """Followed: on its side of the leader, at 50 to 150 % of the slot's distance, for the last 5 s."""
    rows, of_slot = world.since(time.monotonic() - 5.0), 1.5 * TWO_THIRDS
    world.require(
        all(0.5 * of_slot < row.distance < 1.5 * of_slot for row in rows), f"{rows[-1].distance:.0f} m off"
    )
    world.require(
        all(row.aside < math.radians(60.0) for row in rows), f"{math.degrees(rows[-1].aside):.0f} deg aside"
    )


def begun(world: Field) -> float:
    """Both in the air, the follower in FOLLOW; the leader's course."""
    world.camera()
    world.take_off()
    course = world.fly(6.0, 0.0, lambda _: 0.0)
    world.follower.follow()
    return world.fly(8.0, course, lambda _: 0.0)


@pytest.mark.parametrize("stops", [False, True])
def test_a_real_leader_that_turns_round_is_followed(tmp_path: Path, stops: bool) -> None:
    with field(tmp_path, Copter, 33.0) as world:
        world.daemon()
        course, begin = begun(world), time.monotonic()
        course = world.fly(20.0, course, lambda t: min(t, 6.0))
        course = world.fly(8.0, course, lambda t: max(6.0 - t, 0.0 if stops else 3.0))
        if stops:
            course = world.fly(5.0, course + math.pi, lambda _: 0.0)
        else:
            course = world.fly(2.0 * math.pi, course, lambda _: 3.0, rate=0.5)
        world.fly(45.0, course, lambda t: min(3.0 + 0.5 * t, 6.0))
        world.require(least(world.since(begin)) >= TWO_THIRDS, f"{least(world.since(begin)):.1f} m")
        behind_at_the_end(world)


def test_a_daemon_killed_in_a_circle_goes_on(tmp_path: Path) -> None:
    with field(tmp_path, Copter, 33.0) as world:
        daemon = world.daemon()
        course, begin = begun(world), time.monotonic()
        course = world.fly(20.0, course, lambda t: min(t, 7.0))
        course = world.fly(20.0, course, lambda _: 7.0, rate=0.17)
        daemon.popen.kill()
        course = world.fly(2.0, course, lambda _: 7.0, rate=0.17)
        world.daemon()
        world.fly(45.0, course, lambda _: 7.0, rate=0.17)
        world.require(least(world.since(begin)) >= TWO_THIRDS, f"{least(world.since(begin)):.1f} m")
        behind_at_the_end(world)


def test_a_real_autopilot_follows(tmp_path: Path) -> None:
    with field(tmp_path, Copter, 33.0) as world:
        daemon = world.daemon()
        world.camera()
        world.take_off()
        course = world.fly(5.0, 0.0, lambda _: 0.0)
        world.follower.follow()
        course = world.fly(8.0, course, lambda _: 0.0)  # which has never flown, so it has no course of its own
        assert world.rows[-1].slot_error() < 6.0  # a hover leaves the range open
        assert not [text for text in world.follower.texts if "no course" in text]

        course = world.fly(40.0, course, lambda _: SPEED)
        straight = world.since(time.monotonic() - 12.0)
        assert error(straight) < 2.0
        assert np.degrees(np.std([row.pitch for row in straight])) <= 2.0
        assert lost_percent(straight) <= 2.0

        begin = time.monotonic()
        world.fly(7.0, course, lambda t: SPEED * (1.0 - t / 7.0))
        world.fly(10.0, course, lambda _: 0.0)
        world.fly(8.0, course, lambda _: -4.0)
        world.fly(8.0, course, lambda _: 0.0)
        world.require(least(world.since(begin)) >= TWO_THIRDS, f"{least(world.since(begin)):.1f} m")

        world.fly(25.0, course, lambda _: SPEED)
        world.fly(35.0, course, lambda _: SPEED, rate=0.2)
        circle = world.since(time.monotonic() - 15.0)
        world.require(error(circle) < 3.0, f"{error(circle):.1f} m")  # 5 before the slot's own velocity was sent
        world.require(lost_percent(circle) <= 2.0, f"{lost_percent(circle):.0f} % of the images lost")
        assert daemon.popen.poll() is None
        assert "Traceback" not in daemon.output()
