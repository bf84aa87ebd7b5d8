"""A real PX4 with simulation in hardware, as a vehicle of `formation_flown`."""

import math
import os
import subprocess
import time
from pathlib import Path
from typing import Any, Final

import numpy as np
from pymavlink import mavutil

from onboard.arrays import Array
from onboard.geometry.geodesy import ned_from_geodetic
from onboard.geometry.rotations import matrix_from_quaternion
from tests.support.formation_flown import (
    EARTH_RADIUS_M,
    FOLLOWER,
    HOME,
    SILENCE_TIMEOUT_S,
    Start,
    Velocity,
    add_text,
)
from tests.support.programs import CODE

BINARY: Final = os.environ.get("PX4", "")
OFFBOARD_MODE: Final = 6  # main mode
VELOCITY_AND_YAW: Final = 0b0000_1001_1100_0111  # the fields of SET_POSITION_TARGET that are ignored
M: Final = mavutil.mavlink
# Without a remote control, a battery or a card; and with the drag of a real vehicle (docs/px4.md).
PARAMETERS: Final = {
    "NAV_RCL_ACT": 0,
    "NAV_DLL_ACT": 0,
    "COM_RCL_EXCEPT": 7,
    "SDLOG_MODE": -1,
    "COM_DISARM_PRFLT": -1,
    "CBRK_SUPPLY_CHK": 894281,
    "SIM_BAT_MIN_PCT": 90,
    "SIH_KDV": 0.2,
}


