"""`python -m benchmarks.live [--history FILE]`: the daemon as a process under load.

Its bytes pass real sockets, its estimates a real Zenoh subscriber. The flight is that of `benchmarks.live_flight`,
sent by another process. Latency ends in the subscriber's callback, in a third process. The flight is recorded, as
on a vehicle.
"""

import argparse
import json
import os
import platform
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from datetime import date
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
import psutil
from rich.console import Console
from rich.table import Table

from benchmarks import stages
from benchmarks.live_flight import client, datagrams
from onboard.config import load_config
from onboard.messages import Estimate, Health
from onboard.pipeline import Pipeline

SETTLING_TIME_S: Final = 3  # of a flight, before measuring
TIMEOUT_S: Final = 120.0
START_COUNT: Final = 3  # alternately; the shortest is reported
RATES: Final = (5_000, 10_000, 20_000, 30_000, 50_000)
FLIGHT: Final = "live_flight"
BUSY_LOOP: Final = "while True: pass"
Figures = dict[str, Any]


class Subscriber:
    """Receives the leader's estimates and the health, with their arrival times."""

    def __init__(self, endpoint: str) -> None:
        self._estimates: list[tuple[int, bytes]] = []
        self._health: bytes | None = None
        self._session = client(endpoint)
        self._declared = [
            self._session.declare_subscriber("onboard/1/estimate/leader", self._on_estimate),
            self._session.declare_subscriber("onboard/1/health", self._on_health),
        ]

    def _on_estimate(self, sample: Any) -> None:
        self._estimates.append((time.monotonic_ns(), sample.payload.to_bytes()))

    def _on_health(self, sample: Any) -> None:
        self._health = sample.payload.to_bytes()

    def arrivals(self, *, valid: bool = False) -> dict[int, int]:
        """Return the arrival of the first estimate with each image, by the image's stamp.

        With `valid` only valid estimates count.
        """
        found: dict[int, int] = {}
        for at_ns, data in self._estimates:
            estimate = msgspec.json.decode(data, type=Estimate)
            if estimate.measurement is not None and (estimate.valid or not valid):
                found.setdefault(estimate.measurement.t_ns, at_ns)
        return found

    def health(self) -> Health:
        """Return the next health."""
        self._health = None
        wait_until(lambda: self._health is not None, "a health")
        assert self._health is not None  # noqa: S101 - waited for
        return msgspec.json.decode(self._health, type=Health)

    def close(self) -> None:
        """Close the session."""
        self._session.close()


class Daemon:
    """`onboard run` with a UDP link, a Zenoh listener and a recorder, and its log.

    The link is at a free port by default.
    """

    def __init__(
        self, folder: Path, environment: dict[str, str] | None, udp: int | None, link: str, more: Sequence[str]
    ) -> None:
        self.udp, zenoh_port = udp or free_port(socket.SOCK_DGRAM), free_port(socket.SOCK_STREAM)
        self.endpoint = f"tcp/127.0.0.1:{zenoh_port}"
        self._log = folder / "daemon.log"
        command = self._command(folder, link, more)
        self.began = time.monotonic()
        with self._log.open("wb") as log:
            self.popen = subprocess.Popen(command, stderr=log, env=environment)  # noqa: S603 - our own
        self.process = psutil.Process(self.popen.pid)

    def _command(self, folder: Path, link: str, more: Sequence[str]) -> list[str]:
        settings = (
            f"link=[{{name='autopilot', url='udpin:127.0.0.1:{self.udp}'{link}}}]",
            f"zenoh.listen=['{self.endpoint}']",
            "estimator.leader.size_prior_m=2.0",
            f"recorder.path='{folder / 'flight.mcap'}'",
            *more,
        )
        return [sys.executable, "-m", "onboard", "run", *(a for s in settings for a in ("--set", s))]

    def wait_for(self, text: str) -> float:
        """Return the seconds from the process's start until `text` is in its log."""
        wait_until(lambda: text in self._log.read_text(errors="replace"), text, self.popen)
        return time.monotonic() - self.began

    def lines(self) -> list[str]:
        """Return the lines reported so far."""
        return self._log.read_text(errors="replace").splitlines()

    def cpu_s(self) -> float:
        """Return the seconds of computing so far."""
        times = self.process.cpu_times()
        return float(times.user + times.system)

    def close(self) -> None:
        """End it."""
        self.popen.terminate()
        self.popen.wait(TIMEOUT_S)


