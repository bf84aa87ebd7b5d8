"""Two real autopilots, each in its own simulator, with the daemon and `simlink camera`.

A pilot flies the leader along a course by velocities. The daemon leads the follower: the pilot only takes it off,
and enters the mode in which its autopilot flies setpoints.
"""

import math
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, Final, NamedTuple, Protocol

import numpy as np

from onboard.arrays import Array
from onboard.geometry.rotations import matrix_from_euler
from tests.support.courses import COMMAND_PERIOD_S, SIDES, Command, Course, Kind
from tests.support.programs import CODE, Program, free_ports, started

HOME: Final = (47.3977, 8.5456, 488.0)
EARTH_RADIUS_M: Final = 6_378_137.0
SLOT: Final = (-30.0, 0.0, 3.0)  # `slot_m` of [guidance]
MOUNT_DEG, F_PX, HALF_PX = 15.0, 554.256, (320.0, 240.0)  # configs/sitl.toml
FOLLOWER, LEADER = 1, 2  # MAVLink systems
LEADER_HEIGHT_M: Final = 25.0
TAKEOFF_TIMEOUT_S: Final = 150.0  # until the filters have a position, and both have climbed
SETTLING_TIME_S: Final = 14.0  # from the first image to the beginning of the course
PREVIEW_TIME_S: Final = 6.0  # the part of it before the mode is entered
ENTRY_TIMEOUT_S: Final = 8.0  # until the autopilot confirms the mode
SILENCE_TIMEOUT_S: Final = 3.0  # of a simulator's truth
ASK_PERIOD_S: Final = 1.0
HEIGHT_GAIN: Final = 0.5  # 1/s, of the leader's height
MIN_COURSE_SPEED: Final = 2.0  # m/s; faster, the leader's velocity shows its course
MAX_ROW_INTERVAL_S: Final = 0.3  # of COMMAND_PERIOD_S; longer is late
MAX_LATE_RATIO: Final = 0.02  # of the rows
STOOD_STILL: Final = "stood still"  # a line of the daemon's, whose timers were late by a second
FALSE_WORDS: Final = ("focal length", "mount", "is its detector running?")  # in STATUSTEXT: nothing is wrong
FINAL_TIME_S: Final = 5.0  # at the end of a flight, in which the follower must be in its place
MAX_ANGLE: Final = math.radians(60.0)  # of the follower from its side
MIN_VIEW_SHARE: Final = 0.9

Velocity = tuple[float, float, float]


class Start(NamedTuple):
    """The position at boot (m from HOME), heading (rad), and the height to climb to."""

    north_m: float
    east_m: float
    yaw: float
    height_m: float


class Vehicle(Protocol):
    """One autopilot and its simulator.

    `for_daemon`, `for_camera`: addresses; `texts`: its STATUSTEXTs. Its true position (m) and velocity (m/s) are
    in n of HOME.
    """

    for_daemon: str
    for_camera: str
    texts: list[str]

    @property
    def is_up(self) -> bool:
        """Whether it has climbed, and the truth is heard."""

    @property
    def is_in_setpoint_mode(self) -> bool:
        """Whether its last heartbeat was in the mode that flies setpoints."""

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

    def hold(self) -> None:
        """Ask for the mode that holds the position, with its first heading."""

    def follow(self) -> None:
        """Ask for the mode that flies setpoints."""

    def go(self, v_n: Velocity, yaw: float) -> None:
        """Fly with this velocity (m/s, NED) and heading (rad) from now on, in the mode for setpoints."""

    def end(self) -> None:
        """End the process."""


class Row(NamedTuple):
    """The true states at one time (s)."""

    t: float
    r_F: Array  # m in n
    v_F: Array  # m/s
    r_L: Array
    v_L: Array
    pitch: float  # rad, of the follower
    heading: float  # rad, as flown by the leader
    in_view: bool  # whether the leader was inside the image

    @property
    def distance(self) -> float:
        """Between both, m."""
        return float(np.linalg.norm(self.r_L - self.r_F))

    @property
    def aside(self) -> float:
        """The angle between the follower and its side of the leader, rad."""
        north, east = (self.r_F - self.r_L)[:2].tolist()
        return abs(math.remainder(math.atan2(east, north) - self.heading - math.pi, 2.0 * math.pi))

    @property
    def is_in_place(self) -> bool:
        """On its side of the leader, at 50 to 150 % of the slot's distance."""
        return self.aside < MAX_ANGLE and 0.5 < self.distance / math.dist(SLOT, (0.0, 0.0, 0.0)) < 1.5

    @property
    def slot_error(self) -> float:
        """The follower's distance from its slot behind the leader's course, m, in forward flight."""
        course, (north, east) = self.heading, self.v_L[:2].tolist()
        if math.hypot(north, east) > MIN_COURSE_SPEED and north * math.cos(course) + east * math.sin(course) > 0.0:
            course = math.atan2(east, north)
        c, s, (x, y, z) = math.cos(course), math.sin(course), SLOT
        return float(np.linalg.norm(self.r_F - self.r_L - np.array([c * x - s * y, s * x + c * y, z])))


