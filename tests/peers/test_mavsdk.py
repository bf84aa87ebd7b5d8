"""simlink as MAVSDK sees it: an independent client, in a process of its own since its core is native code."""

import json
import math
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.mavsdk_client import CONNECT, NEEDS_MAVSDK
from tests.support.programs import TIMEOUT_S, free_ports, started

pytestmark = NEEDS_MAVSDK

CLIENT = (
    CONNECT
    + """\
import math
from mavsdk.plugins.telemetry import Telemetry

telemetry = Telemetry(system)
telemetry.set_rate_position(20.0)  # SET_MESSAGE_INTERVAL; raises when it is refused


def look():
    q, p, v = telemetry.attitude_quaternion(), telemetry.position(), telemetry.position_velocity_ned()
    return {
        "q": [q.w, q.x, q.y, q.z],
        "position": [p.latitude_deg, p.longitude_deg, p.relative_altitude_m],
        "ned": [v.position.north_m, v.position.east_m, v.position.down_m],
        "velocity": [v.velocity.north_m_s, v.velocity.east_m_s, v.velocity.down_m_s],
        "armed": bool(telemetry.armed()),
    }


def is_known(seen):
    numbers = seen["q"] + seen["position"] + seen["ned"] + seen["velocity"]
    received = any(seen["ned"]) and any(seen["velocity"]) and seen["armed"]
    return all(x == x for x in numbers) and received


until(lambda: is_known(look()), 200.0)
first = look()
until(lambda: math.dist(first["ned"], look()["ned"]) > 10.0)
print(json.dumps([first, look()]), flush=True)
telemetry.destroy()
mavsdk.destroy()
"""
)
ORIGIN = (47.397742, 8.545594)


def test_mavsdk_sees_the_vehicle_of_formation_seed_1(tmp_path: Path) -> None:
    (port,) = free_ports(socket.SOCK_DGRAM)
    command = [
        "simlink",
        "run",
        "formation",
        "--seed",
        "1",
        "--tcp",
        "none",
        "--zenoh",
        "none",
        "--camera",
        "none",
    ]
    with started(tmp_path / "simlink.log", *command, "--mavlink", f"udpout:127.0.0.1:{port}"):
        done = subprocess.run(
            [sys.executable, "-c", CLIENT, f"udpin://127.0.0.1:{port}"],
            capture_output=True,
            text=True,
            timeout=TIMEOUT_S,
            check=False,
        )
    assert done.returncode == 0, done.stdout + done.stderr
    first, second = json.loads(next(line for line in done.stdout.splitlines() if line.startswith("[{")))
    for seen in (first, second):
        assert seen["armed"] is True
        assert math.hypot(*seen["q"]) == pytest.approx(1.0, abs=1e-3)
        north, east, down = seen["ned"]
        # the small-angle formulas on a sphere, against two messages that say the same in different ways
        lat, lon, height = seen["position"]
        radius = 6_378_137.0
        assert math.radians(lat - ORIGIN[0]) * radius == pytest.approx(
            north, abs=0.02 * math.hypot(north, east) + 5
        )
        assert math.radians(lon - ORIGIN[1]) * radius * math.cos(math.radians(lat)) == pytest.approx(
            east, abs=0.02 * math.hypot(north, east) + 5
        )
        assert height == pytest.approx(-down, abs=2.0)
        assert 15 < math.hypot(*seen["velocity"]) < 30  # 70 ft/s, in a turn
    moved = math.dist(first["ned"], second["ned"])
    assert 10 < moved < 200
    # nose along the course: a fixed wing in a coordinated turn
    w, x, y, z = second["q"]
    heading = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    course = math.atan2(second["velocity"][1], second["velocity"][0])
    assert abs(math.remainder(heading - course, 2 * math.pi)) < math.radians(15)
