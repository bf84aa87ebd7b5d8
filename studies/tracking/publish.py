"""The end of a tracker study: its figures, its report and its numbers, written to a folder."""

from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import msgspec

from studies.report.files import write
from studies.report.findings import Findings

Draw = Callable[..., tuple[str, ...]]


def drawing(package: str, out: Path | None) -> Draw | None:
    """The function `draw` of a study's module `figures`, None without a folder to draw into. Call it first: it
    raises ImportError, before anything is computed, where matplotlib, of the extra `study`, is missing."""
    if out is None:
        return None
    draw: Draw = import_module(f"{package}.figures").draw
    return draw


def publish(found: Findings, out: Path | None, draw: Draw | None, *drawn: Any) -> Findings:
    """The findings with the names of their figures, which `draw(*drawn, out)` draws; all is written into `out`.
    Without `out` the findings alone."""
    if out is None:
        return found
    if draw is not None:
        found = msgspec.structs.replace(found, figures=draw(*drawn, out))
    write(found, out)
    return found
