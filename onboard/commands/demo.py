"""`onboard demo`: the main job on simulated input, a view of it, and a scorecard."""

import argparse
from contextlib import ExitStack
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import msgspec

from onboard.commands.demo_flight import DemoProgress, DemoReport, flight_name, run_demo
from onboard.config import Config
from onboard.messages import Estimate
from onboard.scoring.scorecard import explain_bounds, print_leader_score, print_own_state_score
from onboard.terminal.console import Console
from onboard.terminal.files import check_targets, make_folder, write_json
from onboard.terminal.progress import progress_bar

if TYPE_CHECKING:
    from onboard.view.view import View

MOST_PERCENT: Final = 50.0
SLOW_START_DELAY_S: Final = 20.0  # after which it is said, also without a terminal


def main(arguments: argparse.Namespace) -> int:
    """Fly, show, judge: 0 unless the estimate failed. Raises UserError."""
    a = arguments
    console = Console(stderr=True)
    make_folder(a.out)
    check_targets(a.json)
    rrd = a.out / f"{flight_name(a.scenario, a.seed)}.rrd"
    with ExitStack() as stack:
        bar = stack.enter_context(progress_bar(console))
        task = bar.add_task("starting simulator and daemon", total=a.duration)

        def on_wait(waited: float) -> None:
            bar.update(task, description=f"starting simulator and daemon ({waited:.0f} s)")
            if waited > SLOW_START_DELAY_S:
                say_slow()

        @cache
        def say_slow() -> None:
            console.print("the daemon starts slowly, as on a busy computer; waiting for it", highlight=False)

        def on_progress(flown: float, newest: Estimate | None) -> None:
            bar.update(task, completed=min(flown, a.duration), description=in_words(newest))

        report = run_demo(
            scenario=a.scenario,
            seed=a.seed,
            duration=a.duration,
            directory=a.out,
            overrides=tuple(a.set),
            detector=a.detector,
            beside=a.beside,
            view=lambda config: open_view(config, rrd, console, headless=a.headless),
            tell=DemoProgress(on_wait, on_progress),
        )
    print_report(report, rrd)
    if a.json is not None:
        write_json(a.json, demo_numbers(report))
    return 1 if has_failed(report) else 0


def has_failed(report: DemoReport) -> bool:
    """Whether the estimate of the leader diverged, or was confidently wrong for most of the time, or our own state
    was not valid for most of the time; a vehicle that flew alone had no leader."""
    own = report.own_state
    if own is not None and own.valid_percent is not None and own.valid_percent < MOST_PERCENT:
        return True
    if is_alone(report):
        return False
    wrong = report.score.confidently_wrong_percent
    return report.score.diverged or (wrong is not None and wrong > MOST_PERCENT)


def open_view(config: Config, rrd: Path, console: Console, *, headless: bool) -> "View":
    """The view: a window where there is a display and it is wanted, and always the recording `rrd`."""
    from onboard.view.view import View  # noqa: PLC0415 - Rerun is an extra
    from onboard.view.viewer import has_display  # noqa: PLC0415

    shown = not headless and has_display()
    if not headless and not shown:
        console.print(f"no display here: the view is recorded to {rrd}")
    return View(camera=config.camera_model(), rotors=config.rotors(), rrd=rrd, spawn=shown)


def is_alone(report: DemoReport) -> bool:
    """Whether our own vehicle flew without a leader to be seen."""
    return report.own_state is not None and report.drops.images_sent == 0


def print_report(report: DemoReport, rrd: Path) -> None:
    """The scorecard, what was lost on the way, and where the recording is."""
    out = Console()
    flown = f"{report.scenario}, seed {report.seed}, {report.duration_s:g} s"
    if not is_alone(report):
        title = f"Leader: {flown} (NED, relative to us)"
        print_leader_score(out, title, report.score, report.latency_ms)
        for name, score in report.beside.items():
            print_leader_score(out, f"beside it: {name}", score)
    if report.own_state is not None:
        out.print()
        print_own_state_score(out, f"Own state: {flown}", report.own_state, report.fault)
    explain_bounds(out)
    out.print()
    d = report.drops
    out.print(
        f"lost: {d.images_lost} of {d.images_sent} images between simulator and pipeline, "
        f"{d.estimates_missed} estimates between daemon and view",
        highlight=False,
    )
    if d.skipped:
        out.print(
            f"left out: {d.skipped} messages that had waited too long; this computer is busy", highlight=False
        )
    out.print(f"recorded: {rrd} (open it with: onboard view {rrd})", highlight=False, soft_wrap=True)


def demo_numbers(report: DemoReport) -> dict[str, Any]:
    """The scorecard under its documented keys, the score's own at the top level."""
    numbers: dict[str, Any] = msgspec.to_builtins(report)
    return {**numbers.pop("score"), **numbers}


def in_words(newest: Estimate | None) -> str:
    """The state of the newest estimate, and the leader's distance (m)."""
    if newest is None or newest.mean is None:
        return "searching" if newest is None else str(newest.state)
    distance = sum(x * x for x in newest.mean[:3]) ** 0.5
    return f"{newest.state}: leader at {distance:.1f} m"
