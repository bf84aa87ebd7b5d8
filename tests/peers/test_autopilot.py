"""A real ArduCopter follows another one in FOLLOW mode, on nothing but what `onboard run` sends, as the guide in
docs/ardupilot.md says: configs/sitl.toml, configs/ardupilot-follow.parm, and `simlink camera` between them.

It takes four minutes, and a computer that keeps up with two simulators. Set ARDUCOPTER to the binary that
`./waf copter` of ArduPilot's SITL builds (build/sitl/bin/arducopter)."""

import time
from pathlib import Path

import numpy as np
import pytest

from tests.support.arducopter import BINARY, Copter
from tests.support.formation_flown import SLOT, Row, field

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
        assert least(world.since(begin)) >= TWO_THIRDS

        world.fly(25.0, course, lambda _: SPEED)
        world.fly(35.0, course, lambda _: SPEED, rate=0.2)
        circle = world.since(time.monotonic() - 15.0)
        assert error(circle) < 3.0  # 5 before the slot's own velocity was sent
        assert lost_percent(circle) <= 2.0
        assert daemon.popen.poll() is None
        assert "Traceback" not in daemon.output()
