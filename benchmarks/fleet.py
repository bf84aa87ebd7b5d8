"""Vehicles that publish through one router over TLS: rates, losses, cross-talk, and bytes on the wire.

    python -m benchmarks.fleet --vehicles 10 --seconds 20
    python -m benchmarks.fleet --watch leader health

The router is `onboard router` as it ships, in a process of its own. A vehicle is a session that publishes as much
as a daemon does with one leader, as measured on the simulated formation; its estimators do not run. All connect
through a relay that counts their bytes.
"""

import argparse
import json
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import Any, Final, NamedTuple

import psutil
import zenoh

ROOT: Final = Path(__file__).parents[1]
PUBLISHED: Final = {  # Hz and bytes of a record
    "estimate/leader": (30, 4489),
    "ownship": (50, 310),
    "leader": (20, 1322),
    "health": (1, 1508),
}
TIMEOUT_S: Final = 60.0
MATCHING_TIME_S: Final = 1.0  # until all know the subscribers; before, nothing is sent
DELIVERY_TIMEOUT_S: Final = 3.0  # for records in transit
CHUNK_BYTES: Final = 65_536
Figures = dict[str, Any]


class Relay:
    """Forwards connections to a port and counts the bytes of both directions."""

    def __init__(self, to: int) -> None:
        self.bytes = 0
        self._to = to
        self._server = socket.create_server(("127.0.0.1", 0))
        self.port = int(self._server.getsockname()[1])
        self._sockets: list[socket.socket] = []
        threading.Thread(target=self._accept, daemon=True).start()

    def close(self) -> None:
        """End all connections."""
        for one in (self._server, *self._sockets):
            one.close()

    def _accept(self) -> None:
        while True:
            try:
                near, _ = self._server.accept()
            except OSError:  # closed
                return
            far = socket.create_connection(("127.0.0.1", self._to))
            self._sockets += [near, far]
            for source, target in ((near, far), (far, near)):
                threading.Thread(target=self._forward, args=(source, target), daemon=True).start()

    def _forward(self, source: socket.socket, target: socket.socket) -> None:
        try:
            while data := source.recv(CHUNK_BYTES):
                self.bytes += len(data)
                target.sendall(data)
        except OSError:  # either end is closed
            return


class Watcher:
    """A ground station that counts the records of each vehicle, and those under a wrong key."""

    def __init__(self, session: Any, keys: Sequence[str]) -> None:
        self.received: Counter[tuple[str, str]] = Counter()
        self.cross_talk = 0
        for key in keys:
            session.declare_subscriber(f"onboard/*/{key}", self._count)

    def _count(self, sample: Any) -> None:
        _, vehicle, name = str(sample.key_expr).split("/", 2)
        self.received[vehicle, name] += 1
        self.cross_talk += sample.payload.to_bytes().split(b" ", 1)[0] != f"{vehicle}/{name}".encode()


def measure(vehicles: int, seconds: float, keys: Sequence[str] = tuple(PUBLISHED)) -> Figures:
    """Fly `vehicles` for `seconds`; the ground subscribes to `keys` of each."""
    names = [f"uav-{k}" for k in range(1, vehicles + 1)]
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        command: list[str | Path] = [
            ROOT / "configs" / "make-test-certificates.sh",
            folder / "certs",
            *names,
            "ground",
        ]
        subprocess.run(command, check=True, capture_output=True)  # noqa: S603 - our own
        port, process = stack.enter_context(router(folder))
        watcher = Watcher(stack.enter_context(closing(member(folder, port, "ground"))), keys)
        relays = {name: stack.enter_context(closing(Relay(port))) for name in names}
        sessions = {
            name: stack.enter_context(closing(member(folder, relay.port, name))) for name, relay in relays.items()
        }
        streams = _streams(sessions)
        time.sleep(MATCHING_TIME_S)
        before = {name: relay.bytes for name, relay in relays.items()}
        cpu = sum(process.cpu_times()[:2])
        sent = _publish(streams, seconds, keys)
        _settle(watcher, sent)
        cpu = sum(process.cpu_times()[:2]) - cpu
        kilobits = [8e-3 * (relays[name].bytes - before[name]) / seconds for name in names]
    received = {name: sum(n for (v, _), n in watcher.received.items() if v == name) for name in names}
    watched = [PUBLISHED[key] for key in keys]
    due = round(seconds * sum(rate for rate, _ in watched))
    return {
        "vehicles": vehicles,
        "seconds": seconds,
        "sent_share_of_due": min(sent.values()) / due,
        "received_share_of_sent": min(received[name] / sent[name] for name in names),
        "lost": sum(sent.values()) - sum(received.values()),
        "cross_talk": watcher.cross_talk,
        "payload_kbit_s_of_a_vehicle": 8e-3 * sum(rate * size for rate, size in watched),
        "wire_kbit_s_of_a_vehicle": max(kilobits),
        "router_cores": cpu / seconds,
    }