class Px4:
    """One PX4, its process and a connection that flies it.

    Its ports follow from its number: so only one pair flies on a computer.
    """

    def __init__(self, folder: Path, system: int, start: Start) -> None:
        folder.mkdir()
        self._number, self._folder, self._start = system, folder, start
        self.system = system + 1  # as MAVLink has it
        self.for_daemon = f"udpin:127.0.0.1:{14540 + system}"
        self.for_camera = f"udpin:127.0.0.1:{14600 + system}"
        self.texts: list[str] = []
        self._truth: Any = None  # HIL_STATE_QUATERNION
        self._is_armed = self._has_more = self.is_in_setpoint_mode = False
        self._asked = self._heard = 0.0
        self._build = Path(BINARY).resolve().parents[1]
        self._environment = _environment(system, start)
        command = [BINARY, "-i", str(system), "-d", "-w", str(folder), str(self._build / "etc")]
        with (folder / "out.txt").open("wb") as out:
            self.popen = subprocess.Popen(
                command,
                cwd=folder,
                env=self._environment,
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        self._link = mavutil.mavlink_connection(f"udpout:127.0.0.1:{18570 + system}", source_system=255)

    def read(self) -> None:
        """Take what has come, and ask for the truth again and again.

        Raises AssertionError if it falls silent.
        """
        while (m := self._link.recv_match(blocking=False)) is not None:
            if m.get_type() == "HIL_STATE_QUATERNION":
                self._truth, self._heard = m, time.monotonic()
            elif m.get_type() == "STATUSTEXT":
                add_text(self.texts, m)
            elif m.get_type() == "HEARTBEAT" and m.get_srcComponent() == 1:
                self._is_armed = bool(m.base_mode & M.MAV_MODE_FLAG_SAFETY_ARMED)
                self.is_in_setpoint_mode = m.custom_mode >> 16 & 0xFF == OFFBOARD_MODE
        assert not self._heard or time.monotonic() - self._heard < SILENCE_TIMEOUT_S, "the autopilot fell silent"
        if time.monotonic() - self._asked > 1.0:
            self._asked = time.monotonic()
            self._link.mav.heartbeat_send(M.MAV_TYPE_GCS, M.MAV_AUTOPILOT_INVALID, 0, 0, 0)
            self.command(M.MAV_CMD_SET_MESSAGE_INTERVAL, M.MAVLINK_MSG_ID_HIL_STATE_QUATERNION, 50_000)

    def command(self, number: int, *params: float) -> None:
        """Send a command."""
        self._link.mav.command_long_send(self.system, 1, number, 0, *params, *[0.0] * (7 - len(params)))

    def climb(self) -> None:
        """Ask it to arm and to climb; and start, once, the link that the camera needs."""
        if self._truth is not None and not self._has_more:
            self._has_more = True
            ports = "-u", str(14590 + self._number), "-o", str(14600 + self._number)
            start = "start", "-x", *ports, "-m", "onboard", "-r", "4000000"
            subprocess.run(
                [str(self._build / "bin" / "px4-mavlink"), "--instance", str(self._number), *start],
                cwd=self._folder,
                env=self._environment,
                capture_output=True,
                check=True,
                timeout=20.0,
            )
        if self._truth is not None and -float(self.r_n[2]) < 1.0:
            self.command(M.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, *[math.nan] * 4)
            self.command(M.MAV_CMD_COMPONENT_ARM_DISARM, 1)

    def hold(self) -> None:
        """Ask for Hold, with the heading of its start: PX4 boots looking north."""
        self.command(M.MAV_CMD_DO_REPOSITION, -1, 1, 0, math.remainder(self._start.yaw, math.tau), *[math.nan] * 3)

    def follow(self) -> None:
        """Ask for OFFBOARD, which needs setpoints."""
        self.command(M.MAV_CMD_DO_SET_MODE, 1, OFFBOARD_MODE)

    def go(self, v_n: Velocity, yaw: float) -> None:
        """Fly with this velocity (m/s, NED) and heading (rad) from now on, and enter OFFBOARD."""
        frame, zero = M.MAV_FRAME_LOCAL_NED, (0.0, 0.0, 0.0)
        fields = (frame, VELOCITY_AND_YAW, *zero, *v_n, *zero, yaw, 0.0)
        self._link.mav.set_position_target_local_ned_send(0, self.system, 1, *fields)
        if not self.is_in_setpoint_mode:
            self.follow()

    @property
    def is_up(self) -> bool:
        """Whether it has climbed."""
        return self._truth is not None and self._is_armed and -float(self.r_n[2]) > self._start.height_m - 0.8

    @property
    def r_n(self) -> Array:
        """The true position in n of HOME."""
        t = self._truth
        return ned_from_geodetic((t.lat * 1e-7, t.lon * 1e-7, t.alt * 1e-3), HOME)

    @property
    def v_n(self) -> Array:
        """The true velocity in n."""
        return 0.01 * np.array([self._truth.vx, self._truth.vy, self._truth.vz])

    @property
    def R_nb(self) -> Array:
        """The true attitude."""
        return matrix_from_quaternion(np.array(self._truth.attitude_quaternion))

    def end(self) -> None:
        """End the process."""
        self._link.close()
        self.popen.kill()
        self.popen.wait(10.0)
        for left in (f"/tmp/px4_lock-{self._number}", f"/tmp/px4-sock-{self._number}"):  # noqa: S108 - its own names
            Path(left).unlink(missing_ok=True)


def _environment(system: int, start: Start) -> dict[str, str]:
    """Return the environment of one PX4: vehicle, position, and parameters, the guide's for a follower."""
    parameters: dict[str, Any] = PARAMETERS | {"MIS_TAKEOFF_ALT": start.height_m}
    if system == FOLLOWER:
        lines = (CODE / "configs" / "px4-follow.params").read_text(encoding="utf-8").splitlines()
        parameters |= {row[2]: row[3] for row in (line.split("\t") for line in lines if line[:1] != "#" and line)}
    east = start.east_m / EARTH_RADIUS_M / math.cos(math.radians(HOME[0]))
    place = {
        "PX4_SIM_MODEL": "sihsim_quadx",
        "PX4_HOME_LAT": f"{HOME[0] + math.degrees(start.north_m / EARTH_RADIUS_M):.7f}",
        "PX4_HOME_LON": f"{HOME[1] + math.degrees(east):.7f}",
        "PX4_HOME_ALT": f"{HOME[2]:.1f}",
    }
    return os.environ | place | {f"PX4_PARAM_{name}": str(value) for name, value in parameters.items()}
