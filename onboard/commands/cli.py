"""The command line: `onboard init`, `check`, `run`, `demo`, `replay`, `report`, `evaluate`, `calibrate`, `router`,
`recover`, `view`, `status`, `ros2`, `study`, `schema`, `completion`.

A user's mistake is one line. Each command is a file of this folder with a function `main`. It is imported when it
runs, so that `--help` is quick and a replay loads no Zenoh.
"""

import argparse
import errno
import math
import os
import signal
import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from typing import Final, NoReturn

from onboard import UserError, __version__
from onboard.commands import examples
from onboard.commands.share import TOGETHER
from onboard.terminal.output import end_signals, one_line, report

USER_ERROR: Final = 2
SET_HELP: Final = "put configuration keys over the file's, as camera.f_px=600 (one or more, repeatable)"
LOG_FORMATS: Final = (
    ".tlog, ArduPilot .bin, PX4 .ulg, .mcap recorded by `onboard run`, or a folder with one of them and a "
    "detector's .jsonl"
)
MAX_SEED_COUNT: Final = 1_000_000
DISK_FAULTS: Final = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EIO)
STARTS_PROCESSES: Final = ("demo", "evaluate", "replay", "study", "view")


class _Parser(argparse.ArgumentParser):
    """A mistake in the call is one line, not a page of usage."""

    def error(self, message: str) -> NoReturn:
        self.exit(USER_ERROR, f"{one_line(f'{self.prog}: {message} (see {self.prog} --help)')}\n")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line. Exit codes: 0 done, 1 it ran and failed, 2 the call or a file was at fault."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy loads it: its threads wait in busy loops
    arguments = parser().parse_args(_spread_sets(sys.argv[1:] if argv is None else argv))
    if arguments.command in STARTS_PROCESSES:
        _end_as_if_interrupted()
    try:
        command: Callable[[argparse.Namespace], int] = import_module(f"onboard.commands.{arguments.command}").main
        return command(arguments)
    except UserError as error:
        report(f"onboard: {error}")
        return USER_ERROR
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:  # the reader of our output has gone
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # or Python complains when it flushes
        return 0
    except OSError as error:
        if error.errno not in DISK_FAULTS:
            raise
        report(f"onboard: cannot read or write {error.filename or 'a file'}: {error.strerror}")
        return USER_ERROR


def _end_as_if_interrupted() -> None:
    """Let SIGTERM and a closed terminal stop the processes that a command has started, as Ctrl-C does."""
    for number in {*end_signals()} - {signal.SIGINT}:  # Ctrl-C itself may be ignored, as in a script's background
        signal.signal(number, signal.default_int_handler)


