"""The command line: `onboard run`, `demo`, `replay`, `view`, `study`, `schema`. A user's mistake is one line.

Each command imports what it needs when it runs, so that `--help` is quick and a replay loads no Zenoh.
"""

import argparse
import asyncio
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final, NoReturn

from onboard import __version__
from onboard.errors import UserError

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
SET_HELP: Final = "put one configuration key over the file's, as camera.f_px=600 (repeatable)"


class _Parser(argparse.ArgumentParser):
    """A mistake in the call is one line, not a page of usage."""

    def error(self, message: str) -> NoReturn:
        self.exit(USER_ERROR, f"{self.prog}: {message} (see {self.prog} --help)\n")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line. Exit codes: 0 done, 1 it ran and failed, 2 the call or a file was at fault."""
    arguments = _parser().parse_args(argv)
    command: Callable[[argparse.Namespace], int] = arguments.command
    try:
        return command(arguments)
    except UserError as error:
        print(f"onboard: {error}", file=sys.stderr)
        return USER_ERROR
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:
        return 0  # the reader of our output has gone


def _run(a: argparse.Namespace) -> int:
    from onboard.config import load_config  # noqa: PLC0415
    from onboard.daemon import Daemon  # noqa: PLC0415

    config = load_config(a.config, tuple(a.set))
    daemon = Daemon(config, now_ns=time.time_ns, say=_say)
    asyncio.run(daemon.run())
    return 0


def _demo(a: argparse.Namespace) -> int:
    from onboard.reporting import demo  # noqa: PLC0415

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
    from onboard.config import load_config  # noqa: PLC0415
    from onboard.reporting import replay_log  # noqa: PLC0415

    config = load_config(a.config, tuple(a.set))
    return replay_log(a.log, config, out=a.out, truth=a.truth, json_file=a.json, rrd=a.rrd)


def _view(a: argparse.Namespace) -> int:
    from onboard.watching import open_recording, watch  # noqa: PLC0415

    if a.recording is not None:
        return open_recording(a.recording, png=a.png, at=a.at)
    return watch(a.connect, a.vehicle, rrd=a.rrd, overrides=tuple(a.set), say=_say)


def _study(a: argparse.Namespace) -> int:
    from onboard.reporting import study  # noqa: PLC0415

    return study(a.name, seeds=a.seeds, out=a.out, json_file=a.json)


def _schema(a: argparse.Namespace) -> int:
    from onboard import schemas  # noqa: PLC0415

    if a.json:
        import msgspec  # noqa: PLC0415

        print(msgspec.json.format(msgspec.json.encode(schemas.schemas())).decode())
    else:
        print(schemas.describe())
    return 0


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

    run = commands.add_parser("run", help="run the daemon")
    run.add_argument("config", nargs="?", type=Path, help="TOML file (none: simlink's ports on this computer)")
    _add_set(run)
    run.set_defaults(command=_run)

    demo = commands.add_parser("demo", help="simulator, daemon and view together, and a scorecard")
    demo.add_argument("--scenario", default="formation", help="see `simlink list` (default: %(default)s)")
    demo.add_argument("--seed", type=_count, default=1, metavar="N", help="(default: %(default)s)")
    demo.add_argument("--duration", type=_seconds, default=60.0, metavar="S", help="s (default: %(default)s)")
    demo.add_argument("--headless", action="store_true", help="no window: only write the recording (.rrd)")
    demo.add_argument("--out", type=Path, default=Path("out"), metavar="DIR", help="(default: %(default)s)")
    demo.add_argument("--json", type=Path, metavar="FILE", help="write the scorecard's numbers here as well")
    _add_set(demo)
    demo.set_defaults(command=_demo)

    replay = commands.add_parser("replay", help="a recorded flight through the same pipeline")
    replay.add_argument("log", type=Path, help=".tlog, or .mcap recorded by `onboard run`")
    replay.add_argument("--out", type=Path, metavar="FILE.csv", help="one row per estimate; columns carry units")
    replay.add_argument("--config", type=Path, metavar="C", help="TOML file")
    replay.add_argument("--truth", type=Path, metavar="FILE.csv[.gz]", help="score against it")
    replay.add_argument("--json", type=Path, metavar="FILE", help="write the summary's numbers here as well")
    replay.add_argument("--rrd", type=Path, metavar="FILE.rrd", help="write the view as a Rerun recording")
    _add_set(replay)
    replay.set_defaults(command=_replay)

    view = commands.add_parser("view", help="watch a running daemon, or open a recorded view")
    view.add_argument("recording", nargs="?", type=Path, help=".rrd to open instead of a running daemon")
    view.add_argument("--png", type=Path, help="with a recording: draw it to a picture, without a screen")
    view.add_argument("--at", type=_seconds, metavar="S", help="with --png: the time shown, s since boot")
    view.add_argument("--connect", default=DEFAULT_ENDPOINT, help="the daemon's Zenoh (default: %(default)s)")
    view.add_argument("--vehicle", default="1", help="its vehicle id (default: %(default)s)")
    view.add_argument("--rrd", type=Path, help="record what is watched")
    _add_set(view)
    view.set_defaults(command=_view)

    study = commands.add_parser("study", help="a paper's claims, measured")
    study.add_argument("name", help="relative-motion")
    study.add_argument("--seeds", type=_count, default=50, metavar="N", help="(default: %(default)s)")
    study.add_argument(
        "--out", type=Path, default=Path("out/studies"), metavar="DIR", help="(default: %(default)s)"
    )
    study.add_argument("--json", type=Path, metavar="FILE", help="write the numbers here as well")
    study.set_defaults(command=_study)

    schema = commands.add_parser("schema", help="what is published: keys, records, types")
    schema.add_argument("--json", action="store_true", help="as JSON Schema")
    schema.set_defaults(command=_schema)
    return parser


def _add_set(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help=SET_HELP)


def _count(text: str) -> int:
    number = int(text)
    if number < 0:
        raise argparse.ArgumentTypeError("must not be negative")
    return number


def _seconds(text: str) -> float:
    number = float(text)
    if not 0 < number < 1e7:
        raise argparse.ArgumentTypeError("must be a positive number of seconds")
    return number
