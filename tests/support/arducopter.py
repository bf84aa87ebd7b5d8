"""Two real ArduCopters in their own simulator: the leader is flown by velocities, the follower by FOLLOW mode."""

import math
import os
import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from pymavlink import mavutil

from onboard.arrays import Array
from onboard.geometry.geodesy import ned_from_geodetic
from onboard.geometry.rotations import matrix_from_euler
from tests.support.programs import ROOT, Program, free_ports, started

BINARY: Final = os.environ.get("ARDUCOPTER", "")
HOME: Final = (47.3977, 8.5456, 488.0)
SLOT: Final = (-30.0, 0.0, 3.0)  # FOLL_OFS_* of configs/ardupilot-follow.parm
MOUNT_DEG, F_PX, HALF_PX = 15.0, 554.256, (320.0, 240.0)  # configs/sitl.toml
FOLLOWER, LEADER = 1, 2  # MAVLink systems
GUIDED, FOLLOW = 4, 23
BOOT_S: Final = 60.0  # until it is heard
READY_S: Final = 120.0  # until the filters know where they are, and both have climbed
MOVES: Final = 2.0  # m/s: faster, the leader's velocity shows its course
VELOCITY_AND_YAW: Final = 0b0000_1001_1100_0111  # the fields of SET_POSITION_TARGET that are ignored
M: Final = mavutil.mavlink
COPTER: Final = """
FRAME_CLASS 1
FRAME_TYPE 0
FS_THR_ENABLE 0
FS_GCS_ENABLE 0
LOG_BACKEND_TYPE 0
"""

Velocity = tuple[float, float, float]


