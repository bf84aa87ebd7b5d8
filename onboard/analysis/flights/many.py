"""Many flights, each replayed and scored: on this computer's cores, or on a cluster's."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from onboard import UserError
from onboard.analysis.flights.compare import variants
from onboard.analysis.flights.replay import flight_of, replay
from onboard.analysis.parallel.cluster import ClusterError
from onboard.analysis.parallel.workers import Computers, Part, compute
from onboard.config import load_config
from onboard.messages import Estimate, NavState, Output
from onboard.scoring.beside import LeaderScorers, judged
from onboard.scoring.leader import LeaderScore
from onboard.scoring.reference import reference_from_csv
from onboard.terminal.console import Console
from onboard.terminal.progress import progress_bar

FILTERPY = "filterpy"


class ScorableFlight(NamedTuple):
    """A flight to score, and what is compared with it."""

    log: Path  # or a folder
    name: str
    family: str = ""
    config: Path | None = None
    sets: tuple[str, ...] = ()
    truth: Path | None = None
    beside: tuple[str, ...] = ()  # words of `--compare`, or FILTERPY


class FlightScores(NamedTuple):
    """Scores of one flight by filter; that of the flight's own configuration is first."""

    name: str
    family: str
    duration_s: float
    scores: dict[str, LeaderScore]


def score_flights(flights: Sequence[ScorableFlight], where: Computers) -> list[FlightScores]:
    """All flights, in their order. Raises UserError."""
    for flight in flights:  # before anything flies
        variants([word for word in flight.beside if word != FILTERPY], flight.config, flight.sets)
    parts = [Part(score_flight, (flight,)) for flight in flights]
    with progress_bar(Console(stderr=True)) as bar:
        task = bar.add_task("replaying", total=len(parts))
        try:
            return compute(parts, where, lambda done, total: bar.update(task, completed=done, total=total))
        except ClusterError as error:
            raise UserError(str(error)) from error


def score_flight(flight: ScorableFlight) -> FlightScores:
    """One flight, replayed once for all its filters. Raises UserError."""
    config = load_config(flight.config, flight.sets)
    truth = flight.truth or flight_of(flight.log).truth
    scorers = LeaderScorers(reference_from_csv(truth) if truth is not None else None)
    words = [word for word in flight.beside if word != FILTERPY]
    baseline = None
    if FILTERPY in flight.beside:
        from onboard.analysis.flights.baseline import Baseline  # noqa: PLC0415 - filterpy is an extra

        baseline = Baseline(config)

    def take(output: Output) -> None:
        if isinstance(output, Estimate) and not isinstance(output, NavState):
            scorers.add(output)
        if baseline is not None and (estimate := baseline.follow(output)) is not None:
            scorers.add(estimate)

    replayed = replay(
        flight.log, config, take=take, keep=False, others=variants(words, flight.config, flight.sets)
    )
    score, beside = scorers.scores(replayed.end)
    scores = {judged(config.estimator): score} | dict(sorted(beside.items()))
    return FlightScores(flight.name, flight.family, replayed.duration, scores)


def numbers_of(scored: FlightScores) -> dict[str, Any]:
    """A flight's scores as plain values."""
    return {**scored._asdict(), "scores": msgspec.to_builtins(scored.scores)}
