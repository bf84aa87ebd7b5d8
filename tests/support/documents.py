"""The claims of README.md, CHANGELOG.md, CONTRIBUTING.md and docs/, as data."""

import re
from pathlib import Path

from tests.support.programs import ROOT

DOCS = ROOT / "docs"
ALL = (*(ROOT / name for name in ("README.md", "CHANGELOG.md", "CONTRIBUTING.md")), *sorted(DOCS.rglob("*.md")))


def text(path: Path | str) -> str:
    """A document; of docs/ by its name, as `published`."""
    whole = path if isinstance(path, Path) else DOCS / f"{path}.md"
    return whole.read_text(encoding="utf-8")


def name(path: Path) -> str:
    """Return the label of a test for a document."""
    return str(path.relative_to(ROOT))


def section(page: str, heading: str) -> str:
    """Return the text below a heading, to the next one of its level or above."""
    level, _, below = text(page).partition(f"# {heading}\n")
    depth = len(level) - len(level.rstrip("#")) + 1
    return re.split(rf"^#{{1,{depth}}} ", below, maxsplit=1, flags=re.MULTILINE)[0]


def tables(markdown: str) -> list[list[list[str]]]:
    """The cells of each table, header left out."""
    found = re.findall(r"(?:^\|.*\n?)+", markdown, re.MULTILINE)
    return [[_cells(line) for line in table.splitlines()[2:]] for table in found]


def blocks(markdown: str, language: str) -> list[str]:
    """The fenced blocks of a language."""
    return re.findall(rf"^```{language}\n(.*?)^```", markdown, re.DOTALL | re.MULTILINE)


def names(cell: str) -> list[str]:
    """Return the names in backticks with shortened ones completed.

    `a.b`, `.c` is a.b, a.c; `x_1`, `_2` is x_1, x_2.
    """
    found: list[str] = []
    for name in re.findall(r"`([^`]+)`", cell):
        separator = name[0]
        if separator in "._" and found:
            found.append(found[-1].rsplit(separator, 1)[0] + name)
        else:
            found.append(name)
    return found


def scorecard_keys(command: str) -> set[str]:
    """The documented keys of `demo --json` or `replay --json`."""
    other = {"demo": "(replay)", "replay": "(demo)"}[command]
    (table,) = tables(section("published", "Scorecard"))
    return {name for key, what in table if not what.endswith(other) for name in names(key)}


def keys_of(numbers: dict[str, object]) -> set[str]:
    """Return the keys of a scorecard; a table with open keys (verdicts, health, log) counts as one."""
    spread = ("latency_ms", "drops", "own_state", "fault")
    flat = {k for k in numbers if k not in spread}
    for part in spread:
        value = numbers.get(part)
        flat |= {f"{part}.{k}" for k in value} if isinstance(value, dict) else set()
    return flat


def _cells(line: str) -> list[str]:
    return [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
