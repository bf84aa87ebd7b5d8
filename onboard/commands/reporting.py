"""What the commands show and write: progress while they work, a scorecard and files when they are done."""

import os
import pkgutil
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
from rich.console import Console
from rich.markdown import Markdown
from rich.table import Column, Table

from onboard import estimators, studies
from onboard.commands.compiling import Module, needed_by, needed_by_flight
from onboard.commands.demo_flight import Report, flight_name, run_demo
from onboard.commands.log_replay import CsvWriter, OwnCsvWriter, Replayed, check_log, replay
from onboard.commands.progress import compile_shown, progress_bar
from onboard.config import Config
from onboard.errors import UserError
from onboard.messages import Estimate
from onboard.scoring.leader import LeaderScore, reference_from_csv, score_leader
from onboard.scoring.scorecard import print_health, print_leader_score, print_own_state, print_own_state_score
from onboard.studies.together import run_all, run_study

if TYPE_CHECKING:
    from onboard.view.view import View


def demo(
    *,
    scenario: str,
    seed: int,
    duration: float,
    headless: bool,
    directory: Path,
    json_file: Path | None,
    overrides: tuple[str, ...],
) -> int:
    """`onboard demo`: fly, show, judge. 0 unless the estimate diverged."""
    console = Console(stderr=True)
    _make_folder(directory)
    _check_targets(json_file)
    rrd = directory / f"{flight_name(scenario, seed)}.rrd"

    def view(config: Config) -> "View":
        from onboard.view.view import View  # noqa: PLC0415 - Rerun is an extra
        from onboard.view.viewer import has_display  # noqa: PLC0415

        shown = not headless and has_display()
        if not headless and not shown:
            console.print(f"no display here: the view is recorded to {rrd}")
        return View(camera=config.camera_model(), rrd=rrd, spawn=shown)

    with ExitStack() as stack:
        bar = progress_bar(console)
        task = bar.add_task("starting simulator and daemon", total=duration)

        def prepare(names: Iterable[str]) -> None:
            compile_shown(needed_by_flight(names), console, _told_once(console, "this flight", "half a minute"))
            stack.enter_context(bar)  # after that of the compiling: a terminal shows one at a time

        def progress(flown: float, newest: Estimate | None) -> None:
            bar.update(task, completed=min(flown, duration), description=_in_words(newest))

        report = run_demo(
            scenario=scenario,
            seed=seed,
            duration=duration,
            directory=directory,
            overrides=overrides,
            prepare=prepare,
            view=view,
            progress=progress,
        )
    out = Console()
    title = f"{scenario}, seed {seed}, {duration:g} s (NED, leader relative to follower)"
    flown_alone = report.own_state is not None and report.drops.images_sent == 0  # there was no leader to see
    if not flown_alone:
        print_leader_score(out, title, report.score, report.latency_ms)
    if report.own_state is not None:
        print_own_state_score(out, report.own_state)
    d = report.drops
    out.print(
        f"lost: {d.images_lost} of {d.images_sent} images between simulator and pipeline, "
        f"{d.estimates_missed} estimates between daemon and view",
        highlight=False,
    )
    out.print(f"recorded: {rrd} (open it with: onboard view {rrd})", highlight=False, soft_wrap=True)
    if json_file is not None:
        _write_json(json_file, demo_numbers(report))
    return 1 if report.score.diverged and not flown_alone else 0


def _told_once(console: Console, what: str, how_long: str) -> Callable[[Module], None]:
    """Says, when the first module had to be compiled, that this takes a while."""
    said: list[Module] = []

    def tell(module: Module) -> None:
        if module.compiled and not said:
            said.append(module)
            console.print(f"compiling what {what} needs ({how_long} on two cores, once)", highlight=False)

    return tell


def demo_numbers(report: Report) -> dict[str, Any]:
    """The scorecard under its documented keys, the score's own at the top level."""
    numbers: dict[str, Any] = msgspec.to_builtins(report)
    return {**numbers.pop("score"), **numbers}


