"""The seeds that a study flies, and the files that it writes."""

from pathlib import Path

import msgspec

from onboard.messages import Record
from studies.report.findings import Findings
from studies.report.markdown import markdown


def write(found: Findings, out: Path, result: Record | None = None) -> None:
    """report.md and result.json into the folder `out`. The JSON holds `result` (None: `found`), NaN as null."""
    out.mkdir(parents=True, exist_ok=True)
    (out / "report.md").write_text(markdown(found), encoding="utf-8")
    (out / "result.json").write_bytes(
        msgspec.json.format(msgspec.json.encode(found if result is None else result), indent=1)
    )


def require_seeds(seeds: int, first_seed: int) -> range:
    """The seeds of a study. Raises ValueError."""
    if seeds < 1 or first_seed < 0:
        raise ValueError("needs at least one seed, none of them negative")
    return range(first_seed, first_seed + seeds)
