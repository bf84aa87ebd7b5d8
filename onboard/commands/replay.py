"""`onboard replay`: a log through the pipeline, and a scorecard."""

import argparse
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Final

import msgspec

from onboard import UserError
from onboard.analysis.exports.tables import check_exports, open_export, takes_health, write_truth
from onboard.analysis.flights.compare import print_comparison, variants
from onboard.analysis.flights.many import ScorableFlight, numbers_of, score_flights
from onboard.analysis.flights.replay import NO_OTHERS, ReplayResult, check_log, flight_of, replay
from onboard.commands.computers import computers
from onboard.commands.evaluate import print_rows, rows_of
from onboard.config import Config, load_config
from onboard.messages import Estimate, NavState, Output
from onboard.scoring.beside import LeaderScorers, judged
from onboard.scoring.leader import LeaderScore
from onboard.scoring.reference import reference_from_csv
from onboard.scoring.scorecard import OwnStateSummary, explain_bounds, print_health, print_leader_score
from onboard.terminal.console import Console
from onboard.terminal.files import check_targets, write_json
from onboard.terminal.output import one_line, show
from onboard.terminal.progress import progress_bar
from onboard.wire.logs.recording import parts_of

OWN_STATE: Final = "own_state"


def main(arguments: argparse.Namespace) -> int:
    """Replay a log, or score several. Raises UserError."""
    a = arguments
    if len(a.log) > 1 or a.cluster or a.rows:
        return _replay_many(a)
    (log,) = a.log
    check_log(log)
    flight = flight_of(log)
    path, sets = a.config or flight.config, tuple(a.set)
    if path == flight.log:
        show("configuration: that of the flight, which the recording holds")
    return replay_log(
        log,
        load_config(path, sets),
        out=a.out,
        truth=a.truth or flight.truth,
        json_file=a.json,
        rrd=a.rrd,
        own=a.own,
        others=variants(a.compare, path, sets),
    )


def _replay_many(a: argparse.Namespace) -> int:
    """A row for each log and filter, in the order given. Raises UserError."""
    if a.out or a.own or a.rrd or a.truth:
        raise UserError(
            "replay: several logs, --cluster and --rows give scores: no --out, --own, --rrd or --truth"
        )
    check_targets(a.json)
    where = computers(None, a.cluster, a.rows)
    for log in a.log:
        check_log(log)
    paths = [a.config or flight_of(log).config for log in a.log]
    flights = [
        ScorableFlight(log, str(log), config=path, sets=tuple(a.set), beside=tuple(a.compare))
        for log, path in zip(a.log, paths, strict=True)
    ]
    scored = score_flights(flights, where)
    print_rows(Console(), {one.name: rows_of([one])[""] for one in scored}, of="log")
    if a.json is not None:
        write_json(a.json, {"flights": [numbers_of(one) for one in scored]})
    return 0


