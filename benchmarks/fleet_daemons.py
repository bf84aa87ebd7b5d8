"""Daemons behind one router over TLS, each with its own leader, and a ground that hears them all.

    python -m benchmarks.fleet_daemons --vehicles 10 --seconds 20 --images 10

One process sends every daemon the bytes of its flight: navigation at 50 Hz, and images as LANDING_TARGETs. Each
leader has another range, so that an estimate under another vehicle's key is noticed.
"""

import argparse
import json
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
import psutil

from benchmarks import fleet
from benchmarks.live_flight import as_mavlink
from benchmarks.targets import EPOCH, MS, flight
from onboard.messages import Encoding, Estimate
from onboard.wire.mavlink.encode import MavlinkEncoder

IMAGE_RATE_HZ: Final = 30  # of the flight; some are left out
SETTLING_TIME_S: Final = 5.0  # of the flight, before measuring
MAX_RANGE_ERROR: Final = 0.3  # relative, of a vehicle's own leader
TIMEOUT_S: Final = 120.0
Figures = dict[str, Any]


class Ground:
    """Receives the leader's estimates of all vehicles; with `counts` it stores their ranges."""

    def __init__(self, session: Any) -> None:
        self.counts = False
        self.ranges: defaultdict[str, list[float]] = defaultdict(list)
        self.heard: set[str] = set()
        session.declare_subscriber("onboard/*/estimate/leader", self._take)

    def _take(self, sample: Any) -> None:
        vehicle = str(sample.key_expr).split("/")[1]
        self.heard.add(vehicle)
        if self.counts:
            estimate = msgspec.json.decode(sample.payload.to_bytes(), type=Estimate)
            self.ranges[vehicle].append(float(np.linalg.norm((estimate.mean or (np.nan,) * 3)[:3])))


def measure(vehicles: int, seconds: int, images: int) -> Figures:
    """Fly `vehicles` daemons for `seconds`, each with `images` a second."""
    names = [f"uav-{k}" for k in range(1, vehicles + 1)]
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        script = fleet.ROOT / "configs" / "make-test-certificates.sh"
        subprocess.run([script, folder / "certs", *names, "ground"], check=True, capture_output=True)  # noqa: S603
        port, router = stack.enter_context(fleet.router(folder))
        ground = Ground(stack.enter_context(closing(fleet.member(folder, port, "ground"))))
        ports = {name: _free_port() for name in names}
        daemons = [stack.enter_context(_daemon(folder, port, name, ports[name])) for name in names]
        programs = [router, *daemons]
        flown = _flights(list(ports.values()), round(SETTLING_TIME_S) + seconds + 1, images)
        sender = stack.enter_context(closing(Sender(flown)))
        sender.fly(until=SETTLING_TIME_S)
        missing = set(names) - ground.heard
        if missing:
            raise RuntimeError(f"not heard on the ground: {', '.join(sorted(missing))}")
        ground.counts, before, since = True, [sum(p.cpu_times()[:2]) for p in programs], time.monotonic()
        sender.fly(until=SETTLING_TIME_S + seconds)
        ground.counts, took = False, time.monotonic() - since
        cores = [(sum(p.cpu_times()[:2]) - b) / took for p, b in zip(programs, before, strict=True)]
    due = _ranges(vehicles)
    rates = {name: len(ground.ranges[name]) / took for name in names}
    off = {name: abs(statistics.fmean(ground.ranges[name]) / due[k] - 1.0) for k, name in enumerate(names)}
    return {
        "vehicles": vehicles,
        "images_a_second": images,
        "seconds": took,
        "estimates_a_second_least": min(rates.values()),
        "estimates_a_second_most": max(rates.values()),
        "range_off_by_most": max(off.values()),
        "vehicles_with_another_ones_leader": sum(x > MAX_RANGE_ERROR for x in off.values()),
        "cores_of_a_daemon": statistics.fmean(cores[1:]),
        "cores_of_the_router": cores[0],
    }


