"""A real PX4 follows another one in Follow-Me, on nothing but what `onboard run` sends, as the guide in
docs/px4.md says: configs/sitl.toml, configs/px4-follow.params, and `simlink camera` between them.

It takes five minutes, and a computer that keeps up with two simulators. Set PX4 to the binary that
`make px4_sitl` of PX4 1.17 builds (build/px4_sitl_default/bin/px4)."""

import math
import time
from pathlib import Path

import numpy as np
import pytest

from onboard.autopilot.guidance.px4 import PASSES
from tests.support.formation_flown import SLOT, Field, Row, field
from tests.support.px4 import BINARY, Px4

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not Path(BINARY).is_file(), reason="PX4 names no binary of PX4's simulation in hardware"),
]

SPEED = 5.0  # m/s
SOUTH = math.pi
DISTANCE = float(np.linalg.norm(SLOT))


def least(rows: list[Row]) -> float:
    return min(row.distance for row in rows)


def placed(world: Field, north_m: float) -> None:
    """Fly the follower, with its nose on the leader, to so far north of it."""
    follower, leader = world.follower, world.leader
    end = time.monotonic() + 40.0
    while time.monotonic() < end:
        off = leader.r_n + np.array([north_m, 0.0, 0.0]) - follower.r_n
        if math.hypot(*off[:2]) < 1.5 and float(np.linalg.norm(follower.v_n)) < 0.5:
            return
        v = 0.8 * off[:2] * min(1.0, 5.0 / max(0.8 * math.hypot(*off[:2]), 1e-6))
        away = leader.r_n - follower.r_n
        follower.go((float(v[0]), float(v[1]), 0.0), math.atan2(away[1], away[0]))
        leader.go((0.0, 0.0, 0.0), SOUTH)  # it takes the mode with a set point alone
        follower.obey()
        leader.obey()
        world.fly(0.1, SOUTH, lambda _: 0.0)
    raise AssertionError(f"the follower did not come to its place: {off}")


def test_a_real_px4_follows(tmp_path: Path) -> None:
    with field(tmp_path, Px4, -40.0) as world:
        daemon = world.daemon()
        world.camera()
        world.take_off()
        placed(world, 30.0)
        world.fly(6.0, SOUTH, lambda _: 0.0)
        begin = time.monotonic()
        world.follower.follow()
        world.fly(15.0, SOUTH, lambda _: 0.0)
        course = world.fly(30.0, SOUTH, lambda t: min(t, SPEED))
        course = world.fly(25.0, course, lambda _: SPEED, rate=SPEED / 40.0)
        circle = world.since(time.monotonic() - 20.0)
        world.require(max(row.distance for row in circle) <= 2.0 * DISTANCE, "too far in the circle")
        assert float(np.mean([row.in_view for row in circle])) >= 0.95
        world.fly(8.0, course, lambda t: max(SPEED - t, 0.0))
        world.fly(8.0, course, lambda t: -min(t, 3.0))
        world.require(least(world.since(begin)) >= 2.0 / 3.0 * DISTANCE, f"{least(world.since(begin)):.1f} m")
        assert daemon.popen.poll() is None
        assert "Traceback" not in daemon.output()


def test_a_real_px4_that_would_pass_the_leader_stays(tmp_path: Path) -> None:
    with field(tmp_path, Px4, 40.0) as world:
        daemon = world.daemon()
        world.camera()
        world.take_off()
        placed(world, -30.0)
        for _ in range(15):
            world.fly(1.0, SOUTH, lambda _: 0.0)
            if PASSES in daemon.output():
                break
        assert PASSES in daemon.output()
        begin = time.monotonic()
        world.follower.follow()
        world.fly(20.0, SOUTH, lambda _: 0.0)
        assert least(world.since(begin)) >= 0.8 * DISTANCE
