"""Daemon and simulator as processes over real links, with a relay and a client to observe them."""

import json
import select
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import zenoh
from pymavlink.dialects.v20 import ardupilotmega as dialect

from onboard.messages import Estimate, Health
from onboard.view.client import Client
from simlink.scenarios.describe import daemon_config
from simlink.scenarios.scenario import load_scenario
from tests.support.programs import TIMEOUT_S, Program, free_ports, started, until

UDP, TCP = socket.SOCK_DGRAM, socket.SOCK_STREAM


class Relay:
    """A UDP relay between the simulator and the daemon's port.

    It keeps the datagrams that the daemon sends.
    """

    def __init__(self, daemon_port: int) -> None:
        self.from_daemon: list[bytes] = []
        self._simulator = socket.socket(socket.AF_INET, UDP)  # the simulator sends here
        self._simulator.bind(("127.0.0.1", 0))
        self.port = int(self._simulator.getsockname()[1])
        self._daemon = socket.socket(socket.AF_INET, UDP)
        self._daemon.bind(("127.0.0.1", 0))
        self._to = ("127.0.0.1", daemon_port)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def frames(self) -> list[Any]:
        """The daemon's messages, read by an independent parser."""
        parser = dialect.MAVLink(None)
        return [m for data in list(self.from_daemon) for m in parser.parse_buffer(data) or []]

    def count(self, kind: str) -> int:
        """Number of messages of that kind from the daemon."""
        return sum(m.get_type() == kind for m in self.frames())

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        self._simulator.close()
        self._daemon.close()

    def _run(self) -> None:
        peer: Any = None
        while not self._stop.is_set():
            for ready in select.select([self._simulator, self._daemon], [], [], 0.1)[0]:
                try:
                    data, address = ready.recvfrom(65_536)
                except ConnectionError:  # the other end is not listening
                    continue
                if ready is self._simulator:
                    peer = address
                    self._daemon.sendto(data, self._to)
                elif peer is not None:
                    self.from_daemon.append(data)
                    self._simulator.sendto(data, peer)


class Observer:
    """A client that keeps the newest health and all estimates."""

    def __init__(self, endpoint: str) -> None:
        self.client: Client = until(lambda: self._connect(endpoint), "the daemon's Zenoh")
        self.estimates: list[Estimate] = []
        self.health: Health | None = None

    @staticmethod
    def _connect(endpoint: str) -> Client | None:
        try:
            return Client(endpoint, "1")
        except Exception:  # not running yet
            return None

    def receive(self) -> None:
        """Take the records that were received, for at most 0.2 s."""
        end = time.monotonic() + 0.2
        while time.monotonic() < end and (received := self.client.take(0.02)) is not None:
            match received.record:
                case Estimate() as estimate:
                    self.estimates.append(estimate)
                case Health() as health:
                    self.health = health

    def newest(self) -> Health:
        """The newest health; waits for the first."""

        def newest() -> Health | None:
            self.receive()
            return self.health

        found: Health = until(newest, "a health")
        return found

    def is_tracking(self) -> bool:
        self.receive()
        return bool(self.estimates) and self.estimates[-1].valid and self.estimates[-1].state == "tracking"


class Setup:
    """Ports, the daemon's command line and the simulator's."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.observers: list[Observer] = []
        self.autopilot, self.camera = free_ports(UDP, UDP)
        self.tcp, self.zenoh = free_ports(TCP, TCP)
        self.endpoint = f"tcp/127.0.0.1:{self.zenoh}"
        self.config = folder / "formation.toml"
        self.config.write_text(daemon_config(load_scenario("formation")), encoding="utf-8")

    def observer(self) -> Observer:
        """A client of the daemon, closed after the test."""
        self.observers.append(Observer(self.endpoint))
        return self.observers[-1]

    def settings(self, autopilot_url: str, *more: str) -> tuple[str, ...]:
        camera = f"{{name='camera', url='udpin:127.0.0.1:{self.camera}', autopilot=false}}"
        return (
            f"link=[{{name='autopilot', url='{autopilot_url}'}}, {camera}]",
            f"zenoh.listen=['{self.endpoint}']",
            *more,
        )

    @contextmanager
    def daemon(self, autopilot_url: str, *more: str) -> Iterator[Program]:
        settings = [a for setting in self.settings(autopilot_url, *more) for a in ("--set", setting)]
        with started(self.folder / "daemon.log", "onboard", "run", self.config, *settings) as program:
            program.wait_for("link camera")
            yield program

    @contextmanager
    def simulator(self, *arguments: str, log: str = "simlink.log", seed: int = 1) -> Iterator[Program]:
        command = ("simlink", "run", "formation", "--seed", str(seed), "--speed", "1", *arguments)
        with started(self.folder / log, *command) as program:
            program.wait_for("flying")
            yield program


def queried(endpoint: str, key: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """(value, attachment) of the reply to a query, asked by a client session of its own."""
    config = zenoh.Config()
    for name, value in (
        ("mode", '"client"'),
        ("connect/endpoints", json.dumps([endpoint])),
        ("scouting/multicast/enabled", "false"),
    ):
        config.insert_json5(name, value)
    with zenoh.open(config) as session:
        (reply,) = list(session.get(key, timeout=TIMEOUT_S))
        ok = reply.ok
        return json.loads(ok.payload.to_bytes()), json.loads(ok.attachment.to_bytes())
