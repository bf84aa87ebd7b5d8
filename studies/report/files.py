"""The seeds that a study flies, and the files that it writes."""

from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import msgspec

from onboard.messages import Record
from studies.report.findings import Findings
from studies.report.markdown import markdown

Draw = Callable[..., tuple[str, ...]]


def require_seeds(seeds: int, first_seed: int) -> range:
    """The seeds of a study. Raises ValueError."""
    if seeds < 1 or first_seed < 0:
        raise ValueError("needs at least one seed, none of them negative")
    return range(first_seed, first_seed + seeds)


def drawing(package: str, out: Path | None) -> Draw | None:
    """The function `draw` of a study's module `figures`, None without a folder to draw into.

    Call it first: it raises ImportError, before anything is computed, where matplotlib, of the extra `study`, is
    missing.
    """
    if out is None:
        return None
    draw: Draw = import_module(f"{package}.figures").draw
    return draw


def publish(found: Findings, out: Path | None, draw: Draw | None = None, *drawn: Any) -> Findings:
    """Return the findings with the names of their figures, and write all into `out`.

    `draw(*drawn, out)` draws the figures. Without `out` only the findings are returned.
    """
    if out is None:
        return found
    if draw is not None:
        found = msgspec.structs.replace(found, figures=draw(*drawn, out))
    write(found, out)
    return found


def write(found: Findings, out: Path, result: Record | None = None) -> None:
    """report.md and result.json into the folder `out`.

    The JSON holds `result` (None: `found`), NaN as null.
    """
    out.mkdir(parents=True, exist_ok=True)
    (out / "report.md").write_text(markdown(found), encoding="utf-8")
    (out / "result.json").write_bytes(
        msgspec.json.format(msgspec.json.encode(found if result is None else result), indent=1)
    )
