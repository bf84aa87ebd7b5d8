"""`onboard run` with `simlink run traffic`, each a process.

Reports arrive over UDP and echoes over Zenoh; tracks leave over Zenoh, and as MAVLink to a ground station on its
own link.
"""

import socket
import time
from pathlib import Path
from typing import Any

import msgspec
import zenoh
from pymavlink.dialects.v20 import common

from onboard.messages import Estimate, Health
from onboard.view.client import Client
from simlink.scenarios.describe import daemon_config
from simlink.scenarios.scenario import load_scenario
from tests.support.programs import TIMEOUT_S, free_ports, started, until

UDP, TCP = socket.SOCK_DGRAM, socket.SOCK_STREAM


def connect(endpoint: str) -> Client | None:
    try:
        return Client(endpoint, "1")
    except Exception:  # not up yet
        return None


def frames(listener: socket.socket) -> list[Any]:
    parser, found = common.MAVLink(None), []
    while True:
        try:
            data = listener.recv(65_536)
        except BlockingIOError:
            return found
        found += parser.parse_buffer(data) or []


class Listener:
    """A client of the daemon that stores the newest estimate of each track, and all health records."""

    def __init__(self, client: Client) -> None:
        self._client = client
        self._deadline = time.monotonic() + TIMEOUT_S
        self.newest: dict[str, Estimate] = {}
        self.valid: set[str] = set()  # at any time: on a busy computer some have left before others are tracked
        self.health: list[Health] = []

    def all_tracked(self) -> bool:
        """Whether twenty tracks have been valid, thirteen with an address, after a hundred reports."""
        while (received := self._client.take(0.02)) is not None and time.monotonic() < self._deadline:
            match received.record:
                case Estimate() as e if e.name == "traffic":
                    self.newest[e.target] = e
                    self.valid |= {e.target} if e.valid else set()
                case Health() as h:
                    self.health.append(h)
        fused = self.health[-1].verdicts.get("traffic.fused", 0) if self.health else 0
        named = sum(name.startswith("icao/") for name in self.valid)
        return named == 13 and len(self.valid) >= 20 and fused > 100


def late_joiner(endpoint: str) -> Estimate:
    """One track's estimate, queried by its name."""
    with zenoh.open(_client(endpoint)) as session:
        (reply,) = session.get("onboard/1/estimate/traffic/icao/4b1a00", timeout=TIMEOUT_S)
        return msgspec.json.decode(reply.ok.payload.to_bytes(), type=Estimate)


def settings(autopilot: int, station: int, endpoint: str) -> list[str]:
    links = [
        f"{{name='autopilot', url='udpin:127.0.0.1:{autopilot}'}}",
        f"{{name='station', url='udpout:127.0.0.1:{station}', autopilot=false}}",
    ]
    values = [
        f"link=[{', '.join(links)}]",
        f"zenoh.listen=['{endpoint}']",
        "traffic_out.link='station'",
        "traffic_out.adsb_vehicle='all'",
    ]
    return [argument for value in values for argument in ("--set", value)]


def test_all_the_traffic_is_tracked_published_and_sent_to_a_ground_station(tmp_path: Path) -> None:
    (autopilot,), (router,) = free_ports(UDP), free_ports(TCP)
    station = socket.socket(socket.AF_INET, UDP)
    station.bind(("127.0.0.1", 0))
    station.setblocking(False)
    endpoint = f"tcp/127.0.0.1:{router}"
    config = tmp_path / "traffic.toml"
    config.write_text(daemon_config(load_scenario("traffic")), encoding="utf-8")
    overrides = settings(autopilot, station.getsockname()[1], endpoint)
    fly = ("simlink", "run", "traffic", "--mavlink", f"udpout:127.0.0.1:{autopilot}", "--tcp", "none")
    with started(tmp_path / "daemon", "onboard", "run", config, *overrides) as daemon:
        daemon.wait_for("zenoh:")
        client: Client = until(lambda: connect(endpoint), "the daemon's Zenoh")
        try:
            with started(tmp_path / "simlink", *fly, "--zenoh", endpoint, "--wait", "300") as simulator:
                listener = Listener(client)
                until(listener.all_tracked, "twenty tracks")
                late = late_joiner(endpoint)
                simulator.end()
        finally:
            client.close()
        assert late.target == "icao/4b1a00"
        assert late.intruder is not None
        assert late.intruder.callsign == "HEAD-ON"
        received = frames(station)
        daemon.end()
    station.close()
    vehicles = {m.ICAO_address for m in received if m.get_type() == "ADSB_VEHICLE"}
    assert 0x4B1A00 in vehicles
    assert any(address >= 0xF10000 for address in vehicles)
    assert {m.get_srcComponent() for m in received} == {191}
    assert "traffic: " not in daemon.output()
    assert sum(name.startswith("icao/") for name in listener.newest) == 13
    assert listener.health[-1].rejected.get("bad_radar", 0) == 0


def _client(endpoint: str) -> zenoh.Config:
    config = zenoh.Config()
    for key, value in {
        "mode": '"client"',
        "connect/endpoints": f'["{endpoint}"]',
        "scouting/multicast/enabled": "false",
    }.items():
        config.insert_json5(key, value)
    return config
