"""What we send of the leader, as MAVSDK decodes it: an independent codec, in a process of its own."""

import json
import socket
import subprocess
import sys
from typing import Any

import pytest

from onboard.autopilot.leader_messages import CameraView
from onboard.autopilot.leader_output import LeaderOutput
from onboard.config import LeaderOutConfig
from onboard.geometry.camera import make_camera
from onboard.wire.mavlink.encode import MavlinkEncoder
from tests.support.leader import AUTOPILOT, S, leader_state
from tests.support.mavsdk_client import LISTEN, NEEDS_MAVSDK
from tests.support.programs import TIMEOUT_S, free_ports
from tests.support.vehicle_records import EAST

pytestmark = NEEDS_MAVSDK

NAMES = (
    "FOLLOW_TARGET",
    "GLOBAL_POSITION_INT",
    "LANDING_TARGET",
    "ADSB_VEHICLE",
    "CAMERA_TRACKING_IMAGE_STATUS",
    "CAMERA_TRACKING_GEO_STATUS",
    "TARGET_RELATIVE",
)
CLIENT = (
    LISTEN
    + """\
import threading
from mavsdk.plugins.mavlink_direct import MavlinkDirect

names = sys.argv[2:]
xml = '''<mavlink><messages><message id="511" name="TARGET_RELATIVE"><description>From us</description>
<field type="uint64_t" name="timestamp">t</field><field type="uint8_t" name="id">i</field>
<field type="uint8_t" name="frame">f</field><field type="float" name="x">x</field>
<field type="float" name="y">y</field><field type="float" name="z">z</field>
<field type="float[3]" name="pos_std">s</field><field type="float" name="yaw_std">y</field>
<field type="float[4]" name="q_target">q</field><field type="float[4]" name="q_sensor">q</field>
<field type="uint8_t" name="type">t</field></message></messages></mavlink>'''
found, done, direct = {}, threading.Event(), []


def take(message, _):
    if message.message_name in names and message.message_name not in found:
        found[message.message_name] = [message.system_id, message.component_id, json.loads(message.fields_json)]
    if len(found) == len(names):
        done.set()


until(lambda: len(mavsdk.get_systems()) >= 2)
for system in mavsdk.get_systems():
    plugin = MavlinkDirect(system)
    plugin.load_custom_xml(xml)
    plugin.subscribe_message("", take)
    direct.append(plugin)
done.wait(60)
print("FOUND " + json.dumps(found), flush=True)
"""
)


def test_mavsdk_decodes_everything_that_we_send_of_the_leader() -> None:
    (port,) = free_ports(socket.SOCK_DGRAM)
    config = LeaderOutConfig(link="a", system=99, rates_hz=dict.fromkeys(NAMES, 20.0))
    out, autopilot = LeaderOutput(config, 7, 191), MavlinkEncoder(7, 1)
    view = CameraView(EAST, make_camera(f_px=500.0, width_px=640.0, height_px=480.0), is_px4=False)
    client = subprocess.Popen(
        [sys.executable, "-c", CLIENT, f"udpin://127.0.0.1:{port}", *NAMES],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ours:
            for k in range(round(TIMEOUT_S / 0.05)):
                now_ns = 1_800_000_000 * S + k * S // 20
                for frame in (
                    autopilot.encode(AUTOPILOT),
                    *out.frames(leader_state(), leader_state(), view, now_ns),
                ):
                    ours.sendto(frame, ("127.0.0.1", port))
                try:
                    client.wait(0.05)
                    break
                except subprocess.TimeoutExpired:
                    continue
        text, _ = client.communicate(timeout=TIMEOUT_S)
    finally:
        client.kill()
        client.wait()
    found: dict[str, Any] = json.loads(text.split("FOUND ")[1].splitlines()[0])
    assert set(found) == set(NAMES), text
    assert {name: found[name][0] for name in NAMES} == {
        name: 99 if name in {"FOLLOW_TARGET", "GLOBAL_POSITION_INT"} else 7 for name in NAMES
    }
    follow = found["FOLLOW_TARGET"][2]
    assert (follow["lat"], follow["lon"], follow["alt"]) == (474_000_000, -85_000_000, 538.0)
    assert (follow["est_capabilities"], follow["vel"]) == (15, [0.0, 8.0, -1.0])
    relative = found["TARGET_RELATIVE"][2]
    assert (relative["x"], relative["y"], relative["z"]) == (30.0, 4.0, 2.0)
    assert (relative["pos_std"], relative["frame"], relative["type"]) == ([1.5, 2.5, 0.5], 2, 3)
    landing = found["LANDING_TARGET"][2]
    assert (landing["x"], landing["y"], landing["position_valid"]) == (pytest.approx(4.0), pytest.approx(-30.0), 1)
