"""All that we send, as node-mavlink decodes it: its signatures too, and those that it makes.

Needs npm, which installs node-mavlink into the virtual environment, and is skipped without."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from onboard.messages import Datagram, Encoding, Ping
from onboard.wire.datagrams import DatagramDecoder
from tests.support.emitted import ANSWERS, LINK, NOW_TIME_NS, ON_REQUEST, STREAMS, answered, everything, sent
from tests.support.programs import TIMEOUT_S

CLIENT = Path(__file__).with_name("node_mavlink.cjs")
PACKAGE = "node-mavlink@2.3.0"
KEY = bytes(range(32))

pytestmark = pytest.mark.skipif(
    shutil.which("npm") is None or shutil.which("node") is None, reason="npm and node are not installed"
)


@pytest.fixture(scope="module")
def modules() -> Path:
    """The folder with node-mavlink: that of WINGLINE_NODE_MODULES, or one in the virtual environment, which npm
    fills once."""
    if given := os.environ.get("WINGLINE_NODE_MODULES"):
        return Path(given)
    folder = Path(sys.prefix) / PACKAGE
    if (folder / "installed").exists():
        return folder / "node_modules"
    folder.mkdir(exist_ok=True)
    (folder / "package.json").write_text("{}")
    command = ["npm", "install", "--no-audit", "--no-fund", "--ignore-scripts", "--prefix", str(folder), PACKAGE]
    done = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT_S, check=False)
    if done.returncode != 0:
        pytest.skip(f"npm cannot install {PACKAGE}: {done.stderr.strip().splitlines()[-1:]}")
    (folder / "installed").touch()
    return folder / "node_modules"


def decoded(modules: Path, frames: list[bytes]) -> dict[str, Any]:
    """What node-mavlink finds in the frames, and a signed frame of its own."""
    command = ["node", str(CLIENT), str(modules), KEY.hex()]
    data = b"".join(frames)
    done = subprocess.run(command, input=data, capture_output=True, timeout=TIMEOUT_S, check=True)
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


def test_node_mavlink_decodes_all_that_we_send_and_each_end_trusts_the_others_signatures(modules: Path) -> None:
    out = everything({LINK: KEY})
    out.notices.add(4, "text")
    frames = [*sent(out), *answered(out)]
    result = decoded(modules, [*frames, *(out.signed(LINK, frame, NOW_TIME_NS) for frame in frames)])
    found = result["found"]
    names = {f["name"] for f in found}
    assert names == STREAMS | ON_REQUEST | ANSWERS
    half = len(found) // 2
    assert [f["name"] for f in found[:half]] == [f["name"] for f in found[half:]]
    assert {(f["signed"], f["forged"]) for f in found[:half]} == {(None, None)}
    assert {(f["signed"], f["forged"]) for f in found[half:]} == {(True, False)}
    by_name = {f["name"]: f for f in found}
    assert {n: (by_name[n]["system"], by_name[n]["component"]) for n in ("FOLLOW_TARGET", "TARGET_RELATIVE")} == {
        "FOLLOW_TARGET": (99, 191),
        "TARGET_RELATIVE": (7, 191),
    }
    relative, follow = by_name["TARGET_RELATIVE"]["fields"], by_name["FOLLOW_TARGET"]["fields"]
    assert (relative["x"], relative["y"], relative["z"]) == pytest.approx((30.0, 4.0, 2.0), abs=0.5)
    assert (relative["frame"], relative["type"]) == (2, 3)
    assert follow["estCapabilities"] == 7  # no attitude: its course is not known yet
    computer, camera = by_name["ONBOARD_COMPUTER_STATUS"]["fields"], by_name["CAMERA_INFORMATION"]
    assert (computer["cpuCores"], computer["ramTotal"]) == ([12, 100, *[255] * 6], 4096)
    assert (camera["component"], camera["fields"]["resolutionH"]) == (100, 640)
    assert by_name["PARAM_EXT_ACK"]["fields"]["paramId"] == "CAM_SIGMA_PX"


def test_a_frame_that_node_mavlink_signed_enters_once(modules: Path) -> None:
    signed = bytes.fromhex(decoded(modules, [])["signed"])
    stamp = int.from_bytes(signed[-12:-6], "little")
    t_ns = 1_420_070_400 * 10**9 + stamp * 10_000
    received = Datagram(channel=LINK, encoding=Encoding.MAVLINK, t_recv_ns=t_ns, data=signed)
    decoder = DatagramDecoder(keys={LINK: KEY})
    (ping,) = decoder.decode(received)
    assert isinstance(ping, Ping)
    assert (ping.time_us, ping.number, ping.system) == (7, 5, 255)
    assert decoder.decode(received) == []
    assert decoder.rejected["replayed"] == 1
    assert DatagramDecoder(keys={LINK: KEY[::-1]}).decode(received) == []
