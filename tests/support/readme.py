"""What README.md promises, as data."""

import re

from tests.support.programs import ROOT

TEXT = (ROOT / "README.md").read_text(encoding="utf-8")


def rows(heading: str) -> list[list[str]]:
    """The cells of the first table below a heading, header row left out."""
    below = TEXT.split(f"# {heading}\n", 1)[1]
    lines = below.split("\n|", 1)[1].split("\n\n", 1)[0].splitlines()
    return [
        [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]] for line in ["|" + lines[0], *lines[1:]]
    ][2:]


def names(cell: str) -> list[str]:
    """The names in backticks, those cut short spelled out: `a.b`, `.c` is a.b, a.c; `x_1`, `_2` is x_1, x_2."""
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
    return {name for key, what in rows("The scorecard") if not what.endswith(other) for name in names(key)}


def keys_of(numbers: dict[str, object]) -> set[str]:
    """The keys of a scorecard; what has open keys of its own (verdicts, health, log) counts as one."""
    spread = ("latency_ms", "drops")
    flat = {k for k in numbers if k not in spread}
    for part in spread:
        value = numbers.get(part)
        flat |= {f"{part}.{k}" for k in value} if isinstance(value, dict) else set()
    return flat
