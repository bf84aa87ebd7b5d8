"""The main job on simulated input: simlink, the daemon and the view together, and a scorecard at the end.

Simulator and daemon are the real programs, each in its own process; this one is the view and the judge. It is a
client like any other: it sees what the daemon publishes, and beside it the truth, which the daemon never reads.
"""

import contextlib
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

import msgspec

from onboard.commands.processes import DemoError, Process, connect, free_ports, interruptions, process
from onboard.config import Config, load_config
from onboard.messages import Estimate, Health, NavState, Record, SimStatus, Truth
from onboard.scoring.beside import PRIMARY_ESTIMATOR
from onboard.scoring.fault import FaultScore, score_fault
from onboard.scoring.leader import LeaderScore, score_leader
from onboard.scoring.own_state import OwnStateScore, score_own_state
from onboard.scoring.reference import reference_from_records
from onboard.scoring.statistics import Latency, percentiles
from onboard.units import S_PER_NS
from onboard.view.client import Client, PublishedRecord

if TYPE_CHECKING:
    from onboard.view.view import View

DAEMON_TIMEOUT_S: Final = 3600  # on a busy computer; the demo ends earlier if the daemon does
EXAMPLES: Final = {"pictures": "contour.py", "pictures-follow": "contour.py", "pictures-tag": "tag.py"}
LINGER_TIME_S: Final = 0.5
BESIDE_SECTIONS: Final = {"paper": "oh_johnson"}  # their sections, by what --beside calls them


class Drops(Record, frozen=True, kw_only=True):
    """Losses: images between simulator and pipeline, and records between daemon and view.

    `skipped` counts datagrams that had waited too long on a busy computer, or that its sockets lost."""

    images_sent: int
    images_received: int
    images_lost: int
    estimates_missed: int
    sink_drops: int
    skipped: int


class DemoReport(Record, frozen=True, kw_only=True):
    """A demo's result. `score` is spread into the same level when written as JSON."""

    scenario: str
    seed: int
    duration_s: float
    score: LeaderScore
    latency_ms: Latency
    drops: Drops
    own_state: OwnStateScore | None = None
    fault: FaultScore | None = None
    beside: dict[str, LeaderScore] = msgspec.field(default_factory=dict)


class DemoFlight(NamedTuple):
    """Results of a demo for its scorecard."""

    estimates: list[Estimate]
    truths: list[Truth]
    health: Health | None
    status: SimStatus | None
    to_publish_ms: list[float]
    own_ms: list[float]
    own_states: list[NavState]
    beside: dict[str, list[Estimate]]


class DemoProgress(NamedTuple):
    """Callbacks, again and again: `on_wait` with the seconds for which the daemon has been starting, then
    `on_progress` with the seconds flown and the newest estimate."""

    on_wait: Callable[[float], None]
    on_progress: Callable[[float, Estimate | None], None]


def run_demo(
    *,
    scenario: str,
    seed: int,
    duration: float,
    directory: Path,
    overrides: tuple[str, ...],
    detector: Path | None,
    beside: str | None = None,
    view: "Callable[[Config], View | None]",
    tell: DemoProgress,
) -> DemoReport:
    """Fly `scenario` for `duration` seconds; files go to the folder `directory`.
    `detector` is a program that finds the leader in pictures: it runs beside, as `python FILE --connect ENDPOINT`.

    Raises DemoError, and ConfigError for bad overrides.
    """
    detector = detector or _example(scenario)
    name = flight_name(scenario, seed)
    described = directory / f"{name}.toml"
    described.write_bytes(_described(scenario))
    autopilot_port, camera_port, zenoh_port = free_ports()
    endpoint = f"tcp/127.0.0.1:{zenoh_port}"
    settings = (*overrides, f"zenoh.listen=['{endpoint}']")
    if beside is not None:
        settings = (*settings, flown_beside(beside, load_config(described, settings)))
    config = load_config(described, settings)
    links = (
        f"link=[{{name='autopilot', url='udpin:127.0.0.1:{autopilot_port}'}}, "
        f"{{name='camera', url='udpin:127.0.0.1:{camera_port}', autopilot=false}}]"
    )
    daemon_command = ["onboard", "run", str(described), *(a for s in (*settings, links) for a in ("--set", s))]
    simlink_command = [
        *("simlink", "run", scenario, "--seed", str(seed), "--duration", str(duration)),
        *("--wait", str(DAEMON_TIMEOUT_S), "--tcp", "none"),
        *("--zenoh", endpoint, "--vehicle", config.zenoh.vehicle),
        *("--mavlink", f"udpout:127.0.0.1:{autopilot_port}"),
        *("--camera-mavlink", f"udpout:127.0.0.1:{camera_port}"),
    ]
    helpers: tuple[Process, ...] = ()
    with contextlib.ExitStack() as stack:
        heed = stack.enter_context(interruptions())
        daemon = stack.enter_context(process(daemon_command, directory / f"{name}.daemon.log"))
        client = connect(endpoint, config.zenoh.vehicle, daemon, tell.on_wait)
        stack.callback(client.close)
        shown = view(config)
        if shown is not None:
            stack.callback(shown.close)
        if detector is not None:
            finder = [str(detector), "--connect", endpoint, "--vehicle", config.zenoh.vehicle]
            helpers = (stack.enter_context(process(finder, directory / f"{name}.detector.log")),)
        simlink = stack.enter_context(process(simlink_command, directory / f"{name}.simlink.log"))
        flight = _watch(client, shown, (daemon, simlink), helpers, tell.on_progress, heed)
    return _report(flight, scenario, seed, duration)


