"""`onboard evaluate`: a folder of flights with truth, every filter on every flight, and scores by family."""

import argparse
from collections.abc import Iterable, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
from rich.table import Table

from onboard import UserError, __version__
from onboard.analysis.flights.flight_folder import FLIGHT_CONFIG, LOGS, TRUTHS, is_given
from onboard.analysis.flights.many import FILTERPY, FlightScores, ScorableFlight, numbers_of, score_flights
from onboard.commands.computers import computers
from onboard.messages import Record
from onboard.scoring.leader import LeaderScore
from onboard.terminal.console import Console
from onboard.terminal.files import check_targets, write_json
from onboard.terminal.output import show

BASELINES: Final = ("paper", FILTERPY)


class Row(Record, frozen=True, kw_only=True):
    """A filter in a family of flights. Shares are means over flights, %; errors are RMS over flights' RMS; None
    where no flight has the figure. `diverged`: flights whose estimate was wrong, or missing, at the end."""

    flights: int
    valid_percent: float | None
    range_error_rms_percent: float | None
    position_rmse_m: float | None
    velocity_rmse_m_s: float | None
    confidently_wrong_percent: float | None
    inside_95_percent: float | None
    diverged: int


Rows = dict[str, dict[str, Row]]  # by family, then by filter
MEANS: Final = ("valid_percent", "confidently_wrong_percent", "inside_95_percent")
SQUARES: Final = ("range_error_rms_percent", "position_rmse_m", "velocity_rmse_m_s")
HEADS: Final = {
    "flights": "flights",
    "valid_percent": "valid %",
    "range_error_rms_percent": "range %",
    "position_rmse_m": "position m",
    "velocity_rmse_m_s": "velocity m/s",
    "confidently_wrong_percent": "conf. wrong %",
    "inside_95_percent": "inside 95 %",
    "diverged": "diverged",
}


def main(arguments: argparse.Namespace) -> int:
    """Score all flights of a data set. Raises UserError."""
    a = arguments
    check_targets(a.json)
    where = computers(None, a.cluster, a.rows)
    words = tuple(dict.fromkeys(a.compare if a.compare is not None else BASELINES))
    if FILTERPY in words and find_spec(FILTERPY) is None:
        words = tuple(word for word in words if word != FILTERPY)
        Console(stderr=True).print("without the baseline filterpy: pip install filterpy", highlight=False)
    others = [read_rows(path) for path in getattr(a, "with")]
    flights = find_flights(a.dataset, tuple(a.set), words)
    scored = score_flights(flights, where)
    rows = rows_of(scored)
    for more in others:
        for family, filters in more.items():
            rows.setdefault(family, {}).update({k: v for k, v in filters.items() if k not in rows.get(family, {})})
    print_rows(Console(), rows)
    if a.json is not None:
        families = msgspec.to_builtins(rows)
        flown = [numbers_of(one) for one in scored]
        write_json(a.json, {"version": __version__, "families": families, "flights": flown})
        show(f"written: {a.json}")
    return 0


def find_flights(dataset: Path, sets: tuple[str, ...], words: tuple[str, ...]) -> list[ScorableFlight]:
    """The flights of a data set, by their folders' names: each folder in it, however deep, that holds a log and a
    truth. Its family is the folder that it is in; its configuration is the nearest CONFIG above it. Raises
    UserError."""
    if not dataset.is_dir():
        raise UserError(f"{dataset} is no folder; expected one with FAMILY/FLIGHT/ (a log, truth.csv, ...)")
    found = []
    for folder in sorted({path.parent for path in dataset.rglob("*") if path.suffix.lower() in LOGS}):
        truths = [folder / name for name in TRUTHS if is_given(folder / name)]
        if not truths:
            raise UserError(f"{folder}: it has no truth to score by; expected {' or '.join(TRUTHS)}")
        above = [folder, *(p for p in folder.parents if p.is_relative_to(dataset))]
        config = next((p / FLIGHT_CONFIG for p in above if is_given(p / FLIGHT_CONFIG)), None)
        family = folder.parent.name if folder.parent != dataset else folder.name
        name = str(folder.relative_to(dataset))
        found.append(ScorableFlight(folder, name, family, config, sets, truths[0], words))
    if not found:
        raise UserError(f"{dataset}: there is no flight in it; expected FAMILY/FLIGHT/ with a log and truth.csv")
    return found


def rows_of(scored: Sequence[FlightScores]) -> Rows:
    """Rows by family and filter, in the order of the flights."""
    groups: dict[str, dict[str, list[LeaderScore]]] = {}
    for one in scored:
        for name, score in one.scores.items():
            groups.setdefault(one.family, {}).setdefault(name, []).append(score)
    return {family: {name: _row(scores) for name, scores in each.items()} for family, each in groups.items()}


def read_rows(path: Path) -> Rows:
    """The rows of somebody's results. Raises UserError."""
    try:
        tree: Any = msgspec.json.decode(path.read_bytes())
        return msgspec.convert(tree["families"], Rows)
    except OSError as error:
        raise UserError(f"cannot read {path}: {error.strerror}") from error
    except (msgspec.DecodeError, msgspec.ValidationError, KeyError, TypeError) as error:
        raise UserError(f"{path} is no result of `onboard evaluate --json`: {error}") from error


def print_rows(console: Console, rows: Rows, of: str = "family") -> None:
    """Print a table of all families, or of what `of` says, and filters."""
    table = Table(box=None, pad_edge=False)
    table.add_column(of, overflow="fold")
    table.add_column("filter")
    for head in HEADS.values():
        table.add_column(head, justify="right")
    for family, filters in rows.items():
        for k, (name, row) in enumerate(filters.items()):
            table.add_row("" if k else family, name, *(_cell(getattr(row, field)) for field in HEADS))
    console.print(table)


def _row(scores: Sequence[LeaderScore]) -> Row:
    figures: dict[str, Any] = {name: _mean(getattr(s, name) for s in scores) for name in MEANS}
    for name in SQUARES:
        square = _mean(None if (x := getattr(s, name)) is None else x * x for s in scores)
        figures[name] = None if square is None else float(np.sqrt(square))
    return Row(flights=len(scores), diverged=sum(s.diverged for s in scores), **figures)


def _mean(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def _cell(value: float | None) -> str:
    return "" if value is None else f"{value}" if isinstance(value, int) else f"{value:.2f}"
