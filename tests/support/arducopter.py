"""A real ArduCopter in its own simulator, as a vehicle of `formation_flown`."""

import math
import os
import socket
import subprocess
import time
from pathlib import Path
from typing import Any, Final

import numpy as np
from pymavlink import mavutil

from onboard.arrays import Array
from onboard.geometry.geodesy import ned_from_geodetic
from onboard.geometry.rotations import matrix_from_euler
from tests.support.formation_flown import (
    EARTH_RADIUS_M,
    FOLLOWER,
    HOME,
    SILENCE_TIMEOUT_S,
    Start,
    Velocity,
    add_text,
)
from tests.support.programs import CODE, free_ports

BINARY: Final = os.environ.get("ARDUCOPTER", "")
GUIDED, LOITER = 4, 5
BOOT_TIMEOUT_S: Final = 60.0
BOOT_SPEEDUP_FACTOR: Final = 5  # of the simulation, until it has climbed
CENTERED: Final = [1500] * 4 + [65_535] * 4  # sticks, us; unused channels
VELOCITY_AND_YAW: Final = 0b0000_1001_1100_0111  # the fields of SET_POSITION_TARGET that are ignored
M: Final = mavutil.mavlink
COPTER: Final = """
FRAME_CLASS 1
FRAME_TYPE 0
FS_THR_ENABLE 0
FS_GCS_ENABLE 0
LOG_BACKEND_TYPE 0
"""


class Copter:
    """One ArduCopter, its process and a connection that flies it."""

    def __init__(self, folder: Path, system: int, start: Start) -> None:
        folder.mkdir()
        self._height = start.height_m
        (base,) = free_ports(socket.SOCK_STREAM)
        self.system = system
        self.for_daemon, self.for_camera = (f"tcp:127.0.0.1:{base + port}" for port in (2, 3))
        self.truth: dict[str, float] = {}  # SIM_STATE
        self.texts: list[str] = []
        self._asked = self._heard = 0.0
        self.is_up = self.is_in_setpoint_mode = False
        with (folder / "out.txt").open("wb") as out:
            self.popen = subprocess.Popen(
                _command(folder, system, start, base),
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
        end = time.monotonic() + BOOT_TIMEOUT_S
        while True:
            try:
                return mavutil.mavlink_connection(f"tcp:127.0.0.1:{port}", source_system=255, retries=0)
            except OSError:
                if time.monotonic() > end or self.popen.poll() is not None:
                    raise
                time.sleep(0.2)

    def read(self) -> None:
        """Take what has come, and ask for the truth again and again.

        Raises AssertionError if it falls silent.
        """
        while (m := self._link.recv_match(blocking=False)) is not None:
            if m.get_type() == "SIM_STATE":
                self.truth, self._heard = m.to_dict(), time.monotonic()
                self._check_height()
            elif m.get_type() == "STATUSTEXT":
                add_text(self.texts, m)
            elif m.get_type() == "HEARTBEAT" and m.get_srcComponent() == 1:
                self.is_in_setpoint_mode = m.custom_mode == GUIDED
        assert not self._heard or time.monotonic() - self._heard < SILENCE_TIMEOUT_S, "the autopilot fell silent"
        if time.monotonic() - self._asked > 1.0:
            self._asked = time.monotonic()
            self._link.mav.heartbeat_send(M.MAV_TYPE_GCS, M.MAV_AUTOPILOT_INVALID, 0, 0, 0)
            if self.is_up:
                self._link.mav.rc_channels_override_send(self.system, 1, *CENTERED)
            self.command(M.MAV_CMD_SET_MESSAGE_INTERVAL, M.MAVLINK_MSG_ID_SIM_STATE, 50_000)

    def command(self, number: int, *params: float) -> None:
        """Send a command."""
        self._link.mav.command_long_send(self.system, 1, number, 0, *params, *[0.0] * (7 - len(params)))

    def hold(self) -> None:
        """Ask for LOITER, with centered sticks."""
        self._link.mav.rc_channels_override_send(self.system, 1, *CENTERED)
        self.command(M.MAV_CMD_DO_SET_MODE, 1, LOITER)

    def follow(self) -> None:
        """Ask for GUIDED."""
        self.command(M.MAV_CMD_DO_SET_MODE, 1, GUIDED)

    def climb(self) -> None:
        """Ask it to arm and to climb."""
        self.follow()
        self.command(M.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        if self.truth and -self.r_n[2] < 1.0:
            self.command(M.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, self._height)

    def _check_height(self) -> None:
        """Fly in real time once it has climbed."""
        if not self.is_up and -float(self.r_n[2]) > self._height - 0.5:
            self.is_up = True
            self._link.mav.param_set_send(self.system, 1, b"SIM_SPEEDUP", 1.0, M.MAV_PARAM_TYPE_REAL32)

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

    @property
    def R_nb(self) -> Array:
        """The true attitude."""
        return matrix_from_euler(*(self.truth[name] for name in ("roll", "pitch", "yaw")))

    def end(self) -> None:
        """End the process."""
        self._link.close()
        self.popen.kill()
        self.popen.wait(BOOT_TIMEOUT_S)


def _command(folder: Path, system: int, start: Start, base: int) -> list[str]:
    """Return the command line of one ArduCopter, with the guide's parameters for the follower."""
    shipped = Path(BINARY).resolve().parents[3] / "Tools" / "autotest" / "default_params" / "copter.parm"
    parameters = (shipped.read_text() if shipped.exists() else "") + COPTER
    if system == FOLLOWER:
        parameters += (CODE / "configs" / "ardupilot-follow.parm").read_text(encoding="utf-8")
    (folder / "copter.parm").write_text(parameters, encoding="utf-8")
    lat = HOME[0] + math.degrees(start.north_m / EARTH_RADIUS_M)
    lon = HOME[1] + math.degrees(start.east_m / EARTH_RADIUS_M / math.cos(math.radians(HOME[0])))
    numbers = [f"--base-port={base}", f"-I{system}", f"--rc-in-port={base + 5}", f"--irlock-port={base + 6}"]
    where = [f"--home={lat},{lon},{HOME[2]},{math.degrees(start.yaw) % 360.0}", "--sysid", str(system)]
    model = ["--model", "+", "--speedup", str(BOOT_SPEEDUP_FACTOR), "--wipe", "--defaults", "copter.parm"]
    return [BINARY, *model, *numbers, *where]
