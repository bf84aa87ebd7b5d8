"""`python -m benchmarks [--json [FILE]]`: one table of figures, measured on one thread."""

import argparse
import json
import sys
from pathlib import Path

from rich.console import Console
from rich.table import Table

from benchmarks.measuring import DisagreementError, Figures, figures
from benchmarks.traffic import COUNTS


def main(arguments: list[str] | None = None) -> int:
    """Measure, print a table, and write the figures on request."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description="Ratios against peers, in one run.")
    parser.add_argument("--json", nargs="?", const="bench.json", metavar="FILE", help="also write the figures")
    parser.add_argument("--quick", action="store_true", help="a few steps only: rough figures in seconds")
    options = parser.parse_args(arguments)
    try:
        measured = figures(pairs=3, scale=0.1, starts=1) if options.quick else figures()
    except DisagreementError as error:
        print(error, file=sys.stderr)
        return 1
    Console().print(table(measured))
    if options.json:
        Path(options.json).write_text(json.dumps(measured, indent=1) + "\n", encoding="utf-8")
    return 0


def table(measured: Figures) -> Table:
    """Return one row for each problem: our time, and the peers' time as a multiple of it."""
    versions = measured["versions"]
    made = Table("predict + update, or start", "ours", "filterpy", "(our model)", "Stone Soup")
    made.title = (
        f"how many times as long filterpy {versions['filterpy']} and Stone Soup {versions['stonesoup']} take"
    )
    made.caption = "(our model): filterpy given our compiled model, in place of one written for it in NumPy"
    for name, key in (
        ("radar", "radar_ukf"),
        ("radar, a model of one's own, compiled", "radar_ukf_own_model"),
        ("radar, our model in NumPy too", "radar_ukf_numpy_model"),
        ("vision", "vision_ukf"),
        ("radar, of a batch", "batch_radar"),
        ("vision, of a batch", "batch_ukf"),
    ):
        row = measured[key]
        ours = row["us"] if "us" in row else row["us_per_step"]
        ratios = [row.get(f"times_faster_than_{peer}") for peer in ("filterpy", "filterpy_our_model", "stonesoup")]
        made.add_row(name, f"{ours:.1f} us", *(f"{times:.0f}" if times else "" for times in ratios))
        if "us_in_two_calls" in row:
            made.add_row(f"{name}, in two calls", f"{row['us_in_two_calls']:.1f} us")
    root, start = measured["square_root"], measured["startup"]
    made.add_row("radar, square root", f"{root['us']:.1f} us = {root['times_ukf']:.1f} of our UKF's")
    made.add_row(
        "the same, in two calls",
        f"{root['us_in_two_calls']:.1f} us = {root['times_ukf_in_two_calls']:.1f} of our UKF's",
    )
    made.add_row("the same, of a batch", f"{root['batch_us']:.1f} us = {root['batch_times_ukf']:.1f} of our UKF's")
    leaders = measured["leader_targets"]
    made.add_row(
        f"{leaders['targets']} leaders at 30 Hz, bytes to bytes", f"{100 * leaders['one_core']:.0f} % of one core"
    )
    tracks = measured["traffic_tracks"]
    for count in COUNTS:
        made.add_row(f"{count} aircraft tracked at 10 Hz", f"{100 * tracks[f'imm_{count}']:.0f} % of one core")
    made.add_row("start", f"{start['warm_s']:.2f} s")
    made.add_row("import onboard.pipeline", f"{start['import_pipeline_s']:.2f} s")
    return made


if __name__ == "__main__":
    sys.exit(main())
