"""`onboard replay`: a log through the pipeline, and a scorecard."""

import argparse
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import msgspec
from rich.console import Console

from onboard.commands.csv_rows import CsvWriter, OwnCsvWriter
from onboard.commands.files import check_targets, write_json
from onboard.commands.log_replay import Replayed, check_log, replay
from onboard.commands.progress import progress_bar
from onboard.config import Config, load_config
from onboard.errors import UserError
from onboard.messages import Estimate, NavState, Output
from onboard.scoring.beside import LeaderScorers
from onboard.scoring.leader import LeaderScore
from onboard.scoring.reference import reference_from_csv
from onboard.scoring.scorecard import OwnStateSummary, explain_bounds, print_health, print_leader_score


def main(arguments: argparse.Namespace) -> int:
    """Replay a log. Raises UserError."""
    a = arguments
    config = load_config(a.config, tuple(a.set))
    return replay_log(a.log, config, out=a.out, truth=a.truth, json_file=a.json, rrd=a.rrd, own=a.own)


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
    check_targets(out, json_file, rrd, own, inputs=(log, truth))
    with ExitStack() as stack:
        scorers, own_summary = LeaderScorers(reference), OwnStateSummary()
        takers: list[Callable[[Any], None]] = [lambda output: _score(output, scorers, own_summary)]
        if rrd is not None:
            from onboard.view.view import View  # noqa: PLC0415 - Rerun is an extra

            view = stack.enter_context(View(camera=config.camera_model(), rotors=config.rotors(), rrd=rrd))
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
            keep=False,
        )
    result, beside = scorers.scores(replayed.end)
    _print_replay(log, replayed, result, beside, own_summary, out, own, rrd)
    if json_file is not None:
        write_json(json_file, replay_numbers(replayed, result, beside))
    return 0


def replay_numbers(replayed: Replayed, result: LeaderScore, beside: dict[str, LeaderScore]) -> dict[str, Any]:
    """The summary of a replay as plain values; `beside` are the scores of other estimators of the leader."""
    numbers: dict[str, Any] = msgspec.to_builtins(result)
    log = {"duration_s": replayed.duration, "records": replayed.records, "damaged": replayed.damaged}
    health: dict[str, Any] = msgspec.to_builtins(replayed.health)
    del health["links"]  # a replay has none
    return {**numbers, "beside": msgspec.to_builtins(beside), "log": log, "health": health}


def _score(output: Output, scorers: LeaderScorers, own_summary: OwnStateSummary) -> None:
    if isinstance(output, NavState):
        own_summary.add(output)
    elif isinstance(output, Estimate):
        scorers.add(output)


def _print_replay(
    log: Path,
    replayed: Replayed,
    result: LeaderScore,
    beside: dict[str, LeaderScore],
    own_summary: OwnStateSummary,
    *written: Path | None,
) -> None:
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
    for name, score in beside.items():
        print_leader_score(console, f"beside it: {name}", score)
    explain_bounds(console)
    own_summary.print(console)
    for path in written:
        if path is not None:
            console.print(f"written: {path}", highlight=False, soft_wrap=True)


def _each(takers: list[Callable[[Any], None]], record: Any) -> None:
    for take in takers:
        take(record)
