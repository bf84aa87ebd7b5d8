"""A flight's report as one HTML page that needs no other file, or as a PDF."""

import io
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any, Final, NamedTuple

import matplotlib as mpl
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure

from onboard.analysis.report.verdict import Check, Grade, worst
from onboard.messages.text import MAX_LINE_LENGTH, plain

COLOURS: Final = {Grade.PASS: "#1f7a45", Grade.AMBER: "#b26a00", Grade.FAIL: "#b3261e"}
STYLE_SHEET: Final = """
body{font:15px/1.45 system-ui,sans-serif;color:#1b1f24;background:#fff}
body{max-width:60rem;margin:1.5rem auto;padding:0 1rem}
.grade{color:#fff;border-radius:.5rem;padding:.6rem 1rem;font-size:1.15rem}
.grade b{font-size:1.9rem;margin-right:.8rem;letter-spacing:.04em}
h1{font-size:1.35rem;margin:.2rem 0 .8rem}h2{font-size:1.05rem;margin:1.6rem 0 .4rem}
table{border-collapse:collapse;width:100%}td,th{text-align:left;padding:.25rem .6rem .25rem 0;vertical-align:top}
tr+tr td{border-top:1px solid #e3e6ea}th{font-weight:600;color:#57606a}td.n{white-space:nowrap}
.tag{color:#fff;border-radius:.3rem;padding:0 .45rem;font-weight:600;font-size:.85em}
svg{width:100%;height:auto}pre{white-space:pre-wrap;font-size:.82em;background:#f5f7f9;padding:.7rem}
.facts{margin-top:.8rem}.facts td:first-child{color:#57606a;white-space:nowrap;width:11rem}
summary{cursor:pointer;color:#57606a}
@media print{body{margin:0}h2{break-after:avoid}svg,table{break-inside:avoid}}
"""

PDF_LINE_LENGTH: Final = 110  # letters, in the PDF
PARAMETERS_HEADING: Final = "The autopilot's parameters"
PAGE_ROWS: Final = 52  # of a table, in the PDF
MAX_PARAMETER_PAGE_NUMBER: Final = 3
# Lets a reader look for a parameter by a part of its name.
SEARCH: Final = """
<input type=search placeholder='a part of a name' aria-label='look for a parameter'
 oninput="for(const r of this.nextElementSibling.rows)if(r.cells[0].tagName=='TD')
r.hidden=!r.cells[0].textContent.toLowerCase().includes(this.value.toLowerCase())">
"""
A4: Final = (8.27, 11.69)  # inches

Table = Sequence[Sequence[str]]  # the first row is its head


class FlightReport(NamedTuple):
    """Contents of a report; figures and tables by their titles."""

    title: str
    facts: Sequence[tuple[str, str]]
    checks: list[Check]
    figures: Mapping[str, Figure]
    tables: Mapping[str, Table]
    configuration: str
    parameters: Table = ()  # of the autopilot, those that somebody has set first


def html(report: FlightReport) -> str:
    """Render the HTML page."""
    parts = [
        f"<!doctype html><html lang=en><meta charset=utf-8><title>{_text(report.title)}</title>",
        f"<meta name=viewport content='width=device-width'><style>{STYLE_SHEET}</style>",
        f"<h1>{_text(report.title)}</h1>{_banner(report.checks)}",
        f"<table class=facts>{''.join(_row(fact) for fact in report.facts)}</table>",
        f"<h2>Checks</h2>{_checks(report.checks)}",
    ]
    parts += [f"<h2>{_text(title)}</h2>{svg(figure)}" for title, figure in report.figures.items()]
    parts += [
        f"<h2>{_text(title)}</h2>{_table(table)}" for title, table in report.tables.items() if len(table) > 1
    ]
    if len(report.parameters) > 1:
        number = f"<summary>{len(report.parameters) - 1}, those that somebody has set first</summary>"
        parts.append(
            f"<h2>{PARAMETERS_HEADING}</h2><details>{number}{SEARCH}{_table(report.parameters)}</details>"
        )
    parts.append(
        "<h2>Configuration</h2><details><summary>all keys, as they were used</summary>"
        f"<pre>{escape(report.configuration)}</pre></details></html>"
    )
    return "\n".join(parts)


def write_pdf(report: FlightReport, path: Path) -> None:
    """Write a PDF: verdict and checks first, then figures, tables and some parameters."""
    metadata = {"Title": plain(report.title, MAX_LINE_LENGTH), "CreationDate": None}
    with mpl.rc_context({"text.parse_math": False}), PdfPages(path, metadata=metadata) as pdf:
        pdf.savefig(_first_page(report))
        for title, figure in report.figures.items():
            figure.suptitle(title, fontsize=10, x=0.01, ha="left")
            pdf.savefig(figure)
        for figure in _table_pages({**report.tables, PARAMETERS_HEADING: _shorten(report.parameters)}):
            pdf.savefig(figure)