class Copter:
    """One ArduCopter, its process and a connection that flies it. `ports`: of its serial ports 1 and 2."""

    def __init__(self, folder: Path, system: int, ahead_m: float) -> None:
        folder.mkdir()
        (base,) = free_ports(socket.SOCK_STREAM)
        self.system, self.ports = system, (base + 2, base + 3)
        self.truth: dict[str, float] = {}  # SIM_STATE
        self.texts: list[str] = []
        self._asked = 0.0
        with (folder / "out.txt").open("wb") as out:
            self.popen = subprocess.Popen(
                _command(folder, system, ahead_m, base),
                cwd=folder,
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        try:
            self._link = self._connected(base)
        except OSError:
            self.popen.kill()
            raise

    def _connected(self, port: int) -> Any:
        end = time.monotonic() + BOOT_S
        while True:
            try:
                return mavutil.mavlink_connection(f"tcp:127.0.0.1:{port}", source_system=255, retries=0)
            except OSError:
                if time.monotonic() > end or self.popen.poll() is not None:
                    raise
                time.sleep(0.2)

    def read(self) -> None:
        """Take what has come, and ask for the truth again and again."""
        while (m := self._link.recv_match(blocking=False)) is not None:
            if m.get_type() == "SIM_STATE":
                self.truth = m.to_dict()
            elif m.get_type() == "STATUSTEXT":
                self.texts.append(m.text)
        if time.monotonic() - self._asked > 2.0:
            self._asked = time.monotonic()
            self._link.mav.heartbeat_send(M.MAV_TYPE_GCS, M.MAV_AUTOPILOT_INVALID, 0, 0, 0)
            self.command(M.MAV_CMD_SET_MESSAGE_INTERVAL, M.MAVLINK_MSG_ID_SIM_STATE, 50_000)

    def command(self, number: int, *params: float) -> None:
        """Send a command."""
        self._link.mav.command_long_send(self.system, 1, number, 0, *params, *[0.0] * (7 - len(params)))

    def set_mode(self, mode: int) -> None:
        """Ask for a flight mode."""
        self.command(M.MAV_CMD_DO_SET_MODE, 1, mode)

    def go(self, v_n: Velocity, yaw: float) -> None:
        """Fly with this velocity (m/s, NED) and heading (rad) from now on."""
        frame, zero = M.MAV_FRAME_LOCAL_NED, (0.0, 0.0, 0.0)
        fields = (frame, VELOCITY_AND_YAW, *zero, *v_n, *zero, yaw, 0.0)
        self._link.mav.set_position_target_local_ned_send(0, self.system, 1, *fields)

    @property
    def r_n(self) -> Array:
        """The true position in n of HOME."""
        t = self.truth
        return ned_from_geodetic((t["lat_int"] * 1e-7, t["lon_int"] * 1e-7, t["alt"]), HOME)

    @property
    def v_n(self) -> Array:
        """The true velocity in n."""
        return np.array([self.truth["vn"], self.truth["ve"], self.truth["vd"]])

    def end(self) -> None:
        """End the process."""
        self._link.close()
        self.popen.kill()
        self.popen.wait(BOOT_S)


def _command(folder: Path, system: int, ahead_m: float, base: int) -> list[str]:
    """The command line of one ArduCopter, with the parameters of the guide if it is the follower."""
    shipped = Path(BINARY).resolve().parents[3] / "Tools" / "autotest" / "default_params" / "copter.parm"
    parameters = (shipped.read_text() if shipped.exists() else "") + COPTER
    if system == FOLLOWER:
        parameters += (ROOT / "configs" / "ardupilot-follow.parm").read_text(encoding="utf-8")
    (folder / "copter.parm").write_text(parameters, encoding="utf-8")
    lat = HOME[0] + math.degrees(ahead_m / 6_378_137.0)
    numbers = [f"--base-port={base}", f"-I{system}", f"--rc-in-port={base + 5}", f"--irlock-port={base + 6}"]
    where = [f"--home={lat},{HOME[1]},{HOME[2]},0", "--sysid", str(system)]
    return [BINARY, "--model", "+", "--speedup", "1", "--wipe", "--defaults", "copter.parm", *numbers, *where]


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
    """Both copters, and the camera and the daemon on them. `rows`: ten a second while the leader flies."""

    def __init__(self, folder: Path, follower: Copter, leader: Copter, stack: ExitStack) -> None:
        self.follower, self.leader = follower, leader
        self.rows: list[Row] = []
        self._folder, self._stack, self._count = folder, stack, 0
        (zenoh,) = free_ports(socket.SOCK_STREAM)
        self._zenoh = f"tcp/127.0.0.1:{zenoh}"

    def daemon(self) -> Program:
        """`onboard run` on configs/sitl.toml, as it ships."""
        link = f"link=[{{name='autopilot', url='tcp:127.0.0.1:{self.follower.ports[0]}'}}]"
        settings = [a for one in (link, f"zenoh.listen=['{self._zenoh}']") for a in ("--set", one)]
        return self._program("onboard", "run", ROOT / "configs" / "sitl.toml", *settings)

    def camera(self) -> Program:
        """`simlink camera` between both."""
        urls = [f"tcp:127.0.0.1:{copter.ports[1]}" for copter in (self.follower, self.leader)]
        to = ("--follower", urls[0], "--leader", urls[1], "--zenoh", self._zenoh)
        return self._program("simlink", "camera", *to)

    def _program(self, *command: str | Path) -> Program:
        self._count += 1
        return self._stack.enter_context(started(self._folder / f"{command[0]}-{self._count}.log", *command))

    def take_off(self, height: float) -> None:
        """Let both climb. Raises AssertionError if they do not."""
        copters, begin, asked = (self.follower, self.leader), time.monotonic(), 0.0
        while not all(c.truth and -c.r_n[2] > height - 1.0 for c in copters):
            now = time.monotonic()
            assert now - begin < READY_S, f"no take-off: {[c.texts[-5:] for c in copters]}"
            if now - asked > 3.0:
                asked = now
                for c in copters:
                    c.set_mode(GUIDED)
                    c.command(M.MAV_CMD_COMPONENT_ARM_DISARM, 1)
                    if c.truth and -c.r_n[2] < 1.0:
                        c.command(M.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, height)
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

    def since(self, t: float) -> list[Row]:
        """The rows since a time of the monotonic clock."""
        return [row for row in self.rows if row.t >= t]

    def _turn(self) -> None:
        for copter in (self.follower, self.leader):
            copter.read()
        time.sleep(0.01)

    def _row(self, heading: float) -> Row:
        f, leader = self.follower, self.leader
        roll, pitch, yaw = (f.truth[name] for name in ("roll", "pitch", "yaw"))
        R = matrix_from_euler(roll, pitch, yaw) @ matrix_from_euler(0.0, math.radians(MOUNT_DEG), 0.0)
        x, y, z = (R.T @ (leader.r_n - f.r_n)).tolist()
        inside = x > 0.0 and abs(y / x) < HALF_PX[0] / F_PX and abs(z / x) < HALF_PX[1] / F_PX
        return Row(time.monotonic(), f.r_n, f.v_n, leader.r_n, leader.v_n, pitch, heading, inside)


@contextmanager
def field(folder: Path) -> Iterator[Field]:
    """Two copters that boot, 33 m apart. Nothing of them is left behind."""
    with ExitStack() as stack:
        copters = []
        for name, system, ahead_m in (("follower", FOLLOWER, 0.0), ("leader", LEADER, 33.0)):
            copters.append(Copter(folder / name, system, ahead_m))
            stack.callback(copters[-1].end)
        yield Field(folder, *copters, stack=stack)
