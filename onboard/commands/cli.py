"""The command line: `onboard run`, `demo`, `replay`, `view`, `study`, `schema`, `compile`.

A user's mistake is one line.

Each command imports what it needs when it runs, so that `--help` is quick and a replay loads no Zenoh.
"""

import argparse
import asyncio
import math
import os
import signal
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NoReturn

from onboard import __version__
from onboard.commands.loading import loading
from onboard.errors import UserError

if TYPE_CHECKING:
    from onboard.commands.compiling import Module

USER_ERROR: Final = 2
DEFAULT_ENDPOINT: Final = "tcp/127.0.0.1:7447"

EXAMPLES: Final = """\
examples:
  onboard demo                                   a simulated formation flight, the live view, a scorecard
  onboard demo --headless --duration 60 --seed 1 --json score.json
  onboard run configs/companion.toml             fly
  onboard replay flight.tlog --out estimates.csv --truth truth.csv.gz --set camera.mount_rpy_deg=[0,15,0]
  onboard view                                   watch a daemon that runs on this computer
  onboard study relative-motion                  the paper's filter against ours, with its figures
"""
RUN: Final = """\
examples:
  onboard run                            a simulated flight: simlink run formation --wait 15
  onboard run configs/companion.toml     fly
  onboard run --set recorder.path=flight.mcap --set zenoh.vehicle=uav-2

Ctrl-C or SIGTERM stops it. Watch it with: onboard view
"""
DEMO: Final = """\
examples:
  onboard demo
  onboard demo --headless --duration 60 --seed 1 --json score.json
  onboard demo --scenario formation-out-of-view --set estimator.leader.noise=paper

DIR gets the view (.rrd), the configuration used (.toml) and what both programs said (.log).
Exit code 1: the estimate diverged.
"""
REPLAY: Final = """\
examples:
  onboard replay flight.tlog --out estimates.csv --set camera.mount_rpy_deg=[0,15,0]
  onboard replay flight.mcap --config companion.toml --rrd flight.rrd
  simlink log formation --out f.tlog --truth f.csv && simlink config formation > f.toml &&
      onboard replay f.tlog --config f.toml --truth f.csv
"""
VIEW: Final = """\
examples:
  onboard view                                            of a daemon on this computer
  onboard view --connect tcp/192.168.1.20:7447 --rrd flight.rrd
  onboard view out/formation-1.rrd
  onboard view out/formation-1.rrd --png view.png --at 60
"""
STUDY: Final = """\
examples:
  onboard study relative-motion --seeds 10                writes report, numbers and figures to out/studies
  onboard study --all --json study.json
"""
SCHEMA: Final = """\
example:
  onboard schema --json > schema.json
"""
COMPILE: Final = """\
examples:
  onboard compile                        everything
  onboard compile companion.toml         what a flight with this configuration needs, which is much less

Estimating is done by machine code that is made on each computer once, on all cores, in half a minute to some
minutes, and again after an update. `onboard demo` makes what it needs; do it before you fly.

The code is kept beside the sources (__pycache__). Where that folder cannot be written to, Numba keeps it in the
user's cache folder (~/.cache/numba on Linux), so run this as the user who flies; NUMBA_CACHE_DIR names another.
"""
SET_HELP: Final = "put configuration keys over the file's, as camera.f_px=600 (one or more, repeatable)"