def replay_log(
    log: Path,
    config: Config,
    *,
    out: Path | None,
    truth: Path | None,
    json_file: Path | None,
    rrd: Path | None,
    own: Path | None = None,
) -> int:
    """`onboard replay`: a log through the pipeline; rows to `out`, of our own state to `own`, the view to `rrd`, a
    summary to the screen."""
    reference = reference_from_csv(truth) if truth is not None else None
    check_log(log)
    _check_targets(out, json_file, rrd, own, inputs=(log, truth))
    with ExitStack() as stack:
        takers: list[Callable[[Any], None]] = []
        if rrd is not None:
            from onboard.view.view import View  # noqa: PLC0415 - Rerun is an extra

            view = stack.enter_context(View(camera=config.camera_model(), rrd=rrd))
            takers.append(view.show)
        for path, writer in ((out, CsvWriter), (own, OwnCsvWriter)):
            if path is None:
                continue
            try:
                takers.append(writer(stack.enter_context(path.open("w", encoding="utf-8", newline=""))).write)
            except OSError as error:
                raise UserError(f"cannot write {path}: {error.strerror}") from error
        bar = stack.enter_context(progress_bar(Console(stderr=True)))
        task = bar.add_task(f"replaying {log.name}", total=None)
        replayed = replay(
            log,
            config,
            take=lambda record: _each(takers, record),
            progress=lambda done, total: bar.update(task, completed=done, total=total),
        )
    result = score_leader(replayed.estimates, reference)
    _print_replay(log, replayed, result, out, own, rrd)
    if json_file is not None:
        _write_json(json_file, replay_numbers(replayed, result))
    return 0


def replay_numbers(replayed: Replayed, result: LeaderScore) -> dict[str, Any]:
    """The summary of a replay as plain values."""
    numbers: dict[str, Any] = msgspec.to_builtins(result)
    log = {"duration_s": replayed.duration, "records": replayed.records, "damaged": replayed.damaged}
    return {**numbers, "log": log, "health": msgspec.to_builtins(replayed.health)}


def study(name: str, *, seeds: int | None, out: Path, json_file: Path | None) -> int:
    """`onboard study NAME`: measure a paper's claims; figures, report and numbers go to a folder of `out`. Without
    `seeds` as many as the study asks for."""
    known = study_names()
    if name not in known:
        raise UserError(f"no study named {name!r}; there are: {', '.join(known)}")
    _require_figures()
    _make_folder(out / name)
    _check_targets(json_file)
    _compile([name])
    result = _measure(name, seeds, out)
    Console().print(Markdown((out / name / "report.md").read_text(encoding="utf-8")))
    print(f"written: {out / name}/report.md, result.json and figures")
    if json_file is not None:
        _write_json(json_file, result)
    return 0


def all_studies(*, seeds: int | None, out: Path, json_file: Path | None) -> int:
    """`onboard study --all`: every study, two at a time; the JSON has their numbers by name."""
    known = study_names()
    _require_figures()
    for name in known:
        _make_folder(out / name)
    _check_targets(json_file)
    _compile(known)
    results = _measure_all(known, seeds, out)
    name_column = Column("study", no_wrap=True)
    table = Table(name_column, "claims: hold", "only if", "do not", "agree with reference", box=None)
    for name, result in results.items():
        verdicts = [claim["verdict"] for claim in result.get("claims", ())]
        held = [str(verdicts.count(verdict)) for verdict in ("holds", "holds only if", "does not hold")]
        compared = [c["agrees"] for c in result.get("checks", result.get("comparisons", ()))]
        table.add_row(name, *held, f"{sum(compared)} of {len(compared)}")
    Console().print(table)
    print(f"written: report.md, result.json and figures in each folder of {out}")
    if json_file is not None:
        _write_json(json_file, results)
    return 0


