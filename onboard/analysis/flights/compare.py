"""`onboard replay --compare`: other filters or settings on the same bytes, in one table."""

import re
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final, get_args

from msgspec.structs import fields, replace
from rich.table import Table

from onboard import UserError
from onboard.analysis.flights.replay import FLOWN
from onboard.config import Config, load_config
from onboard.messages import Record
from onboard.scoring.beside import PRIMARY_ESTIMATOR
from onboard.scoring.leader import LeaderScore
from onboard.scoring.scorecard import OwnStateSummary, score_rows
from onboard.terminal.console import Console

PAPER: Final = "paper"
OH_JOHNSON: Final = "oh_johnson"


def variants(words: Sequence[str], path: Path | None, sets: tuple[str, ...]) -> dict[str, Config]:
    """Configuration of each word of `--compare`, by the name of its estimates.

    A word is FLOWN (the recording's own estimates), `paper` (Oh & Johnson), a filter's name, or
    [NAME:]KEY=VALUE[;KEY=VALUE...] on top of the flight's own. Raises UserError for any other word, or a
    repeated one."""
    base = load_config(path, sets)
    configs: dict[str, Config] = {}
    for word in words:
        name, keys = _named(word, base)
        if name in configs or name in base.estimator:
            raise UserError(f"--compare {word}: the name {name} is taken; give another, as in OTHER:{word}")
        config = base if name == FLOWN else load_config(path, (*sets, *keys))
        left_out = (
            PRIMARY_ESTIMATOR if name == PAPER else OH_JOHNSON if PRIMARY_ESTIMATOR in config.estimator else ""
        )
        sections = {other: section for other, section in config.estimator.items() if other != left_out}
        configs[name] = replace(config, estimator=sections)  # one estimator of the leader in each
    return configs


def print_comparison(
    console: Console, scores: Mapping[str, LeaderScore], own: Mapping[str, OwnStateSummary]
) -> None:
    """One table, with a column for each name: of the leader, then of our own state."""
    rows = {name: {label: value for label, value, _ in score_rows(score, None)} for name, score in scores.items()}
    _print(console, "leader", rows)
    _print(console, "own state", {name: one.figures() for name, one in own.items() if one.figures()})


def _print(console: Console, title: str, columns: Mapping[str, Mapping[str, str]]) -> None:
    if not columns:
        return
    table = Table(title=title, title_justify="left", title_style="bold", show_edge=False, pad_edge=False)
    table.add_column("")
    for name in columns:
        table.add_column(name, justify="right", overflow="fold")
    for label in dict.fromkeys(label for column in columns.values() for label in column):
        table.add_row(label, *(column.get(label, "") for column in columns.values()))
    console.print(table)


def _named(word: str, base: Config) -> tuple[str, tuple[str, ...]]:
    """The name of a word, and its `--set`."""
    if word == FLOWN:
        return word, ()
    if word == PAPER:
        return word, (f"estimator.{OH_JOHNSON}={{}}",)
    if "=" in word:
        name, colon, values = word.partition(":")
        if not colon or "=" in name:
            name, values = re.sub(r"[^A-Za-z0-9_.-]+", "-", word).strip("-"), word
        return name, tuple(values.split(";"))
    sections = base.estimator.items()
    keys = tuple(f"estimator.{estimator}.filter={word}" for estimator, one in sections if word in filters(one))
    if not keys:
        known = [f"{name} of {estimator}" for estimator, one in sections for name in filters(one)]
        raise UserError(
            f"--compare {word}: no estimator of this configuration has such a filter; there are: "
            f"{', '.join((f'{FLOWN} (of a recording)', PAPER, *known))}; or KEY=VALUE, as with --set"
        )
    return word, keys


def filters(section: Record) -> tuple[str, ...]:
    """The filters that an estimator with such a section can fly with."""
    types = {field.name: field.type for field in fields(section)}
    listed: tuple[str, ...] = getattr(sys.modules[type(section).__module__], "FILTERS", ())
    return get_args(types.get("filter")) or listed
