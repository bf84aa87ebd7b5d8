"""The report of a study in Markdown."""

import math
from collections.abc import Sequence
from typing import Final

from studies.report.findings import Cell, Claim, Findings, Misprint

UNKNOWN: Final = "–"


def markdown(found: Findings) -> str:
    """The report."""
    sections = [f"# {found.title}", found.setting]
    for table in found.tables:
        sections += [f"## {table.title}", table.note, table_lines(table.header, table.rows)]
    sections += ["## The paper's claims", _claims(found.claims)]
    if found.misprints:
        sections += ["## Misprints, and their proof in numbers", _misprints(found.misprints)]
    if found.checks:
        checks = [
            (c.name, c.unit, f"{c.ours:.7g}", interval(c.low, c.high), "agrees" if c.agrees else "DIFFERS")
            for c in found.checks
        ]
        header = ("quantity", "unit", "ours", "expected", "")
        sections += ["## Beside an independent implementation", table_lines(header, checks)]
    sections += [
        f"## Figures: first seed {found.first_seed}",
        "\n\n".join(f"![{name}]({name})" for name in found.figures) or "None were drawn.",
    ]
    return "\n\n".join(section for section in sections if section) + "\n"


def table_lines(header: Sequence[str], rows: Sequence[Sequence[Cell]]) -> str:
    """A Markdown table."""
    texts = (header, ["---"] * len(header), *([_text(cell) for cell in row] for row in rows))
    # a bar would end the cell
    cells = [[text.replace("|", "\\|") for text in row] for row in texts]
    return "\n".join("| " + " | ".join(row) + " |" for row in cells)


def number(value: float | None, digits: int = 3) -> str:
    """Return a number with some significant digits, or a dash if it is unknown."""
    return UNKNOWN if value is None or math.isnan(value) else f"{value:.{digits}g}"


def interval(low: float | None, high: float | None) -> str:
    """Return the interval [low, high] in words; at most one side is open (None)."""
    if low is None:
        return f"≤ {high:g}"
    return f"≥ {low:g}" if high is None else f"{low:.7g} to {high:.7g}"


def _claims(claims: Sequence[Claim]) -> str:
    rows = [(c.claim, c.where, f"**{c.verdict}**", c.evidence) for c in claims]
    return table_lines(("claim", "where", "verdict", "evidence"), rows)


def _misprints(misprints: Sequence[Misprint]) -> str:
    rows = [
        (
            *(m.where, m.printed, m.right, m.proof, m.printed_value, m.right_value),
            "proven" if m.proven else "NOT PROVEN",
        )
        for m in misprints
    ]
    return table_lines(("where", "printed", "right", "proof", "printed gives", "right gives", ""), rows)


def _text(cell: Cell) -> str:
    if isinstance(cell, str):
        return cell
    if cell is None or math.isnan(cell):
        return UNKNOWN
    return f"{cell:.7g}" if abs(cell) < 1e6 and cell == int(cell) else f"{cell:.4g}"
