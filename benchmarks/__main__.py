"""`python -m benchmarks [--json [FILE]]`."""

import argparse
import json
import platform
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from benchmarks import start_up, vision_filter


def main(arguments: list[str] | None = None) -> int:
    """Measure, print a table, and write the figures if asked to."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description="Ratios against peers, in one run.")
    parser.add_argument("--json", nargs="?", const="bench.json", metavar="FILE", help="also write the figures")
    options = parser.parse_args(arguments)
    if not vision_filter.agree():
        print("ours and filterpy's results differ: no ratio would mean anything", file=sys.stderr)
        return 1
    figures = {
        "vision_filter": vision_filter.measure()._asdict(),
        "start_up": start_up.measure()._asdict(),
        "versions": {name: version(name) for name in ("numpy", "filterpy")}
        | {"python": platform.python_version()},
    }
    Console().print(_table(figures))
    if options.json:
        Path(options.json).write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
    return 0


def _table(figures: dict[str, Any]) -> Table:
    step, start, versions = figures["vision_filter"], figures["start_up"], figures["versions"]
    table = Table("what", "ours", "peer", "peer / ours (quartiles)")
    table.add_row(
        "9-state vision UKF, predict + update",
        f"{step['ours_us']:.0f} µs",
        f"{step['theirs_us']:.0f} µs (filterpy {versions['filterpy']})",
        f"{step['ratio']:.1f} ({step['ratio_low']:.1f}–{step['ratio_high']:.1f})",
    )
    table.add_row(
        "import onboard.pipeline",
        f"{start['pipeline_ms']:.0f} ms",
        f"{start['numpy_ms']:.0f} ms (numpy {versions['numpy']}, before it)",
        "",
    )
    return table


sys.exit(main())