def flown_beside(beside: str, config: Config) -> str:
    """The setting that flies another filter of the leader, which knows the same wingspan."""
    leader = config.estimator.get(PRIMARY_ESTIMATOR)
    known = "{}" if leader is None else f"{{size_prior_m={leader.size_prior_m}}}"
    return f"estimator.{BESIDE_SECTIONS[beside]}={known}"


def _example(scenario: str) -> Path | None:
    """The example detector of a scenario with pictures, None for others. Raises DemoError where it is not here."""
    if scenario not in EXAMPLES:
        return None
    file = Path(__file__).parents[2] / "examples" / EXAMPLES[scenario]
    if not file.exists():
        raise DemoError(f"scenario {scenario} needs --detector, such as examples/contour.py of the sources")
    return file


def flight_name(scenario: str, seed: int) -> str:
    """Return the name of a demo's files without the suffix. `scenario` may be the path of a .toml file."""
    return f"{Path(scenario).name.removesuffix('.toml')}-{seed}"


def _described(scenario: str) -> bytes:
    """The configuration that fits a scenario, as the simulator gives it: camera, and the leader's wingspan.

    Raises DemoError when there is no such scenario.
    """
    command = [sys.executable, "-m", "simlink", "config", scenario]
    done = subprocess.run(command, capture_output=True, check=False)  # noqa: S603 - our own program
    if done.returncode != 0:
        words = done.stderr.decode(errors="replace").strip().splitlines()
        raise DemoError(words[-1].removeprefix("simlink: ") if words else "the simulator does not start")
    return done.stdout


def _watch(
    client: Client,
    view: "View | None",
    processes: "tuple[Process, Process]",
    beside: "tuple[Process, ...]",
    on_progress: Callable[[float, Estimate | None], None],
    heed: Callable[[], None],
) -> DemoFlight:
    """Take and show all records until the simulator says it has finished and the last ones have come, or `heed`
    raises."""
    flight = DemoFlight([], [], None, None, [], [], [], {})
    daemon, simlink = processes
    newest: Estimate | None = None
    finished_at: float | None = None
    while finished_at is None or time.monotonic() < finished_at + LINGER_TIME_S + _health_wait(flight):
        received = client.take(0.1)
        heed()
        if received is None:
            for one in (daemon, *beside):
                one.check()
            if simlink.popen.poll() is not None and finished_at is None:
                simlink.check()
                finished_at = time.monotonic()
            continue
        record = received.record
        if view is not None:
            view.show(record)
        match record:
            case NavState():
                flight.own_states.append(record)
            case Estimate() if record.is_primary and record.name != PRIMARY_ESTIMATOR:
                flight.beside.setdefault(record.name, []).append(record)
            case Estimate() if record.is_primary:
                flight.estimates.append(record)
                newest = record
                _note_latency(flight, received)
            case Truth():
                flight.truths.append(record)
                on_progress((record.t_ns - flight.truths[0].t_ns) * S_PER_NS, newest)
            case Health():
                flight = flight._replace(health=record)
            case SimStatus():
                flight = flight._replace(status=record)
                if record.finished and finished_at is None:
                    finished_at = time.monotonic()
    return flight


def _health_wait(flight: DemoFlight) -> float:
    """Seconds to wait for the health that counts the last images: it comes once a second."""
    return 0.0 if flight.health is None else 1.2


def _note_latency(flight: DemoFlight, received: PublishedRecord) -> None:
    estimate: Estimate = received.record
    health, report = flight.health, estimate.measurement
    if report is None or received.t_publish_ns is None:
        return
    flight.own_ms.append((received.t_publish_ns - report.t_recv_ns) * 1e-6)
    if health is not None and health.clock_offset_ns is not None:
        exposed_ns = report.t_ns + health.clock_offset_ns
        flight.to_publish_ms.append((received.t_publish_ns - exposed_ns) * 1e-6)


def _report(flight: DemoFlight, scenario: str, seed: int, duration: float) -> DemoReport:
    truth = reference_from_records(flight.truths)
    p50, p99 = percentiles(flight.to_publish_ms)
    own50, own99 = percentiles(flight.own_ms)
    verdicts = flight.health.verdicts.items() if flight.health else ()
    received = sum(count for name, count in verdicts if name.startswith("leader."))
    sent = flight.status.images if flight.status else 0
    numbers = [e.sequence for e in flight.estimates]
    missed = numbers[-1] - numbers[0] + 1 - len(numbers) if numbers else 0
    sinks = flight.health.sinks.values() if flight.health else ()
    return DemoReport(
        scenario=scenario,
        seed=seed,
        duration_s=duration,
        score=score_leader(flight.estimates, truth),
        latency_ms=Latency(p50=p50, p99=p99, receive_to_publish_p50=own50, receive_to_publish_p99=own99),
        drops=Drops(
            images_sent=sent,
            images_received=received,
            images_lost=sent - received,
            estimates_missed=missed,
            sink_drops=sum(s.dropped for s in sinks),
            skipped=0
            if flight.health is None
            else sum(n.skipped + n.dropped for n in flight.health.links.values()),
        ),
        own_state=score_own_state(flight.own_states, flight.truths),
        fault=score_fault(flight.own_states, flight.truths),
        beside={name: score_leader(estimates, truth) for name, estimates in flight.beside.items()},
    )
