"""What a study of a tracker paper finds, as records, and its report."""

import math
from collections.abc import Sequence
from typing import Literal

from onboard.messages import Record

Verdict = Literal["holds", "holds only if", "does not hold"]
Cell = str | float | None


class Claim(Record, frozen=True, kw_only=True):
    """A statement of the paper, where it stands, and what our runs say."""

    claim: str
    where: str
    verdict: Verdict
    evidence: str


class Misprint(Record, frozen=True, kw_only=True):
    """A formula that cannot be as printed: a figure that it gives, and what the right one gives. `proven` says
    that the printed form failed and the right one held, when this was computed."""

    where: str
    printed: str
    right: str
    proof: str
    printed_value: float | None
    right_value: float | None
    proven: bool


class Check(Record, frozen=True, kw_only=True):
    """A number of ours that must lie in [low, high]: what an independent implementation found, with tolerance."""

    name: str
    unit: str
    ours: float
    low: float | None
    high: float | None
    agrees: bool


class Table(Record, frozen=True, kw_only=True):
    """Numbers of many runs: units stand in the header."""

    title: str
    note: str
    header: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]


class Findings(Record, frozen=True, kw_only=True):
    """All of a study. Figures are file names beside the report."""

    study: str
    title: str
    setting: str
    seeds: int
    first_seed: int
    tables: tuple[Table, ...]
    checks: tuple[Check, ...]
    claims: tuple[Claim, ...]
    misprints: tuple[Misprint, ...]
    figures: tuple[str, ...]


def check(name: str, unit: str, ours: float, low: float | None = None, high: float | None = None) -> Check:
    """A check with its verdict; NaN agrees with nothing."""
    above = low is None or ours >= low
    below = high is None or ours <= high
    agrees = math.isfinite(ours) and above and below
    return Check(name=name, unit=unit, ours=ours, low=low, high=high, agrees=bool(agrees))


def near(name: str, unit: str, ours: float, expected: float, tolerance: float) -> Check:
    """A check of ours against a number and its tolerance."""
    return check(name, unit, ours, expected - tolerance, expected + tolerance)


def markdown(found: Findings) -> str:
    """The report."""
    sections = [f"# {found.title}", found.setting]
    for table in found.tables:
        rows = [[_text(cell) for cell in row] for row in table.rows]
        sections += [f"## {table.title}", table.note, _markdown_table(table.header, rows)]
    claims = [(c.claim, c.where, f"**{c.verdict}**", c.evidence) for c in found.claims]
    sections += ["## The paper's claims", _markdown_table(("claim", "where", "verdict", "evidence"), claims)]
    if found.misprints:
        header = ("where", "printed", "right", "proof", "printed gives", "right gives", "")
        misprints = [
            (
                *(m.where, m.printed, m.right, m.proof, _text(m.printed_value), _text(m.right_value)),
                "proven" if m.proven else "NOT PROVEN",
            )
            for m in found.misprints
        ]
        sections += ["## Misprints, and their proof in numbers", _markdown_table(header, misprints)]
    checks = [
        (c.name, c.unit, f"{c.ours:.7g}", _range(c), "agrees" if c.agrees else "DIFFERS") for c in found.checks
    ]
    sections += [
        "## Beside an independent implementation",
        _markdown_table(("quantity", "unit", "ours", "expected", ""), checks),
        f"## Figures: first seed {found.first_seed}",
        "\n\n".join(f"![{name}]({name})" for name in found.figures) or "None were drawn.",
    ]
    return "\n\n".join(section for section in sections if section) + "\n"


def _text(cell: Cell) -> str:
    if isinstance(cell, str):
        return cell
    if cell is None or math.isnan(cell):
        return "–"
    return f"{cell:.7g}" if abs(cell) < 1e6 and cell == int(cell) else f"{cell:.4g}"


def _range(c: Check) -> str:
    if c.low is None:
        return f"≤ {c.high:g}"
    return f"≥ {c.low:g}" if c.high is None else f"{c.low:.7g} to {c.high:.7g}"


def _markdown_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    # a bar would end the cell
    cells = [[str(cell).replace("|", "\\|") for cell in row] for row in (header, ["---"] * len(header), *rows)]
    return "\n".join("| " + " | ".join(row) + " |" for row in cells)
