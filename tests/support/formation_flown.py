"""Two real autopilots, each in its own simulator, with the daemon and `simlink camera` on them: the leader is
flown by velocities, the follower by its follow mode."""

import math
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Final, NamedTuple, Protocol

import numpy as np
import pytest

from onboard.arrays import Array
from onboard.geometry.rotations import matrix_from_euler
from tests.support.programs import ROOT, Program, free_ports, started

HOME: Final = (47.3977, 8.5456, 488.0)
SLOT: Final = (-30.0, 0.0, 3.0)  # as in configs/ardupilot-follow.parm and configs/px4-follow.params
MOUNT_DEG, F_PX, HALF_PX = 15.0, 554.256, (320.0, 240.0)  # configs/sitl.toml
FOLLOWER, LEADER = 1, 2  # MAVLink systems
READY_S: Final = 150.0  # until the filters know where they are, and both have climbed
MOVES: Final = 2.0  # m/s: faster, the leader's velocity shows its course
LATE_S, FEW = 0.3, 0.02  # s between two rows, of 0.1; the share of them that a computer may be late with
STOOD_STILL = "stood still"  # a line of the daemon's, whose timers were late by a second

Velocity = tuple[float, float, float]


class Vehicle(Protocol):
    """One autopilot and its simulator. `for_daemon`, `for_camera`: addresses; `texts`: its STATUSTEXTs. Its true
    position (m) and velocity (m/s) are in n of HOME."""

    for_daemon: str
    for_camera: str
    texts: list[str]

    @property
    def is_up(self) -> bool:
        """Whether it has climbed, and the truth is heard."""

    @property
    def r_n(self) -> Array:
        """The true position."""

    @property
    def v_n(self) -> Array:
        """The true velocity."""

    @property
    def R_nb(self) -> Array:
        """The true attitude."""

    def read(self) -> None:
        """Take what has come, and ask for the truth again and again."""

    def climb(self) -> None:
        """Ask it to arm and to climb."""

    def obey(self) -> None:
        """Ask for the mode in which it flies velocities."""

    def follow(self) -> None:
        """Ask for the mode that follows."""

    def go(self, v_n: Velocity, yaw: float) -> None:
        """Fly with this velocity (m/s, NED) and heading (rad) from now on."""

    def end(self) -> None:
        """End the process."""


class Row(NamedTuple):
    """What is true at one time, s: both places (m) and velocities (m/s) in n, the follower's pitch (rad), the
    leader's heading as it was flown (rad), and whether the leader was inside the image."""

    t: float
    r_F: Array
    v_F: Array
    r_L: Array
    v_L: Array
    pitch: float
    heading: float
    in_view: bool

    @property
    def distance(self) -> float:
        """Between both, m."""
        return float(np.linalg.norm(self.r_L - self.r_F))

    @property
    def aside(self) -> float:
        """How far the follower is from its side of the leader, about it, rad."""
        north, east = (self.r_F - self.r_L)[:2].tolist()
        return abs(math.remainder(math.atan2(east, north) - self.heading - math.pi, 2.0 * math.pi))

    def slot_error(self, height: float = 1.0) -> float:
        """The follower's distance from its slot, m, behind the leader's course while it flies forward. `height`:
        the weight of the height, 0 to leave it out."""
        course, (north, east) = self.heading, self.v_L[:2].tolist()
        if math.hypot(north, east) > MOVES and north * math.cos(course) + east * math.sin(course) > 0.0:
            course = math.atan2(east, north)
        c, s, (x, y, z) = math.cos(course), math.sin(course), SLOT
        error = self.r_F - self.r_L - np.array([c * x - s * y, s * x + c * y, z])
        return float(np.linalg.norm(error * [1.0, 1.0, height]))