def parser() -> argparse.ArgumentParser:
    """The parser of all commands; `command` of the parsed arguments is the command's name."""
    top = _Parser(
        prog="onboard",
        description="Where is the other aircraft? Relative motion from MAVLink and a camera's points.",
        epilog=examples.OVERVIEW,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    top.add_argument("--version", action="version", version=f"wingline {__version__}")
    commands = top.add_subparsers(metavar="COMMAND", dest="command", required=True, parser_class=_Parser)

    def add(name: str, text: str, epilog: str) -> argparse.ArgumentParser:
        return commands.add_parser(
            name, help=text, epilog=epilog, formatter_class=argparse.RawDescriptionHelpFormatter
        )

    _add_init(add("init", "write a configuration, a service and autopilot parameters", examples.INIT))
    _add_check(add("check", "preflight check: filters, links, rates, camera, clock, disk", examples.CHECK))
    _add_run(add("run", "run the daemon", examples.RUN))
    _add_demo(add("demo", "simulator, daemon and live view, then a scorecard", examples.DEMO))
    _add_replay(add("replay", "replay a recorded flight through the same pipeline", examples.REPLAY))
    _add_report(add("report", "summarise a flight on one page, with a verdict", examples.REPORT))
    _add_evaluate(add("evaluate", "score filters on a folder of flights with truth", examples.EVALUATE))
    _add_calibrate(add("calibrate", "calibrate a camera or the airframe from one flight", examples.CALIBRATE))
    router = add("router", "run the Zenoh router of a fleet", examples.ROUTER)
    router.add_argument("config", type=Path, help="TOML file with a section [router]")
    _add_set(router)
    _add_recover(add("recover", "repair the recording of a killed daemon for other programs", examples.RECOVER))
    _add_view(add("view", "watch a running daemon, or open a recording", examples.VIEW))
    _add_status(add("status", "what a daemon receives, what is wrong, and what to do", examples.STATUS))
    _add_ros2(add("ros2", "run a ROS 2 node beside a daemon", examples.ROS2))
    _add_study(add("study", "measure a paper's claims", examples.STUDY))
    schema = add("schema", "print the published keys, records and types", examples.SCHEMA)
    schema.add_argument("--json", action="store_true", help="as JSON Schema")
    add("completion", "print a shell completion script", examples.COMPLETION)
    return top


def _add_init(init: argparse.ArgumentParser) -> None:
    init.add_argument("folder", nargs="?", type=Path, default=Path(), metavar="DIR", help="(default: this folder)")
    init.add_argument("--autopilot", choices=["ardupilot", "px4"], help="whose parameters are written")
    init.add_argument("--link", metavar="URL", help="to it (default: serial:/dev/ttyAMA0:921600)")
    camera = "WIDTHxHEIGHT:FOCAL (px), WIDTHxHEIGHT:FOVdeg, or FILE.yaml, a camera_info of ROS"
    init.add_argument("--camera", help=camera)
    init.add_argument("--tilt", metavar="DEG", help="by how much the camera looks up (default: 15)")
    aircraft = "what the leader is (default: quadrotor)"
    kinds = ["quadrotor", "hexarotor", "octorotor", "fixed-wing"]
    init.add_argument("--aircraft", choices=kinds, help=aircraft)
    init.add_argument("--span", metavar="M", help="the leader's: wingtip to wingtip, or over rotors and blades")
    init.add_argument("--vehicle", metavar="NAME", help="its name, which no other vehicle has (default: 1)")
    purpose = init.add_mutually_exclusive_group()
    follow, watch = "let the autopilot follow the leader", "send the autopilot nothing of the leader"
    purpose.add_argument("--follow", dest="purpose", action="store_const", const="follow", help=follow)
    purpose.add_argument("--watch", dest="purpose", action="store_const", const="watch", help=watch)
    init.add_argument("--example", choices=[*TOGETHER], help="copy these files instead")
    init.add_argument("--force", action="store_true", help="write over files that are there")


def _add_check(check: argparse.ArgumentParser) -> None:
    check.add_argument("config", nargs="?", type=Path, help="TOML file of the flight")
    wait = "how long to listen at most, s (default: %(default)s)"
    check.add_argument("--wait", type=_seconds, default=15.0, metavar="S", help=wait)
    _add_set(check)


def _add_run(run: argparse.ArgumentParser) -> None:
    run.add_argument("config", nargs="?", type=Path, help="TOML file (none: simlink's ports on this computer)")
    _add_set(run)


def _add_demo(demo: argparse.ArgumentParser) -> None:
    demo.add_argument("--scenario", default="mission", help="see `simlink list` (default: %(default)s)")
    demo.add_argument("--seed", type=_count, default=1, metavar="N", help="(default: %(default)s)")
    demo.add_argument("--duration", type=_seconds, default=60.0, metavar="S", help="s (default: %(default)s)")
    found = "program that finds the leader in the pictures of scenario `pictures`, such as examples/contour.py"
    demo.add_argument("--detector", type=Path, metavar="FILE.py", help=found)
    beside = "another filter of the leader in the same flight: the paper's (Oh & Johnson)"
    demo.add_argument("--beside", choices=["paper"], help=beside)
    demo.add_argument("--headless", action="store_true", help="no window: only write the recording (.rrd)")
    demo.add_argument("--out", type=Path, default=Path("out"), metavar="DIR", help="(default: %(default)s)")
    demo.add_argument("--json", type=Path, metavar="FILE", help="write the scorecard's numbers here as well")
    _add_set(demo)


def _add_replay(replay: argparse.ArgumentParser) -> None:
    replay.add_argument("log", type=Path, nargs="+", help=f"{LOG_FORMATS}; of several, scores are printed")
    kinds = (
        "one row per estimate as .csv or .parquet, poses as .tum, .mcap for Foxglove, or .ros2: a bag (repeatable)"
    )
    replay.add_argument("--out", type=Path, action="append", default=[], metavar="FILE", help=kinds)
    own = "the same of [estimator.own_state], but .mcap and .ros2, which have all"
    replay.add_argument("--own", type=Path, action="append", default=[], metavar="FILE", help=own)
    replay.add_argument("--config", type=Path, metavar="C", help="TOML file")
    replay.add_argument("--truth", type=Path, metavar="FILE.csv[.gz]", help="score against it")
    replay.add_argument("--json", type=Path, metavar="FILE", help="write the summary's numbers here as well")
    replay.add_argument("--rrd", type=Path, metavar="FILE.rrd", help="write the view as a Rerun recording")
    compared = (
        "beside it: flown (the recording's own estimates), paper, a filter's name, or [NAME:]KEY=VALUE[;...]"
    )
    replay.add_argument("--compare", nargs="+", default=[], metavar="FILTER", help=compared)
    _add_computers(replay)
    _add_set(replay)


def _add_report(report: argparse.ArgumentParser) -> None:
    report.add_argument("log", type=Path, help=LOG_FORMATS)
    report.add_argument("--config", type=Path, metavar="C", help="TOML file")
    report.add_argument("--truth", type=Path, metavar="FILE.csv[.gz]", help="judge by it as well")
    report.add_argument(
        "--out", type=Path, metavar="FILE.html", help="(default: the log's name with -report.html)"
    )
    report.add_argument("--pdf", type=Path, metavar="FILE.pdf", help="write it as PDF as well")
    _add_set(report)


def _add_evaluate(evaluate: argparse.ArgumentParser) -> None:
    evaluate.add_argument("dataset", type=Path, help="folder with FAMILY/FLIGHT/: a log, detections, truth.csv")
    compared = (
        "what flies beside each flight's own configuration, as in `onboard replay` (default: paper filterpy)"
    )
    evaluate.add_argument("--compare", nargs="*", metavar="FILTER", help=compared)
    evaluate.add_argument("--json", type=Path, metavar="FILE", help="write rows and the flights' scores here")
    evaluate.add_argument(
        "--with",
        type=Path,
        nargs="+",
        default=[],
        metavar="FILE.json",
        help="add the rows of such files to the table",
    )
    _add_computers(evaluate)
    _add_set(evaluate)


def _add_calibrate(calibrate: argparse.ArgumentParser) -> None:
    calibrate.add_argument("log", type=Path, help=LOG_FORMATS)
    calibrate.add_argument("--config", type=Path, metavar="C", help="TOML file that was flown with")
    calibrate.add_argument("--camera", metavar="NAME", help="of several (default: the first)")
    calibrate.add_argument("--svg", type=Path, metavar="FILE.svg", help="draw the residuals")
    airframe = calibrate.add_argument_group("the airframe, instead of the camera")
    airframe.add_argument("--mass", type=float, metavar="KG", help="the vehicle's mass")
    airframe.add_argument("--rotors", metavar="[[X,Y,S],...]", help="places forward and right (m), sense 1 or -1")
    airframe.add_argument(
        "--pwm", type=float, nargs=2, default=(1000.0, 2000.0), metavar=("LOW", "HIGH"), help="outputs' range"
    )
    airframe.add_argument("--voltage", type=float, metavar="V", help="for which thrust is wanted")
    airframe.add_argument("--until", type=float, metavar="S", help="use the log's first seconds only")
    _add_set(calibrate)


def _add_recover(recover: argparse.ArgumentParser) -> None:
    recover.add_argument("recording", type=Path, help=".mcap recorded by `onboard run`")
    recover.add_argument("--out", type=Path, metavar="FILE.mcap", help="(default: the name with -recovered)")


def _add_view(view: argparse.ArgumentParser) -> None:
    view.add_argument("recording", nargs="?", type=Path, help=".rrd to open instead of a running daemon")
    view.add_argument("--png", type=Path, help="with a recording: draw it to a picture, without a screen")
    view.add_argument(
        "--at", type=_moment, metavar="S", help="with --png: the time shown, s from the recording's start"
    )
    view.add_argument("--connect", help="a daemon's or router's Zenoh (default: the file's, or this computer's)")
    view.add_argument("--vehicle", help="its id (default: all)")
    view.add_argument("--config", type=Path, metavar="C", help="TOML file: camera, and certificates for a router")
    view.add_argument("--web", action="store_true", help="in a browser of this computer, instead of a window")
    view.add_argument("--rrd", type=Path, help="record what is watched")
    wait = "for a daemon that is not up yet, at most (default: %(default)s)"
    view.add_argument("--wait", type=_seconds, default=0.0, metavar="S", help=wait)
    _add_set(view)


def _add_status(status: argparse.ArgumentParser) -> None:
    status.add_argument("--json", action="store_true", help="one JSON document for each vehicle")
    status.add_argument("--watch", action="store_true", help="again every second, until Ctrl-C")
    status.add_argument("--connect", help="a daemon's or router's Zenoh (default: the file's, or this computer's)")
    status.add_argument("--vehicle", help="its id, or all (default: 1, with a file: all)")
    status.add_argument("--config", type=Path, metavar="C", help="TOML file of the daemon")
    _add_set(status)


def _add_ros2(ros2: argparse.ArgumentParser) -> None:
    file = "TOML file of the daemon: defaults of the parameters, certificates, mounts of the cameras"
    ros2.add_argument("--config", type=Path, metavar="C", help=file)
    _add_set(ros2)
    parameters = "parameters and remappings, as of any node; must come last"
    ros2.add_argument("--ros-args", nargs=argparse.REMAINDER, default=[], metavar="...", help=parameters)


def _add_study(study: argparse.ArgumentParser) -> None:
    study.add_argument("name", nargs="?", help="the paper, by the name of its folder in studies/")
    study.add_argument("--all", action="store_true", help="every paper, two at a time")
    study.add_argument("--seeds", type=_seeds, metavar="N", help="how many (default: what the study needs)")
    study.add_argument("--first-seed", type=_count, metavar="N", help="of one study (default: its own)")
    alone = "only the paper's figure K, of one seed unless --seeds is given"
    study.add_argument("--figure", type=_count, metavar="K", help=alone)
    study.add_argument(
        "--jobs", type=_seeds, metavar="N", help="processes of one study (default: one for each core)"
    )
    study.add_argument(
        "--out", type=Path, default=Path("out/studies"), metavar="DIR", help="(default: %(default)s)"
    )
    study.add_argument("--cases", metavar="NAME,...", help="of encounters: these alone, by the names of its cases")
    study.add_argument(
        "--departures", action="store_true", help="of encounters: their families with one assumption false, alone"
    )
    flown = "of encounters: with the leaders that these logs recorded (.bin, .ulg, .tlog, .csv), alone"
    study.add_argument("--leaders-from", type=Path, metavar="FOLDER", help=flown)
    study.add_argument("--json", type=Path, metavar="FILE", help="write the numbers here as well")
    _add_computers(study)


def _add_computers(command: argparse.ArgumentParser) -> None:
    command.add_argument("--cluster", metavar="ADDRESS", help="fly on a Dask scheduler's workers: tcp://HOST:8786")
    command.add_argument("--rows", type=Path, metavar="FILE.parquet", help="write each result here as it comes")


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


def _seeds(text: str) -> int:
    if not 1 <= _count(text) <= MAX_SEED_COUNT:
        raise argparse.ArgumentTypeError(f"must be from 1 to {MAX_SEED_COUNT}")
    return int(text)


def _seconds(text: str) -> float:
    number = _moment(text)
    if not number > 0:
        raise argparse.ArgumentTypeError(f"must be a positive number of seconds, not {text!r}")
    return number


def _moment(text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not 0 <= number < 1e7:
        raise argparse.ArgumentTypeError(f"must be 0 or a positive number of seconds, not {text!r}")
    return number
