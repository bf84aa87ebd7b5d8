"""The command line of simlink.

Its commands are `simlink list`, `simlink config`, `simlink run`, `simlink camera` and `simlink log`.
"""

import argparse
import asyncio
import math
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NoReturn

from msgspec.structs import replace

from simlink.encounters.encounter import Encounter
from simlink.encounters.others import GEOMETRY_NAMES, max_duration, recorded_encounter
from simlink.encounters.recording import SUFFIXES, LogError
from simlink.encounters.trajectory import read_trajectories
from simlink.encounters.truth import states
from simlink.log import TruthTables, write_log
from simlink.scenarios.camera import SEES
from simlink.scenarios.describe import daemon_config
from simlink.scenarios.scenario import Scenario, ScenarioError, check, load_scenario, scenario_names
from simlink.sensors.pictures import PictureError
from simlink.server.between import CameraBetween, CameraOptions
from simlink.server.links import LinkError
from simlink.server.server import Options, Server, serve
from simlink.world.truth import State

USER_ERROR = 2
SHOW = "(default: %(default)s)"
RECORDED = ("leader_from", "follower_from", "geometry")

RUN_EXAMPLES = """\
examples:
  simlink run formation                       for a daemon with its default configuration
  simlink run formation --wait 10             the flight begins when the daemon answers
  simlink run formation-s-turn --seed 7 --duration 60 --speed 4
  simlink run formation --camera mavlink --zenoh none
                                              image points as LANDING_TARGETs on udpout:127.0.0.1:14560
  simlink run my.toml --mavlink udpout:192.168.1.20:14540 --tcp none
  simlink run recorded --leader-from flight.bin --geometry orbit
                                              the leader flies a recorded flight

links:
  --mavlink   the autopilot's stream; commands and replies use the same socket
  --tcp       the same for ground stations: any number of clients, each with its own message rates
  --zenoh     onboard/VEHICLE/camera/front/points, simlink/VEHICLE/truth, simlink/VEHICLE/status
"""

CAMERA_EXAMPLES = """\
examples:
  simlink camera --follower tcp:127.0.0.1:5762 --leader tcp:127.0.0.1:5772
                                              two ArduPilots of sim_vehicle.py, instances 0 and 1
  simlink camera --follower udpin:127.0.0.1:14541 --leader udpin:127.0.0.1:14542
                                              two PX4s that send to these ports
  simlink camera my.toml --follower ... --leader ... --truth truth.csv.gz
                                              camera, noise, misses, delay and the leader's size of my.toml

Both autopilots must be simulated: the camera is computed from ArduPilot's SIM_STATE or PX4's HIL_STATE_QUATERNION,
which are requested. `simlink config SCENARIO` prints the daemon's configuration for the same camera.
"""

LOG_EXAMPLES = """\
examples:
  simlink log formation --seed 7 --out flight.tlog --truth truth.csv.gz
  simlink log recorded --leader-from flight.ulg --follower-from other.bin --out flight.tlog --truth truth.csv.gz

The same scenario and seed, and the same logs, always give the same bytes.
"""