def _shorten(table: Table) -> Table:
    """The first rows of a table, and the number of those left out."""
    most = MAX_PARAMETER_PAGE_NUMBER * PAGE_ROWS
    if len(table) - 1 <= most:
        return table or [()]
    return [*table[:most], (f"and {len(table) - most} more, in the page", *[""] * (len(table[0]) - 1))]


def _text(text: str) -> str:
    """Text as HTML: parts of it, such as a file's name, may come from outside."""
    return escape(plain(text, MAX_LINE_LENGTH))


def svg(figure: Figure) -> str:
    """A figure as SVG, the same every time, with its text as text."""
    out = io.StringIO()
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "report", "font.family": "sans-serif"}):
        figure.savefig(out, format="svg", metadata={"Date": None, "Creator": None})
    text = out.getvalue()
    return text[text.index("<svg") :]


def summary(checks: list[Check]) -> str:
    """Name every figure that is not PASS, in one line."""
    bad = [f"{check.name} {check.value.strip()}" for check in checks if check.grade is not Grade.PASS]
    return "; ".join(bad) if bad else "all figures are as they should be"


def _banner(checks: list[Check]) -> str:
    grade = worst(checks)
    return f"<div class=grade style='background:{COLOURS[grade]}'><b>{grade}</b>{_text(summary(checks))}</div>"


def _checks(checks: list[Check]) -> str:
    rows = ["<tr><th><th>figure<th>measured<th>wanted, and what to do"]
    for check in sorted(checks, key=lambda c: list(Grade).index(c.grade), reverse=True):
        tag = f"<span class=tag style='background:{COLOURS[check.grade]}'>{check.grade}</span>"
        advice = "" if check.grade is Grade.PASS else f"<br><b>{_text(check.advice)}</b>"
        rows.append(
            f"<tr><td>{tag}<td class=n>{_text(check.name)}<td class=n>{_text(check.value)}"
            f"<td>{_text(check.wanted)}{advice}"
        )
    return f"<table>{''.join(rows)}</table>"


def _table(table: Table) -> str:
    head, *rows = table
    cells = "".join(f"<th>{_text(cell)}" for cell in head)
    return f"<table><tr>{cells}{''.join(_row(row) for row in rows)}</table>"


def _row(cells: Sequence[str]) -> str:
    return "<tr>" + "".join(f"<td>{_text(cell)}" for cell in cells)


def _first_page(report: FlightReport) -> Figure:
    figure, grade = Figure(figsize=A4), worst(report.checks)

    def put(x: float, y: float, text: str, most: int = PDF_LINE_LENGTH, **style: Any) -> None:
        figure.text(x, y, plain(text, most), **{"fontsize": 8, **style})

    put(0.07, 0.95, report.title, fontsize=14)
    put(0.07, 0.915, f" {grade} ", fontsize=18, color="white", backgroundcolor=COLOURS[grade])
    y = 0.88
    for name, value in report.facts:
        put(0.07, y, name, color="#57606a")
        put(0.27, y, value, 95)
        y -= 0.017
    y -= 0.015
    for check in report.checks:
        put(0.07, y, str(check.grade), color=COLOURS[check.grade], weight="bold")
        put(0.15, y, f"{check.name}: {check.value}")
        put(0.52, y, check.wanted, 65, fontsize=7, color="#57606a")
        y -= 0.017
        if check.grade is not Grade.PASS:
            put(0.15, y, check.advice, fontsize=7.5)
            y -= 0.017
    return figure


def _table_pages(tables: Mapping[str, Table]) -> Iterator[Figure]:
    """Pages with the tables as text; tables without rows have none."""
    for title, (head, *rows) in tables.items():
        for first in range(0, len(rows), PAGE_ROWS):
            figure = Figure(figsize=A4)
            more = f", from row {first + 1}" if first else ""
            figure.text(0.07, 0.95, plain(title + more, MAX_LINE_LENGTH), fontsize=12)
            most = PDF_LINE_LENGTH // len(head)  # letters of a cell
            for line, cells in enumerate((head, *rows[first : first + PAGE_ROWS])):
                for column, cell in enumerate(cells):
                    at = 0.07 + 0.86 * column / len(head), 0.92 - 0.016 * line
                    colour = "black" if line else "#57606a"
                    figure.text(*at, plain(cell, most), fontsize=8, color=colour)
            yield figure