class Stream(NamedTuple):
    """One key of one vehicle."""

    vehicle: str
    key: str
    publisher: Any
    payload: bytes
    rate: int


def _streams(sessions: dict[str, Any]) -> list[Stream]:
    drop = zenoh.CongestionControl.DROP
    streams = []
    for name, session in sessions.items():
        for key, (rate, size) in PUBLISHED.items():
            publisher = session.declare_publisher(f"onboard/{name}/{key}", congestion_control=drop, express=True)
            payload = f"{name}/{key} ".encode().ljust(size, b"x")
            streams.append(Stream(name, key, publisher, payload, rate))
    return streams


def _publish(streams: Sequence[Stream], seconds: float, keys: Sequence[str]) -> Counter[str]:
    """Publish at the rates of `PUBLISHED`; count each vehicle's records with one of these keys."""
    sent: Counter[str] = Counter()
    counts = [0] * len(streams)
    begin = time.monotonic()
    while (now := time.monotonic() - begin) < seconds:
        for k, stream in enumerate(streams):
            if counts[k] < stream.rate * now:
                stream.publisher.put(stream.payload)
                counts[k] += 1
                sent[stream.vehicle] += stream.key in keys
        time.sleep(0.002)
    return sent


def _settle(watcher: Watcher, sent: Counter[str]) -> None:
    deadline = time.monotonic() + DELIVERY_TIMEOUT_S
    while watcher.received.total() < sent.total() and time.monotonic() < deadline:
        time.sleep(0.05)


def member(folder: Path, port: int, name: str) -> Any:
    """Open a session of a member of the fleet."""
    certs = folder / "certs"
    config = zenoh.Config()
    settings = {
        "mode": "client",
        "connect/endpoints": [f"tls/127.0.0.1:{port}"],
        "scouting/multicast/enabled": False,
        "transport/link/tls": {
            "root_ca_certificate": str(certs / "ca.pem"),
            "connect_certificate": str(certs / f"{name}.pem"),
            "connect_private_key": str(certs / f"{name}.key"),
            "enable_mtls": True,
        },
        "transport/auth/usrpwd": {"user": name, "password": (certs / f"{name}.password").read_text().strip()},
    }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


def _listens(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


@contextmanager
def router(folder: Path) -> Iterator[tuple[int, psutil.Process]]:
    """Run `onboard router` on a free port, and continue once it listens."""
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port = int(probe.getsockname()[1])
    listen = f"router.listen=['tls/127.0.0.1:{port}']"
    command: list[str | Path] = [
        sys.executable,
        "-m",
        "onboard",
        "router",
        ROOT / "configs" / "router.toml",
        "--set",
        listen,
    ]
    process = subprocess.Popen(command, cwd=folder, stderr=subprocess.PIPE)  # noqa: S603 - our own
    try:
        deadline = time.monotonic() + TIMEOUT_S
        while not _listens(port):
            if process.poll() is not None or time.monotonic() > deadline:
                raise RuntimeError(f"no router: {process.stderr.read().decode() if process.stderr else ''}")
            time.sleep(0.1)
        yield port, psutil.Process(process.pid)
    finally:
        process.terminate()
        process.communicate(timeout=TIMEOUT_S)


def main(argv: Sequence[str] | None = None) -> int:
    """Print the figures, and write them with `--json`."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--vehicles", type=int, default=10)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--watch", nargs="+", choices=PUBLISHED, default=tuple(PUBLISHED), metavar="KEY")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args(argv)
    found = measure(arguments.vehicles, arguments.seconds, arguments.watch)
    for name, value in found.items():
        print(f"{name:30} {value:.4g}" if isinstance(value, float) else f"{name:30} {value}")
    if arguments.json:
        arguments.json.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")
    return int(found["cross_talk"] > 0)


if __name__ == "__main__":
    sys.exit(main())
