"""Whole outputs kept as text in `tests/golden`, and compared line by line.

`GOLDEN=write python -m pytest ...` writes them anew: read the difference before you commit it.
"""

import os
import re
from collections.abc import Iterable
from difflib import unified_diff
from typing import Any, Final

import numpy as np

from tests.support.programs import ROOT

FOLDER: Final = ROOT / "tests" / "golden"
MAX_SHOWN_LINES, MAX_SHOWN_LENGTH = 60, 200
NOTHING: Final = 1e-9  # smaller numbers are rounding errors


def assert_golden(name: str, lines: Iterable[str]) -> None:
    """Assert that the lines are those of a kept file."""
    path, text = FOLDER / name, "\n".join(line.rstrip() for line in [*"\n".join(lines).splitlines(), ""])
    if os.environ.get("GOLDEN") == "write":
        path.write_text(text, encoding="utf-8")
    kept = path.read_text(encoding="utf-8").splitlines()
    different = list(unified_diff(kept, text.splitlines(), f"kept {name}", "now", n=0, lineterm=""))
    assert not different, "\n".join(line[:MAX_SHOWN_LENGTH] for line in different[:MAX_SHOWN_LINES])


def numbers(values: Any) -> str:
    """How many values, how many of them known; of those the first, the last, the sum and a weighted sum.

    A millionth of the largest value is nothing, so that the last bits of another computer show in no digit."""
    flat = np.asarray(values, float).ravel()
    known = np.isfinite(flat)
    count = int(known.sum())
    if not count:
        return f"{len(flat)}/0"
    first, *_, last = flat[known][[0, -1]]
    weighted = flat[known] @ (1.0 + np.flatnonzero(known))
    least = 1e-6 * max(float(np.abs(flat[known]).max()), NOTHING)
    figures = ((first, 1), (last, 1), (flat[known].sum(), count), (weighted, count**2))
    texts = (f"{least * size * round(figure / (least * size)) + 0.0:.5g}" for figure, size in figures)
    return " ".join([f"{len(flat)}/{count}", *texts])


def rounded(text: str) -> str:
    """A text with five digits of each number that has a point."""
    return re.sub(r"-?\d+\.\d*(e[-+]\d+)?", lambda found: _five_digits(float(found[0])), text)


def _five_digits(value: float) -> str:
    return "0" if abs(value) < NOTHING else f"{value:.5g}"


def picture(figure: Any) -> list[str]:
    """A figure of Matplotlib as text: of each curve, band, bar and text what is drawn where."""
    lines = []
    for axis in figure.axes:
        limits = "" if axis.get_autoscaley_on() else f" {numbers(axis.get_ylim())}"
        words = [tick.get_text() for tick in axis.get_yticklabels()] if axis.get_yscale() == "linear" else []
        lines.append(f"axes x {axis.get_xlabel()!r}, y {axis.get_ylabel()!r} {axis.get_yscale()}{limits}")
        lines += [f"  ticks {words}"] if any(word[:1].isalpha() for word in words) else []
        for line in axis.lines:
            label = line.get_label() if line.get_label()[0] != "_" else ""
            style = f"{label!r} {line.get_color()} {line.get_linestyle()} {line.get_marker()}"
            lines.append(f"  line {style}: x {numbers(line.get_xdata())}; y {numbers(line.get_ydata())}")
        for band in axis.collections:
            corners = np.vstack([np.empty((0, 2)), *(path.vertices for path in band.get_paths())])
            lines.append(f"  band: x {numbers(corners[:, 0])}; y {numbers(corners[:, 1])}")
        lines += [f"  box {numbers(box.get_path().vertices)}" for box in axis.patches]
        lines += [f"  text {text.get_text()!r} {numbers(text.xy)}" for text in axis.texts]
    texts = [text for text in figure.texts if text.get_text() and text is not figure._suptitle]
    return [*lines, *(f"text {t.get_text()!r} {t.get_color()} {numbers(t.get_position())}" for t in texts)]