class _Parser(argparse.ArgumentParser):
    """A parser that reports a usage error on one line instead of a page of usage."""

    def error(self, message: str) -> NoReturn:
        self.exit(USER_ERROR, f"{self.prog}: {message} (see {self.prog} --help)\n")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line.

    The exit code is 0, 1 if a file could not be written, or 2 after a usage error.
    """
    arguments = parser().parse_args(argv)
    command: Callable[[argparse.Namespace], int] = arguments.command
    try:
        return command(arguments)
    except (ScenarioError, LinkError, PictureError, LogError) as error:
        print(f"simlink: {error}", file=sys.stderr)
        return USER_ERROR
    except KeyboardInterrupt:
        return 130


def _list(_: argparse.Namespace) -> int:
    scenarios = [load_scenario(name) for name in scenario_names()]
    width = max(len(s.name) for s in scenarios)
    for s in scenarios:
        print(f"{s.name:{width}}  {s.duration:4g} s  {s.description}")
    return 0


def _config(a: argparse.Namespace) -> int:
    print(daemon_config(load_scenario(a.scenario)))
    return 0


def _run(a: argparse.Namespace) -> int:
    apart = ("command", "scenario", *RECORDED)
    given = {key: value for key, value in vars(a).items() if key not in apart}
    scenario, world = load_scenario(a.scenario), None
    if (encounter := _make_encounter(a, scenario, math.inf)) is not None:
        scenario, world = encounter.scenario, states(encounter.truth)
    options = Options(scenario=scenario, **given)
    asyncio.run(serve(Server(options, time.monotonic, time.time_ns(), _report, world)))
    return 0


def _make_encounter(a: argparse.Namespace, scenario: Scenario, seconds: float) -> Encounter | None:
    """Return the encounter with a recorded leader, or None without `--leader-from`.

    It lasts `seconds`, or as long as the recorded flight. Raises LogError and ScenarioError.
    """
    if a.leader_from is None:
        for name in RECORDED[1:]:
            if getattr(a, name) is not None:
                raise ScenarioError(f"--{name.replace('_', '-')} needs --leader-from LOG")
        return None
    if scenario.follow is not None:
        raise ScenarioError(
            f"{scenario.name}: [follow] excludes --leader-from; choose a scenario without [follow]"
        )
    flights = [read_trajectories(path)[0] for path in (a.leader_from, a.follower_from) if path is not None]
    leader, follower = flights[0], flights[1] if len(flights) > 1 else None
    geometry = a.geometry or GEOMETRY_NAMES[0]
    wanted = seconds if a.duration is None else a.duration
    if a.duration is None:
        wanted = min(wanted, max_duration(geometry, flights))
    encounter = recorded_encounter(scenario, a.seed, leader, geometry, wanted, follower=follower)
    mount = list(encounter.scenario.camera.mount_rpy_deg)
    _report(f"{encounter.family}: {wanted:.0f} s; camera.mount_rpy_deg={mount}, class {encounter.leader_class}")
    return encounter


def _camera(a: argparse.Namespace) -> int:
    given = vars(a).copy()
    scenario, truth, state = load_scenario(given.pop("scenario")), given.pop("truth"), given.pop("state")
    del given["command"]
    if (sees := given.pop("sees")) is not None:
        scenario = replace(scenario, camera=replace(scenario.camera, sees=sees))
        check(scenario, "--sees")
    try:
        with TruthTables(truth, state) as tables:
            options = CameraOptions(scenario=scenario, **given)
            asyncio.run(serve(CameraBetween(options, time.monotonic_ns, _report, tables.write)))
    except OSError as error:
        return _cannot_write(error)
    return 0


def _log(a: argparse.Namespace) -> int:
    scenario = load_scenario(a.scenario)
    duration, world = scenario.duration if a.duration is None else a.duration, None
    if (encounter := _make_encounter(a, scenario, duration)) is not None:
        scenario, world = encounter.scenario, states(encounter.truth)
        duration = float(encounter.truth.t[-1])
    try:
        frames, rows = _write_log(a, scenario, duration, world)
    except OSError as error:
        return _cannot_write(error)
    _report(f"{a.out}: {frames} frames, {duration:g} s; {a.truth or 'no truth file'}: {rows} rows")
    return 0


def _cannot_write(error: OSError) -> int:
    print(f"simlink: cannot write {error.filename or 'its files'}: {error.strerror}", file=sys.stderr)
    return 1


def _write_log(
    a: argparse.Namespace, scenario: Scenario, duration: float, world: Iterator[State] | None
) -> tuple[int, int]:
    """Write the files, with a progress bar on a terminal."""
    if not sys.stderr.isatty():
        return write_log(scenario, a.seed, duration, a.out, a.truth, a.state, world=world)
    from rich.console import Console  # noqa: PLC0415  # needed on a terminal only
    from rich.progress import Progress  # noqa: PLC0415  # as above

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(scenario.name, total=duration)
        progress = lambda done: bar.update(task, completed=done)  # noqa: E731
        return write_log(scenario, a.seed, duration, a.out, a.truth, a.state, progress, world)


def _report(line: str) -> None:
    with suppress(OSError):  # a closed stderr must not end the flight
        print(f"simlink: {line}", file=sys.stderr, flush=True)


def _positive(text: str) -> float:
    value = _number(text)
    if not value > 0:
        raise argparse.ArgumentTypeError(f"must be above zero, not {text!r}")
    return value


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value >= 0):
        raise argparse.ArgumentTypeError(f"must be a number not below zero, not {text!r}")
    return value


def _seed(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"must be a whole number not below zero, not {text!r}")
    return int(text)


def _port(text: str) -> int | None:
    if text == "none":
        return None
    if not text.isdecimal() or int(text) > 65535:
        raise argparse.ArgumentTypeError(f"must be 0 (any free port) to 65535, or none, not {text!r}")
    return int(text)


def _or_none(text: str) -> str | None:
    return None if text == "none" else text


def parser() -> argparse.ArgumentParser:
    """Return the parser of all commands, with the function to call as `command`."""
    top = _Parser(
        prog="simlink",
        description="Simulate a flight: an autopilot's MAVLink stream, a camera's image points of the aircraft "
        "ahead, and the truth to compare estimates with.",
        epilog="`simlink COMMAND --help` shows options and examples. Try: simlink run formation --wait 10",
    )
    commands = top.add_subparsers(required=True, metavar="COMMAND")
    listing = commands.add_parser("list", help="list the scenarios that come with simlink")
    listing.set_defaults(command=_list)
    config = commands.add_parser("config", help="print the daemon's configuration for a scenario")
    config.add_argument("scenario", metavar="SCENARIO", help="a name from `simlink list`, or a .toml file")
    config.set_defaults(command=_config)
    _add_run(
        commands.add_parser(
            "run",
            help="fly in real time over network links",
            epilog=RUN_EXAMPLES,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
    )
    _add_camera(
        commands.add_parser(
            "camera",
            help="simulate the camera between two simulated autopilots",
            epilog=CAMERA_EXAMPLES,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
    )
    _add_log(
        commands.add_parser(
            "log",
            help="fly as fast as possible and write the flight to files",
            epilog=LOG_EXAMPLES,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
    )
    return top


def _add_scenario(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scenario", metavar="SCENARIO", help="a name from `simlink list`, or a .toml file")
    _add_seed(parser)


def _add_seed(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--seed", type=_seed, default=1, metavar="N", help=f"seed of all random numbers, a whole number {SHOW}"
    )


def _add_run(parser: argparse.ArgumentParser) -> None:
    _add_scenario(parser)
    add = parser.add_argument
    add(
        "--speed",
        type=_positive,
        default=1.0,
        metavar="N",
        help=f"speed of the simulation, in multiples of real time {SHOW}",
    )
    wait = f"send heartbeats only until a peer answers, for at most S seconds {SHOW}"
    add("--wait", type=_number, default=0.0, metavar="S", help=wait)
    mavlink = f"link of the autopilot: udpout:HOST:PORT, udpin:HOST:PORT or none {SHOW}"
    add("--mavlink", type=_or_none, default="udpout:127.0.0.1:14540", metavar="SPEC", help=mavlink)
    tcp = f"TCP port on 127.0.0.1 for ground stations, 0 for any free port, or none {SHOW}"
    add("--tcp", dest="tcp_port", type=_port, default=5760, metavar="PORT", help=tcp)
    _add_outlet(parser)
    _add_recorded(parser)
    parser.set_defaults(command=_run)


def _add_camera(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    what = f"scenario with [camera] and [leader]: a name from `simlink list`, or a .toml file {SHOW}"
    add("scenario", metavar="SCENARIO", nargs="?", default="sitl", help=what)
    _add_seed(parser)
    link = "MAVLink of the vehicle {}: tcp:HOST:PORT, udpin:HOST:PORT or udpout:HOST:PORT"
    add("--follower", required=True, metavar="URL", help=link.format("with the camera"))
    add("--leader", required=True, metavar="URL", help=link.format("that it sees"))
    add("--sees", choices=SEES, help="the detector's output (default: that of the scenario)")
    _add_outlet(parser)
    _add_truth(parser)
    parser.set_defaults(command=_camera)


def _add_outlet(parser: argparse.ArgumentParser) -> None:
    """Add the options for the destinations of images and truth, and for the duration."""
    add = parser.add_argument
    add("--duration", type=_positive, metavar="S", help="length of the flight, s (default: until stopped)")
    cameras = ("zenoh", "mavlink", "both", "none")
    add("--camera", choices=cameras, default="zenoh", help=f"where image points are sent {SHOW}")
    points = f"separate link for image points as LANDING_TARGETs {SHOW}"
    add("--camera-mavlink", default="udpout:127.0.0.1:14560", metavar="SPEC", help=points)
    zenoh = f"Zenoh router to connect to, or none {SHOW}"
    add("--zenoh", type=_or_none, default="tcp/127.0.0.1:7447", metavar="ENDPOINT", help=zenoh)
    add("--vehicle", default="1", metavar="ID", help=f"vehicle id in the Zenoh keys {SHOW}")


def _add_log(parser: argparse.ArgumentParser) -> None:
    _add_scenario(parser)
    add = parser.add_argument
    add("--out", type=Path, required=True, metavar="FILE.tlog", help="the recording: all MAVLink frames")
    _add_truth(parser)
    add("--duration", type=_positive, metavar="S", help="length of the flight, s (default: the scenario's)")
    _add_recorded(parser)
    parser.set_defaults(command=_log)


def _add_recorded(parser: argparse.ArgumentParser) -> None:
    """Add the options that replace drawn flights by recorded ones."""
    add = parser.add_argument
    kinds = ", ".join(SUFFIXES)
    leader = f"log ({kinds}) that the leader flies: its longest stretch without gaps"
    add("--leader-from", type=Path, metavar="LOG", help=leader)
    add(
        "--follower-from",
        type=Path,
        metavar="LOG",
        help="log from which our vehicle takes its sway and its attitude",
    )
    where = (
        f"our position relative to a recorded leader: {', '.join(GEOMETRY_NAMES)} (default: {GEOMETRY_NAMES[0]})"
    )
    add("--geometry", choices=GEOMETRY_NAMES, metavar="NAME", help=where)


def _add_truth(parser: argparse.ArgumentParser) -> None:
    truth = "truth of the leader at image times; compressed if named .gz"
    parser.add_argument("--truth", type=Path, metavar="FILE.csv", help=truth)
    state = "truth of our own vehicle at the same times"
    parser.add_argument("--state", type=Path, metavar="FILE.csv", help=state)