class Floor(Daemon):
    """`benchmarks.floor` in place of the daemon; it has no settings."""

    def _command(self, folder: Path, *_settings: Any) -> list[str]:
        like = folder / "like.json"
        like.write_bytes(msgspec.json.encode(an_estimate()))
        where = ("--udp", str(self.udp), "--zenoh", self.endpoint, "--like", str(like))
        return [sys.executable, "-m", "benchmarks.floor", *where]


@cache
def an_estimate() -> Estimate:
    """Return the leader's estimate after an image of the flight."""
    pipeline = Pipeline(load_config(None, ("estimator.leader.size_prior_m=2.0",)))
    outputs = [output for datagram in datagrams(2) for output in pipeline.feed(datagram)]
    return next(o for o in reversed(outputs) if isinstance(o, Estimate) and o.measurement is not None)


@contextmanager
def daemon(
    environment: dict[str, str] | None = None,
    udp: int | None = None,
    *,
    link: str = "",
    more: Sequence[str] = (),
    kind: type[Daemon] = Daemon,
) -> Iterator[Daemon]:
    """Run a daemon in its own folder, ended after the block.

    `link` and `more` are further settings of its link and its configuration.
    """
    with tempfile.TemporaryDirectory() as folder:
        one = kind(Path(folder), environment, udp, link, more)
        try:
            yield one
        finally:
            one.close()


def under_load(seconds: int, *, busy: int = 0, on_core: int | None = None, kind: type[Daemon] = Daemon) -> Figures:
    """Measure the daemon next to `busy` busy loops.

    Returns the latency (ms) from exposure and from arrival, the daemon's share of a core (percent) and its memory
    (MB). With `on_core` the daemon and the busy loops share this core, at the same priority.
    """
    with ExitStack() as stack:
        one = stack.enter_context(daemon(kind=kind))
        loops = stack.enter_context(busy_loops(busy, on_core))
        one.wait_for("link autopilot")
        if on_core is not None:
            one.process.cpu_affinity([on_core])
            for loop in loops:
                psutil.Process(loop.pid).nice(one.process.nice())
        subscriber = stack.enter_context(closing(Subscriber(one.endpoint)))
        load = program(
            FLIGHT, "--udp", str(one.udp), "--zenoh", one.endpoint, "--seconds", str(SETTLING_TIME_S + seconds)
        )
        one.wait_for("leader: ")
        time.sleep(SETTLING_TIME_S)
        before, since = one.cpu_s(), time.monotonic()
        out, _ = load.communicate(timeout=TIMEOUT_S + seconds)
        share = 100 * (one.cpu_s() - before) / (time.monotonic() - since)
        memory = one.process.memory_info().rss / 1e6
        dropped = 0 if kind is Floor else sum(link.dropped for link in subscriber.health().links.values())
    arrivals = subscriber.arrivals()
    images = json.loads(out)["images"]
    counted = [image for image in images[SETTLING_TIME_S * 30 :] if image[0] in arrivals]
    return {
        "arrival_ms": percentiles([arrivals[stamp] - sent for stamp, _, sent in counted]),
        "exposure_ms": percentiles([arrivals[stamp] - exposed for stamp, exposed, _ in counted]),
        "images": len(images) - SETTLING_TIME_S * 30,
        "answered": len(counted),
        "cpu_percent": share,
        "memory_mb": memory,
        "dropped": dropped,
    }


def percentiles(delays_ns: Sequence[int]) -> Figures:
    """Return median, 99th percentile and maximum, ms."""
    p50, p99 = np.percentile(delays_ns, [50, 99]) * 1e-6
    return {"p50": float(p50), "p99": float(p99), "max": max(delays_ns) * 1e-6}