def replay_log(
    log: Path,
    config: Config,
    *,
    out: Sequence[Path] = (),
    truth: Path | None,
    json_file: Path | None,
    rrd: Path | None,
    own: Sequence[Path] = (),
    others: Mapping[str, Config] = NO_OTHERS,
) -> int:
    """`onboard replay`: a log through the pipeline; exports to `out`, of our own state to `own`, the view to
    `rrd`, a summary to the screen. `others` fly beside, see `log_replay.replay`: the view, the table and `out`
    have their estimates of the leader, too."""
    reference = reference_from_csv(truth) if truth is not None else None
    check_log(log)
    check_exports(*out, *own)
    check_targets(*out, json_file, rrd, *own, inputs=(log, truth))
    scorers, own_summaries = LeaderScorers(reference), defaultdict[str, OwnStateSummary](OwnStateSummary)
    with ExitStack() as stack:
        takers: list[Callable[[Any], None]] = [lambda output: _score(output, scorers, own_summaries)]
        of_health: list[Callable[[Any], None]] = []
        if rrd is not None:
            from onboard.view.view import View  # noqa: PLC0415 - Rerun is an extra

            view = stack.enter_context(View(camera=config.camera_model(), rotors=config.rotors(), rrd=rrd))
            takers.append(lambda output: view.show(output) if _is_drawn(output) else None)
        for path, of_own in (*((path, False) for path in out), *((path, True) for path in own)):
            takers.append(open_export(path, stack, of_own=of_own, ros2=config.ros2))
            of_health += takers[-1:] if takes_health(path) else []
        bar = stack.enter_context(progress_bar(Console(stderr=True)))
        task = bar.add_task(one_line(f"replaying {log.name}"), total=None)
        replayed = replay(
            log,
            config,
            take=lambda record: _each(takers, record),
            take_health=(lambda health: _each(of_health, health)) if of_health else None,
            progress=lambda done, total: bar.update(task, completed=done, total=total),
            keep=False,
            others=others,
        )
    result, beside = scorers.scores(replayed.end)
    console = Console()
    _print_replay(console, log, replayed, result)
    if others:
        print_comparison(console, {judged(config.estimator): result, **beside}, own_summaries)
    else:
        if result.verdicts or result.valid:
            print_leader_score(console, "leader relative to follower, NED", result)
        elif OWN_STATE not in config.estimator:
            console.print("to estimate our own state: --set estimator.own_state={}", highlight=False)
        for name, score in beside.items():
            print_leader_score(console, f"beside it: {name}", score)
        own_summaries[OWN_STATE].print(console)
    explain_bounds(console)
    truths = [write_truth(p, reference) for p in out if p.suffix == ".tum"] if reference is not None else []
    for written in (*out, *truths, *own, rrd):
        if written is not None:
            console.print(f"written: {written}", highlight=False, soft_wrap=True)
    if json_file is not None:
        write_json(json_file, replay_numbers(replayed, result, beside))
    return 0


def replay_numbers(replayed: ReplayResult, result: LeaderScore, beside: dict[str, LeaderScore]) -> dict[str, Any]:
    """The summary of a replay as plain values; `beside` are the scores of other estimators of the leader."""
    numbers: dict[str, Any] = msgspec.to_builtins(result)
    log = {"duration_s": replayed.duration, "records": replayed.records, "damaged": replayed.damaged}
    health: dict[str, Any] = msgspec.to_builtins(replayed.health)
    del health["links"]  # a replay has none
    return {**numbers, "beside": msgspec.to_builtins(beside), "log": log, "health": health}


def _score(output: Output, scorers: LeaderScorers, own_summaries: defaultdict[str, OwnStateSummary]) -> None:
    if isinstance(output, NavState):
        own_summaries[output.name].add(output)
    elif isinstance(output, Estimate):
        scorers.add(output)


def _is_drawn(output: Output) -> bool:
    """Our own state is drawn once, as the flight's own configuration has it."""
    return not isinstance(output, NavState) or output.name == OWN_STATE


def _print_replay(console: Console, log: Path, replayed: ReplayResult, result: LeaderScore) -> None:
    damage = f", {replayed.damaged} damaged stretches skipped" if replayed.damaged else ""
    console.print(
        f"{log}: {replayed.duration:.1f} s, {replayed.records} records{damage}",
        highlight=False,
        soft_wrap=True,
    )
    if len(parts := parts_of(flight_of(log).log)) > 1:
        console.print(f"joined: {', '.join(part.name for part in parts)}", highlight=False, soft_wrap=True)
    print_health(console, replayed.health)
    for refusal in replayed.health.refusals:
        console.print(f"  {refusal.count} of {refusal.source}: {refusal.reason}", highlight=False, soft_wrap=True)
    for name, state in replayed.health.states.items():
        if not state.is_valid and (why := replayed.health.reasons.get(name)):
            console.print(f"  {name} at the end: {state}, {why}", highlight=False, soft_wrap=True)
    if not result.verdicts:
        console.print("no camera points in this log: nothing to estimate the leader from", highlight=False)


def _each(takers: list[Callable[[Any], None]], record: Any) -> None:
    for take in takers:
        take(record)