class Verdict(NamedTuple):
    """A flight by issue 71. `is_void`: the computer did not keep up, so nothing was shown."""

    min_m: float
    max_m: float
    min_allowed_m: float
    slot_rms_m: float
    slot_median_m: float
    end_m: float
    end_angle_deg: float
    in_place: float
    in_view: float
    false_words: tuple[str, ...]
    late: float
    stood_still: int
    is_void: bool
    misses: tuple[str, ...]


class Field:
    """Both vehicles, and the camera and the daemon on them.

    `rows`: ten a second since the mode was entered.
    """

    def __init__(self, folder: Path, follower: Vehicle, leader: Vehicle, stack: ExitStack) -> None:
        self.follower, self.leader, self.stack = follower, leader, stack
        self.folder = folder
        self.rows: list[Row] = []
        self.daemons: list[Program] = []
        self.entered = 0  # characters of the first daemon's log when the mode was entered
        self._height_m = LEADER_HEIGHT_M
        (zenoh,) = free_ports(socket.SOCK_STREAM)
        self.zenoh = f"tcp/127.0.0.1:{zenoh}"

    def daemon(self) -> Program:
        """`onboard run` on configs/sitl.toml, as it ships."""
        link = f"link=[{{name='autopilot', url='{self.follower.for_daemon}'}}]"
        place = f"recorder.path='{self.folder / 'flight.mcap'}'"
        settings = [a for one in (link, f"zenoh.listen=['{self.zenoh}']", place) for a in ("--set", one)]
        name = f"onboard-{len(self.daemons) + 1}"
        self.daemons.append(self._program(name, "onboard", "run", CODE / "configs" / "sitl.toml", *settings))
        return self.daemons[-1]

    def camera(self, blackout: tuple[float, float] | None = None) -> Program:
        """Run `simlink camera` between both vehicles.

        Images may be interrupted for an interval, s since the first one.
        """
        scenario = (CODE / "simlink" / "scenarios" / "sitl.toml").read_text(encoding="utf-8")
        if blackout is not None:
            gap = f"[camera]\nblackouts = [{{ start = {blackout[0]}, end = {blackout[1]} }}]"
            scenario = scenario.replace("[camera]", gap)
        path = self.folder / "camera.toml"
        path.write_text(scenario, encoding="utf-8")
        urls = "--follower", self.follower.for_camera, "--leader", self.leader.for_camera
        truth = "--truth", self.folder / "truth.csv.gz", "--zenoh", self.zenoh
        return self._program("camera", "simlink", "camera", path, *urls, *truth)

    def _program(self, name: str, *command: str | Path) -> Program:
        return self.stack.enter_context(started(self.folder / f"{name}.log", *command, cwd=self.folder))

    def take_off(self) -> None:
        """Let both climb. Raises AssertionError if they do not."""
        vehicles = self.follower, self.leader
        self._ask(
            lambda: all_climb(vehicles),
            lambda: all(v.is_up for v in vehicles),
            TAKEOFF_TIMEOUT_S,
            f"no take-off: {[v.texts[-5:] for v in vehicles]}",
        )

    def fly(self, course: Course) -> None:
        """Let the daemon lead the follower behind a leader on a course.

        Raises AssertionError if that does not begin.
        """
        hover = Command((0.0, 0.0, 0.0), course.heading)
        self.follower.hold()
        self.daemon().wait_for("link autopilot")
        outage = course.outage or (math.inf, math.inf)
        blackout = (SETTLING_TIME_S + outage[0], SETTLING_TIME_S + outage[1])
        camera = self.camera(blackout if course.kind is Kind.BLIND else None)
        self._ask(
            self.follower.hold, lambda: "first exposure" in camera.output(), ENTRY_TIMEOUT_S, "no image", hover
        )
        begin = time.monotonic()
        while time.monotonic() - begin < PREVIEW_TIME_S:
            self._command(hover)
        self._ask(
            self.follower.follow,
            lambda: self.follower.is_in_setpoint_mode,
            ENTRY_TIMEOUT_S,
            f"the mode was not entered: {self.follower.texts[-5:]}",
            hover,
        )
        self.entered = len(self.daemons[0].output())
        self.rows.clear()
        while time.monotonic() - begin < SETTLING_TIME_S:
            self._command(hover)
        commands, changes = list(course.commands()), list(outage) if course.kind is Kind.KILLED else []
        begin = time.monotonic()
        while (step := int((time.monotonic() - begin) / COMMAND_PERIOD_S)) < len(commands):
            if changes and time.monotonic() - begin > changes[0]:
                changes.pop(0)
                if changes:
                    self.daemons[-1].kill()
                else:
                    self.daemon()
            self._command(commands[step])

    def judge(self, course: Course) -> Verdict:
        """The flight since the mode was entered, by issue 71."""
        rows = self.rows
        slot_m = math.dist(SLOT, (0.0, 0.0, 0.0))
        distances = [row.distance for row in rows]
        errors = np.array([row.slot_error for row in rows])
        final = [row for row in rows if row.t > rows[-1].t - FINAL_TIME_S]
        late = float((np.diff([row.t for row in rows]) > MAX_ROW_INTERVAL_S).mean())
        stood = self.daemons[0].output()[self.entered :].count(STOOD_STILL)
        texts = " ".join(self.follower.texts)
        is_gone = course.kind is Kind.BLIND  # so a question about the detector is right
        false_words = tuple(w for w in FALSE_WORDS if w in texts and not (is_gone and w == FALSE_WORDS[-1]))
        min_allowed = (0.5 if course.comes_at_follower else 2.0 / 3.0) * slot_m
        in_view = float(np.mean([row.in_view for row in rows]))
        misses = {
            "too near": min(distances) < min_allowed,
            "not in place at the end": not all(row.is_in_place for row in final),
            "out of the image": in_view < MIN_VIEW_SHARE,
            "false words": bool(false_words),
        }
        return Verdict(
            min(distances),
            max(distances),
            min_allowed,
            float(np.sqrt(np.mean(errors**2))),
            float(np.median(errors)),
            rows[-1].distance,
            math.degrees(rows[-1].aside),
            float(np.mean([row.is_in_place for row in rows])),
            in_view,
            false_words,
            late,
            stood,
            late > MAX_LATE_RATIO or stood > 0,
            tuple(miss for miss, holds in misses.items() if holds),
        )

    def _ask(
        self,
        ask: Callable[[], object],
        is_done: Callable[[], bool],
        seconds: float,
        what: str,
        hover: Command | None = None,
    ) -> None:
        """Ask again and again until it is done, with the leader hovering.

        Raises AssertionError in the end.
        """
        begin, asked = time.monotonic(), -math.inf
        while not is_done():
            now = time.monotonic()
            assert now - begin < seconds, what
            if now - asked > ASK_PERIOD_S:
                asked = now
                ask()
            self._command(hover)

    def _command(self, command: Command | None) -> None:
        """Fly the leader until the next command is due, and note what is true."""
        end = time.monotonic() + COMMAND_PERIOD_S
        if command is not None:
            north, east, down = command.v_n
            self._height_m -= down * COMMAND_PERIOD_S
            down -= HEIGHT_GAIN * (self._height_m + float(self.leader.r_n[2]))
            self.leader.go((north, east, down), command.heading)
            self.rows.append(self._row(command.heading))
        while time.monotonic() < end:
            for vehicle in (self.follower, self.leader):
                vehicle.read()
            time.sleep(0.005)

    def _row(self, heading: float) -> Row:
        f, leader = self.follower, self.leader
        R = f.R_nb @ matrix_from_euler(0.0, math.radians(MOUNT_DEG), 0.0)
        x, y, z = (R.T @ (leader.r_n - f.r_n)).tolist()
        inside = x > 0.0 and abs(y / x) < HALF_PX[0] / F_PX and abs(z / x) < HALF_PX[1] / F_PX
        pitch = math.asin(-f.R_nb[2, 0])
        return Row(time.monotonic(), f.r_n, f.v_n, leader.r_n, leader.v_n, pitch, heading, inside)


def all_climb(vehicles: tuple[Vehicle, ...]) -> None:
    """Ask those to climb that have not."""
    for vehicle in vehicles:
        if not vehicle.is_up:
            vehicle.climb()


def add_text(texts: list[str], message: Any) -> None:
    """Add a STATUSTEXT, or its next part to the last one."""
    if message.chunk_seq and texts:
        texts[-1] += message.text
    else:
        texts.append(message.text)


@contextmanager
def field(folder: Path, make: Callable[[Path, int, Start], Vehicle], course: Course) -> Iterator[Field]:
    """Two vehicles that boot where a course begins. Nothing of them is left behind."""
    side = SIDES[course.side]
    starts = {
        FOLLOWER: Start(
            course.distance_m * math.cos(side),
            course.distance_m * math.sin(side),
            side + math.pi,
            LEADER_HEIGHT_M - SLOT[2],
        ),
        LEADER: Start(0.0, 0.0, course.heading, LEADER_HEIGHT_M),
    }
    with ExitStack() as stack:
        vehicles = []
        for name, system in (("follower", FOLLOWER), ("leader", LEADER)):
            vehicles.append(make(folder / name, system, starts[system]))
            stack.callback(vehicles[-1].end)
        yield Field(folder, *vehicles, stack=stack)