def input_rates(seconds: int, rates: Sequence[int] = RATES) -> list[Figures]:
    """Measure for each rate the messages that were sent, and those dropped by kernel and daemon."""
    found = []
    for rate in rates:
        with ExitStack() as stack:
            one = stack.enter_context(daemon())
            one.wait_for("link autopilot")
            subscriber = stack.enter_context(closing(Subscriber(one.endpoint)))
            warm = program(FLIGHT, "--udp", str(one.udp), "--seconds", "1")
            warm.communicate(timeout=TIMEOUT_S)
            before = subscriber.health().links["autopilot"]
            cpu, since = one.cpu_s(), time.monotonic()
            rated = ("--seconds", str(seconds), "--flood", str(rate))
            out, _ = program(FLIGHT, "--udp", str(one.udp), *rated).communicate(timeout=TIMEOUT_S)
            share = (one.cpu_s() - cpu) / (time.monotonic() - since)
            subscriber.health()
            after = subscriber.health().links["autopilot"]
        sent = json.loads(out)
        received = after.received - before.received
        found.append(
            {
                "asked": rate,
                "sent_per_s": sent["rate"],
                "received": received,
                "sent": sent["datagrams"],
                "dropped": after.dropped - before.dropped,
                "cpu_us_per_message": 1e6 * share * seconds / max(received, 1),
            }
        )
    return found


def start_in(environment: dict[str, str], kind: type[Daemon] = Daemon) -> float:
    """Return the seconds from the process's start to its first estimate, with continuous input.

    The floor, which gets images over Zenoh only, is ready when it listens.
    """
    with ExitStack() as stack:
        udp = free_port(socket.SOCK_DGRAM)
        load = program(FLIGHT, "--udp", str(udp), "--seconds", "300", "--heartbeats")
        stack.callback(load.communicate)
        stack.callback(load.terminate)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:  # the load has begun
            probe.bind(("127.0.0.1", udp))
            probe.recv(1)
        one = stack.enter_context(daemon(environment, udp, kind=kind))
        return one.wait_for("link autopilot" if kind is Floor else "leader: ")


def measure_restart() -> Figures:
    """Return the seconds from a daemon's SIGKILL until another one has opened its links and had an image.

    The second one is started at once. The images come over Zenoh from a camera that sends all the time.
    """
    with ExitStack() as stack:
        first = stack.enter_context(daemon())
        first.wait_for("link autopilot")
        subscriber = stack.enter_context(closing(Subscriber(first.endpoint)))
        where = ("--udp", str(first.udp), "--zenoh", first.endpoint)
        load = program(FLIGHT, *where, "--seconds", "300", "--heartbeats")
        stack.callback(load.communicate)
        stack.callback(load.terminate)
        wait_until(subscriber.arrivals, "an image", first.popen)
        killed_ns = time.monotonic_ns()
        in_flight_ns = killed_ns + 100_000_000  # what the first one has sent still
        first.popen.kill()
        first.popen.wait(TIMEOUT_S)
        second = stack.enter_context(daemon(udp=first.udp, more=(f"zenoh.listen=['{first.endpoint}']",)))
        opened_s = second.wait_for("link autopilot") + second.began - killed_ns * 1e-9
        wait_until(lambda: max(subscriber.arrivals().values()) > in_flight_ns, "an image", second.popen)
        first_ns = min(at for at in subscriber.arrivals().values() if at > in_flight_ns)
    return {"links_s": opened_s, "image_s": (first_ns - killed_ns) * 1e-9}


def machine() -> Figures:
    """Return a description of this computer."""
    cpu = [line.split(":")[1].strip() for line in _lines("/proc/cpuinfo") if line.startswith("model name")]
    return {
        "date": date.today().isoformat(),  # noqa: DTZ011 - a day is enough
        "cpu": cpu[0] if cpu else platform.machine(),
        "cores": os.cpu_count(),
        "load_average": os.getloadavg()[0],
        "python": platform.python_version(),
        "zenoh": version("eclipse-zenoh"),
    }


def measure(seconds: int) -> Figures:
    """Measure everything, under the keys of the history."""
    found: Figures = {"machine": machine()}
    found["stages"] = stages.measure()
    starts = [[start_in(dict(os.environ), kind) for kind in (Daemon, Floor)] for _ in range(START_COUNT)]
    ours, floor = np.min(starts, axis=0).tolist()
    found["start"] = {"warm_s": ours}
    found["restarted"] = measure_restart()
    found["alone"], found["floor"] = under_load(seconds), under_load(seconds, kind=Floor)
    found["floor"]["start_s"] = floor
    found["floor"]["replay_times"] = found["stages"].pop("floor_replay_times")
    found["ratios"] = ratios(found)
    found["beside_two_busy_loops"] = under_load(seconds, busy=2)
    found["half_of_one_core"] = under_load(seconds, busy=1, on_core=0)
    found["input"] = input_rates(4)
    found["machine"]["load_average_after"] = os.getloadavg()[0]
    return found