def study_names() -> list[str]:
    """Every study there is: the modules of onboard/studies."""
    folders = (m.name for m in pkgutil.iter_modules(studies.__path__) if m.ispkg)
    return sorted(name.replace("_", "-") for name in folders if find_spec(f"{studies.__name__}.{name}.study"))


def _compile(names: list[str]) -> None:
    """Ahead and by all cores together: each of a study's processes would compile the same."""
    modules = needed_by(map(_module, names))
    if "onboard.pipeline" in modules:  # which loads estimators by name
        modules |= needed_by_flight(estimators.known())
    console = Console(stderr=True)
    compile_shown(modules, console, _told_once(console, "this study", "up to a minute and a half"))


def _measure(name: str, seeds: int | None, out: Path) -> dict[str, Any]:
    with progress_bar(Console(stderr=True)) as bar:
        task = bar.add_task(_title(name), total=None)
        return run_study(name, seeds, out, lambda done, total: bar.update(task, completed=done, total=total))


def _measure_all(names: list[str], seeds: int | None, out: Path) -> dict[str, dict[str, Any]]:
    with progress_bar(Console(stderr=True)) as bar:
        tasks = {name: bar.add_task(_title(name), total=None) for name in names}
        return run_all(
            names, seeds, out, lambda name, done, total: bar.update(tasks[name], completed=done, total=total)
        )


def _title(name: str) -> str:
    title: str = import_module(_module(name)).TITLE
    return title


def _module(name: str) -> str:
    return f"{studies.__name__}.{name.replace('-', '_')}.study"


def _require_figures() -> None:
    """Before anything is compiled or flown. Raises UserError where figures cannot be drawn."""
    if find_spec("matplotlib") is None:
        raise UserError("figures need matplotlib: pip install 'wingline[study]'")


def _print_replay(log: Path, replayed: Replayed, result: LeaderScore, *written: Path | None) -> None:
    console = Console()
    damage = f", {replayed.damaged} damaged stretches skipped" if replayed.damaged else ""
    console.print(
        f"{log}: {replayed.duration:.1f} s, {replayed.records} records{damage}",
        highlight=False,
        soft_wrap=True,
    )
    print_health(console, replayed.health)
    if not result.verdicts:
        console.print("no camera points in this log: nothing to estimate the leader from", highlight=False)
    print_leader_score(console, "leader relative to follower, NED", result)
    print_own_state(console, replayed.own_states)
    for path in written:
        if path is not None:
            console.print(f"written: {path}", highlight=False, soft_wrap=True)


def _each(takers: list[Callable[[Any], None]], record: Any) -> None:
    for take in takers:
        take(record)


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(f"cannot make the folder {folder}: {error.strerror}") from error


def _check_targets(*targets: Path | None, inputs: tuple[Path | None, ...] = ()) -> None:
    """Raise UserError now for files that could not be written after a minute's work, or that are being read."""
    read = {path.resolve() for path in inputs if path is not None}
    for path in targets:
        if path is None:
            continue
        if path.resolve() in read:
            raise UserError(f"cannot write {path}: it is what is read")
        if path.is_dir():
            raise UserError(f"cannot write {path}: it is a folder")
        if not path.parent.is_dir():
            raise UserError(f"cannot write {path}: there is no folder {path.parent}")
        if not os.access(path if path.exists() else path.parent, os.W_OK):
            raise UserError(f"cannot write {path}: permission denied")


def _write_json(path: Path, numbers: dict[str, Any]) -> None:
    try:
        path.write_bytes(msgspec.json.format(msgspec.json.encode(numbers)) + b"\n")
    except OSError as error:
        raise UserError(f"cannot write {path}: {error.strerror}") from error


def _in_words(newest: Estimate | None) -> str:
    if newest is None or newest.mean is None:
        return "searching" if newest is None else str(newest.state)
    distance = sum(x * x for x in newest.mean[:3]) ** 0.5
    return f"{newest.state}: leader at {distance:.1f} m"