class Field:
    """Both vehicles, and the camera and the daemon on them. `rows`: ten a second while the leader flies."""

    def __init__(self, folder: Path, follower: Vehicle, leader: Vehicle, stack: ExitStack) -> None:
        self.follower, self.leader = follower, leader
        self.rows: list[Row] = []
        self._folder, self._stack, self._count = folder, stack, 0
        (zenoh,) = free_ports(socket.SOCK_STREAM)
        self._zenoh = f"tcp/127.0.0.1:{zenoh}"

    def daemon(self) -> Program:
        """`onboard run` on configs/sitl.toml, as it ships."""
        link = f"link=[{{name='autopilot', url='{self.follower.for_daemon}'}}]"
        settings = [a for one in (link, f"zenoh.listen=['{self._zenoh}']") for a in ("--set", one)]
        return self._program("onboard", "run", ROOT / "configs" / "sitl.toml", *settings)

    def camera(self) -> Program:
        """`simlink camera` between both."""
        urls = [vehicle.for_camera for vehicle in (self.follower, self.leader)]
        to = ("--follower", urls[0], "--leader", urls[1], "--zenoh", self._zenoh)
        return self._program("simlink", "camera", *to)

    def _program(self, *command: str | Path) -> Program:
        self._count += 1
        return self._stack.enter_context(started(self._folder / f"{command[0]}-{self._count}.log", *command))

    def take_off(self) -> None:
        """Let both climb. Raises AssertionError if they do not."""
        vehicles, begin, asked = (self.follower, self.leader), time.monotonic(), 0.0
        while not all(v.is_up for v in vehicles):
            now = time.monotonic()
            assert now - begin < READY_S, f"no take-off: {[v.texts[-5:] for v in vehicles]}"
            if now - asked > 3.0:
                asked = now
                for v in vehicles:
                    v.climb()
            self._turn()

    def fly(self, seconds: float, course: float, speed: Callable[[float], float], rate: float = 0.0) -> float:
        """Fly the leader with a speed by the seconds since this began, negative backwards, on a course (rad) that
        turns with a rate (rad/s). Returns the course at the end."""
        begin = noted = sent = time.monotonic()
        while (t := time.monotonic() - begin) < seconds:
            now, at = begin + t, course + rate * t
            if now - sent > 0.1:
                sent, v = now, speed(t)
                self.leader.go((v * math.cos(at), v * math.sin(at), 0.0), at)
            if now - noted > 0.1:
                noted = now
                self.rows.append(self._row(at))
            self._turn()
        return course + rate * seconds

    def require(self, holds: bool, what: str) -> None:
        """Raises AssertionError for a miss. On a computer that did not keep up it is none: skips the test, and
        says by what that is known."""
        late = float((np.diff([row.t for row in self.rows]) > LATE_S).mean())
        logs = [path.read_text("utf-8", "replace") for path in self._folder.glob("onboard-*.log")]
        stood = sum(log.count(STOOD_STILL) for log in logs)
        if not holds and (late > FEW or stood):
            pytest.skip(
                f"{what}: {100 * late:.0f} % of rows were late, and the daemon {STOOD_STILL} {stood} times"
            )
        assert holds, what

    def since(self, t: float) -> list[Row]:
        """The rows since a time of the monotonic clock."""
        return [row for row in self.rows if row.t >= t]

    def _turn(self) -> None:
        for vehicle in (self.follower, self.leader):
            vehicle.read()
        time.sleep(0.01)

    def _row(self, heading: float) -> Row:
        f, leader = self.follower, self.leader
        R = f.R_nb @ matrix_from_euler(0.0, math.radians(MOUNT_DEG), 0.0)
        x, y, z = (R.T @ (leader.r_n - f.r_n)).tolist()
        inside = x > 0.0 and abs(y / x) < HALF_PX[0] / F_PX and abs(z / x) < HALF_PX[1] / F_PX
        return Row(
            time.monotonic(), f.r_n, f.v_n, leader.r_n, leader.v_n, math.asin(-f.R_nb[2, 0]), heading, inside
        )


@contextmanager
def field(folder: Path, make: Callable[[Path, int, float], Vehicle], apart_m: float) -> Iterator[Field]:
    """Two vehicles that boot, the leader so far to the north. Nothing of them is left behind."""
    with ExitStack() as stack:
        vehicles = []
        for name, system, north_m in (("follower", FOLLOWER, 0.0), ("leader", LEADER, apart_m)):
            vehicles.append(make(folder / name, system, north_m))
            stack.callback(vehicles[-1].end)
        yield Field(folder, *vehicles, stack=stack)