def ratios(found: Figures) -> dict[str, float]:
    """Return the daemon's figures over those of the floor."""
    ours, floor = found["alone"], found["floor"]
    return {
        "arrival_p50": ours["arrival_ms"]["p50"] / floor["arrival_ms"]["p50"],
        "arrival_p99": ours["arrival_ms"]["p99"] / floor["arrival_ms"]["p99"],
        "cpu": ours["cpu_percent"] / floor["cpu_percent"],
        "memory": ours["memory_mb"] / floor["memory_mb"],
        "replay": floor["replay_times"] / found["stages"]["replay_times"],
        "start": found["start"]["warm_s"] / floor["start_s"],
    }


def floor_table(found: Figures) -> Table:
    """Return a table of the daemon and its floor."""
    made = Table("the daemon beside its floor", "daemon", "floor", "ratio")
    ours, floor, times = found["alone"], found["floor"], found["ratios"]
    for words, shown, of_ours, of_floor, key in (
        (
            "arrival to subscriber, p50, ms",
            ".2f",
            ours["arrival_ms"]["p50"],
            floor["arrival_ms"]["p50"],
            "arrival_p50",
        ),
        ("the same, p99", ".2f", ours["arrival_ms"]["p99"], floor["arrival_ms"]["p99"], "arrival_p99"),
        ("computing, % of a core", ".1f", ours["cpu_percent"], floor["cpu_percent"], "cpu"),
        ("memory, MB", ".0f", ours["memory_mb"], floor["memory_mb"], "memory"),
        ("replay, times real time", ".0f", found["stages"]["replay_times"], floor["replay_times"], "replay"),
        ("start, compiled, s", ".2f", found["start"]["warm_s"], floor["start_s"], "start"),
    ):
        made.add_row(words, format(of_ours, shown), format(of_floor, shown), f"{times[key]:.1f}")
    return made


@contextmanager
def busy_loops(count: int, on_core: int | None) -> "Iterator[list[subprocess.Popen[bytes]]]":
    """Run `count` processes that only compute."""
    loops = [subprocess.Popen([sys.executable, "-c", BUSY_LOOP]) for _ in range(count)]  # noqa: S603 - our own
    try:
        for loop in loops:
            if on_core is not None:
                psutil.Process(loop.pid).cpu_affinity([on_core])
        yield loops
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()


def wait_until(condition: Any, what: str, popen: "subprocess.Popen[Any] | None" = None) -> None:
    """Wait until a condition holds.

    Raises TimeoutError, also at once if the process has ended.
    """
    deadline = time.monotonic() + TIMEOUT_S
    while not condition():
        if time.monotonic() > deadline or (popen is not None and popen.poll() is not None):
            raise TimeoutError(f"waited in vain for {what}")
        time.sleep(0.005)


def free_port(kind: socket.SocketKind) -> int:
    """Return a free port on the loopback interface."""
    with socket.socket(socket.AF_INET, kind) as sock:
        sock.bind(("127.0.0.1", 0))
        return int(sock.getsockname()[1])


def program(module: str, *arguments: str) -> "subprocess.Popen[str]":
    """Start a module of the benchmarks as a process that prints its results."""
    command = [sys.executable, "-m", f"benchmarks.{module}", *arguments]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)  # noqa: S603 - our own


def _lines(path: str) -> list[str]:
    try:
        return Path(path).read_text(encoding="utf-8").splitlines()
    except OSError:
        return []


def main(arguments: list[str] | None = None) -> int:
    """Measure, print, and append to the history if asked to."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.live", description="The daemon under load.")
    parser.add_argument("--seconds", type=int, default=30, help="of each flight that is measured")
    parser.add_argument("--history", type=Path, help="append the figures to this file, as a line of JSON")
    options = parser.parse_args(arguments)
    measured = measure(options.seconds)
    print(json.dumps(measured, indent=1))
    Console().print(floor_table(measured))
    if options.history is not None:
        with options.history.open("a", encoding="utf-8") as file:
            file.write(json.dumps(measured) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