class _Parser(argparse.ArgumentParser):
    """A mistake in the call is one line, not a page of usage."""

    def error(self, message: str) -> NoReturn:
        self.exit(USER_ERROR, f"{self.prog}: {message} (see {self.prog} --help)\n")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line. Exit codes: 0 done, 1 it ran and failed, 2 the call or a file was at fault."""
    arguments = _parser().parse_args(_spread_sets(sys.argv[1:] if argv is None else argv))
    command: Callable[[argparse.Namespace], int] = arguments.command
    try:
        return command(arguments)
    except UserError as error:
        print(f"onboard: {error}", file=sys.stderr)
        return USER_ERROR
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:  # the reader of our output has gone
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # or Python complains when it flushes
        return 0


def _run(a: argparse.Namespace) -> int:
    with loading():
        from onboard.config import load_config  # noqa: PLC0415
        from onboard.daemon import Daemon  # noqa: PLC0415

        config = load_config(a.config, tuple(a.set))
        daemon = Daemon(config, now_ns=time.time_ns, say=_say)
    asyncio.run(daemon.run())
    return 0


def _demo(a: argparse.Namespace) -> int:
    from onboard.commands.reporting import demo  # noqa: PLC0415

    _end_as_if_interrupted()
    return demo(
        scenario=a.scenario,
        seed=a.seed,
        duration=a.duration,
        headless=a.headless,
        directory=a.out,
        json_file=a.json,
        overrides=tuple(a.set),
    )


def _replay(a: argparse.Namespace) -> int:
    from onboard.commands.reporting import replay_log  # noqa: PLC0415
    from onboard.config import load_config  # noqa: PLC0415

    config = load_config(a.config, tuple(a.set))
    return replay_log(a.log, config, out=a.out, truth=a.truth, json_file=a.json, rrd=a.rrd, own=a.own)


def _view(a: argparse.Namespace) -> int:
    from onboard.commands.view import open_recording, watch  # noqa: PLC0415

    _end_as_if_interrupted()
    if a.recording is not None:
        return open_recording(a.recording, png=a.png, at=a.at)
    return watch(a.connect, a.vehicle, rrd=a.rrd, overrides=tuple(a.set), say=_say)


def _study(a: argparse.Namespace) -> int:
    from onboard.commands.reporting import all_studies, study, study_names  # noqa: PLC0415

    if a.all and a.name is None:
        return all_studies(seeds=a.seeds, out=a.out, json_file=a.json)
    if a.all or a.name is None:
        raise UserError(f"study: give --all, or one name of: {', '.join(study_names())}")
    return study(a.name, seeds=a.seeds, out=a.out, json_file=a.json)


def _schema(a: argparse.Namespace) -> int:
    from onboard.messages import schemas  # noqa: PLC0415

    if a.json:
        import msgspec  # noqa: PLC0415

        print(msgspec.json.format(msgspec.json.encode(schemas.schemas())).decode())
    else:
        print(schemas.describe())
    return 0


def _compile(a: argparse.Namespace) -> int:
    from rich.console import Console  # noqa: PLC0415

    from onboard.commands.compiling import needed_by_flight  # noqa: PLC0415
    from onboard.commands.progress import compile_shown  # noqa: PLC0415
    from onboard.config import named_estimators, parse_config, read_table  # noqa: PLC0415

    _end_as_if_interrupted()
    start = time.perf_counter()
    table = read_table(a.config, tuple(a.set)) if a.config is not None or a.set else None

    def tell(module: "Module") -> None:
        there = f", {module.loaded} there already" if module.loaded else ""
        print(f"{module.name:40}{module.seconds:6.1f} s  {module.compiled} compiled{there}", flush=True)

    begun = None if table is None else needed_by_flight(named_estimators(table))
    modules = compile_shown(begun, Console(stderr=True), tell)
    if table is not None:
        parse_config(table)  # its mistakes are better told of now than before the flight
    folder = os.path.commonpath([module.folder for module in modules])
    print(f"ready in {time.perf_counter() - start:.1f} s; kept in {folder}")
    return 0


def _end_as_if_interrupted() -> None:
    """Let SIGTERM and a closed terminal stop what we have started, as Ctrl-C does."""
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.default_int_handler)


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


# ------------------------------------------------------------------------------------------ the parser


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="onboard",
        description="Where is the other aircraft? Relative motion from MAVLink and a camera's points.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"wingline {__version__}")
    commands = parser.add_subparsers(metavar="COMMAND", required=True, parser_class=_Parser)

    run = commands.add_parser("run", help="run the daemon", **_explained(RUN))
    run.add_argument("config", nargs="?", type=Path, help="TOML file (none: simlink's ports on this computer)")
    _add_set(run)
    run.set_defaults(command=_run)

    demo = commands.add_parser(
        "demo", help="simulator, daemon and view together, and a scorecard", **_explained(DEMO)
    )
    demo.add_argument("--scenario", default="formation", help="see `simlink list` (default: %(default)s)")
    demo.add_argument("--seed", type=_count, default=1, metavar="N", help="(default: %(default)s)")
    demo.add_argument("--duration", type=_seconds, default=60.0, metavar="S", help="s (default: %(default)s)")
    demo.add_argument("--headless", action="store_true", help="no window: only write the recording (.rrd)")
    demo.add_argument("--out", type=Path, default=Path("out"), metavar="DIR", help="(default: %(default)s)")
    demo.add_argument("--json", type=Path, metavar="FILE", help="write the scorecard's numbers here as well")
    _add_set(demo)
    demo.set_defaults(command=_demo)

    replay = commands.add_parser(
        "replay", help="a recorded flight through the same pipeline", **_explained(REPLAY)
    )
    replay.add_argument("log", type=Path, help=".tlog, PX4 .ulg, or .mcap recorded by `onboard run`")
    replay.add_argument("--out", type=Path, metavar="FILE.csv", help="one row per estimate; columns carry units")
    replay.add_argument("--own", type=Path, metavar="FILE.csv", help="the same of [estimator.own_state]")
    replay.add_argument("--config", type=Path, metavar="C", help="TOML file")
    replay.add_argument("--truth", type=Path, metavar="FILE.csv[.gz]", help="score against it")
    replay.add_argument("--json", type=Path, metavar="FILE", help="write the summary's numbers here as well")
    replay.add_argument("--rrd", type=Path, metavar="FILE.rrd", help="write the view as a Rerun recording")
    _add_set(replay)
    replay.set_defaults(command=_replay)

    view = commands.add_parser("view", help="watch a running daemon, or open a recorded view", **_explained(VIEW))
    view.add_argument("recording", nargs="?", type=Path, help=".rrd to open instead of a running daemon")
    view.add_argument("--png", type=Path, help="with a recording: draw it to a picture, without a screen")
    view.add_argument("--at", type=_seconds, metavar="S", help="with --png: the time shown, s since boot")
    view.add_argument("--connect", default=DEFAULT_ENDPOINT, help="the daemon's Zenoh (default: %(default)s)")
    view.add_argument("--vehicle", default="1", help="its vehicle id (default: %(default)s)")
    view.add_argument("--rrd", type=Path, help="record what is watched")
    _add_set(view)
    view.set_defaults(command=_view)

    study = commands.add_parser("study", help="a paper's claims, measured", **_explained(STUDY))
    study.add_argument("name", nargs="?", help="the paper, by its name in onboard/studies")
    study.add_argument("--all", action="store_true", help="every paper, two at a time")
    study.add_argument("--seeds", type=_positive, metavar="N", help="(default: what the study needs)")
    study.add_argument(
        "--out", type=Path, default=Path("out/studies"), metavar="DIR", help="(default: %(default)s)"
    )
    study.add_argument("--json", type=Path, metavar="FILE", help="write the numbers here as well")
    study.set_defaults(command=_study)

    schema = commands.add_parser("schema", help="what is published: keys, records, types", **_explained(SCHEMA))
    schema.add_argument("--json", action="store_true", help="as JSON Schema")
    schema.set_defaults(command=_schema)

    ahead = commands.add_parser(
        "compile", help="compile the filters before the first flight", **_explained(COMPILE)
    )
    ahead.add_argument("config", nargs="?", type=Path, help="TOML file: only what it flies with (none: all)")
    _add_set(ahead)
    ahead.set_defaults(command=_compile)
    return parser


def _explained(text: str) -> dict[str, Any]:
    """Arguments of a parser whose help ends with `text` as it stands."""
    return {"epilog": text, "formatter_class": argparse.RawDescriptionHelpFormatter}


def _spread_sets(argv: Sequence[str]) -> list[str]:
    """`--set A=1 B=2` as `--set A=1 --set B=2`; what does not look like KEY=VALUE ends the row."""
    spread: list[str] = []
    in_row = False
    for word in argv:
        if word.startswith("-"):
            in_row = word == "--set"
        elif in_row and spread[-1] != "--set":
            in_row = "=" in word
            spread += ["--set"] if in_row else []
        spread.append(word)
    return spread


def _add_set(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help=SET_HELP)


def _count(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"must be a whole number not below zero, not {text!r}")
    return int(text)


def _positive(text: str) -> int:
    if _count(text) == 0:
        raise argparse.ArgumentTypeError("must be at least 1")
    return int(text)


def _seconds(text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not 0 < number < 1e7:
        raise argparse.ArgumentTypeError(f"must be a positive number of seconds, not {text!r}")
    return number