def _ranges(vehicles: int) -> list[float]:
    """Return the range of each vehicle's leader in `flight`, m, without its height."""
    found = []
    for seed in range(1, vehicles + 1):
        rng = np.random.default_rng(seed)
        rng.uniform(-0.35, 0.35, 1)  # its bearing
        found.append(float(rng.uniform(15.0, 60.0, 1)[0]))
    return found


def _flights(ports: Sequence[int], seconds: int, images: int) -> Iterator[tuple[float, int, bytes]]:
    """Return seconds since the start, port and bytes of every datagram, in order."""
    every, due = max(1, IMAGE_RATE_HZ // images), []
    for k, port in enumerate(ports):
        encoder, count = MavlinkEncoder(1, 191), 0
        for datagram in flight(1, seconds, seed=k + 1):
            at = (datagram.t_recv_ns - EPOCH - 5_000 * MS + k * MS) * 1e-9  # not all in the same millisecond
            if datagram.encoding is Encoding.MAVLINK:
                due.append((at, port, datagram.data))
                continue
            if count % every == 0:
                data = datagram.data.replace(b'"target/0"', b'"leader"')
                due.append((at, port, as_mavlink(msgspec.structs.replace(datagram, data=data), encoder)))
            count += 1
    return iter(sorted(due, key=lambda one: one[0]))


class Sender:
    """Sends datagrams at their times in the flight."""

    def __init__(self, flown: Iterator[tuple[float, int, bytes]]) -> None:
        self._flown, self._socket = flown, socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._begin = time.monotonic()

    def close(self) -> None:
        """Send no more."""
        self._socket.close()

    def fly(self, until: float) -> None:
        """Send until this time of the flight, s."""
        for at, port, data in self._flown:
            time.sleep(max(0.0, self._begin + at - time.monotonic()))
            self._socket.sendto(data, ("127.0.0.1", port))
            if at >= until:
                return


@contextmanager
def _daemon(folder: Path, router: int, name: str, port: int) -> Iterator[psutil.Process]:
    """Run `onboard run` with the configuration for fleets, and continue once its link listens."""
    certs, log = folder / "certs", folder / f"{name}.log"
    files = {
        "certificate_file": f"{name}.pem",
        "private_key_file": f"{name}.key",
        "password_file": f"{name}.password",
    }
    settings = (
        f"link=[{{name='autopilot', url='udpin:127.0.0.1:{port}'}}]",
        f"zenoh.vehicle='{name}'",
        f"zenoh.connect=['tls/127.0.0.1:{router}']",
        *(f"zenoh.{key}='{certs / file}'" for key, file in files.items()),
    )
    command: list[str | Path] = [sys.executable, "-m", "onboard", "run", fleet.ROOT / "configs" / "fleet.toml"]
    command += [a for s in settings for a in ("--set", s)]
    with log.open("wb") as file:
        process = subprocess.Popen(command, cwd=folder, stderr=file)  # noqa: S603 - our own
    try:
        deadline = time.monotonic() + TIMEOUT_S
        while "link autopilot" not in log.read_text(errors="replace"):
            if process.poll() is not None or time.monotonic() > deadline:
                raise RuntimeError(f"{name}: {log.read_text(errors='replace')}")
            time.sleep(0.1)
        yield psutil.Process(process.pid)
    finally:
        process.terminate()
        process.wait(TIMEOUT_S)


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def main(argv: Sequence[str] | None = None) -> int:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--vehicles", type=int, default=10)
    parser.add_argument("--seconds", type=int, default=20)
    parser.add_argument("--images", type=int, default=10, help="images a second of each vehicle (default: 10)")
    arguments = parser.parse_args(argv)
    found = measure(arguments.vehicles, arguments.seconds, arguments.images)
    print(json.dumps(found, indent=2))
    return int(found["vehicles_with_another_ones_leader"] > 0)


if __name__ == "__main__":
    sys.exit(main())
