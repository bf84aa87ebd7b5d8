"""MAVSDK's camera plugin finds the camera in which we track the leader, by our heartbeat and our
answers."""

import json
import os
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

from onboard.messages import Datagram, Encoding
from onboard.wire.datagrams import DatagramDecoder
from onboard.wire.mavlink.encode import MavlinkEncoder
from tests.support.emitted import LINK, NOW_TIME_NS, everything, sent
from tests.support.leader import AUTOPILOT, S
from tests.support.mavsdk_client import CONNECT, NEEDS_MAVSDK
from tests.support.programs import TIMEOUT_S, free_ports

pytestmark = NEEDS_MAVSDK
CLIENT = (
    CONNECT
    + """\
from mavsdk.plugins.camera import Camera

camera = Camera(system)
until(lambda: camera.camera_list().cameras)
found = []
for c in camera.camera_list().cameras:
    size = [c.horizontal_resolution_px, c.vertical_resolution_px]
    found.append([c.component_id, c.vendor_name, c.model_name, *size])
print("FOUND " + json.dumps(found), flush=True)
"""
)


def test_mavsdk_finds_the_camera_in_which_we_track(tmp_path: Path) -> None:
    (port,) = free_ports(socket.SOCK_DGRAM)
    out, autopilot, decoder = everything(), MavlinkEncoder(7, 1), DatagramDecoder()
    command = [sys.executable, "-c", CLIENT, f"udpin://127.0.0.1:{port}"]
    home = {**os.environ, "HOME": str(tmp_path), "XDG_CACHE_HOME": str(tmp_path)}  # it keeps the files it has read
    client = subprocess.Popen(command, env=home, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ours:
            ours.connect(("127.0.0.1", port))
            ours.settimeout(0.05)
            for k in range(round(TIMEOUT_S / 0.05)):
                for frame in (autopilot.encode(AUTOPILOT), *sent(out, NOW_TIME_NS + k * S // 20)):
                    exchange(ours, frame)
                for frame in answers(ours, out, decoder):
                    exchange(ours, frame)
                if client.poll() is not None:
                    break
        text, _ = client.communicate(timeout=TIMEOUT_S)
    finally:
        client.kill()
        client.wait()
    found: list[Any] = json.loads(text.split("FOUND ")[1].splitlines()[0])
    assert found == [[100, "wingline", "front", 640, 480]], text


def exchange(ours: socket.socket, frame: bytes) -> None:
    try:
        ours.send(frame)
    except ConnectionRefusedError:  # it does not listen yet
        return


def answers(ours: socket.socket, out: Any, decoder: DatagramDecoder) -> list[bytes]:
    """Frames that answer what comes next, if anything comes."""
    try:
        data = ours.recv(65_536)
    except (TimeoutError, ConnectionRefusedError):
        return []
    received = Datagram(channel=LINK, encoding=Encoding.MAVLINK, t_recv_ns=NOW_TIME_NS, data=data)
    frames: list[bytes] = out.respond(LINK, decoder.decode(received), NOW_TIME_NS).frames
    return frames
