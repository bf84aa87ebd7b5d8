"""Every estimate of the leader in a replay, with all digits of its numbers.

`python -m tests.support.exact_estimates LOG OUT.csv SETTING...` complements `onboard replay --out`, whose numbers
have six decimals.
"""

import csv
import sys
from pathlib import Path

from onboard.analysis.flights.replay import replay
from onboard.config import load_config
from onboard.messages import Estimate, Output


def row_of(estimate: Estimate) -> dict[str, object]:
    """Its numbers by name. Python writes a float so that it is read as the same bits."""
    report, mean, covariance = estimate.measurement, estimate.mean or (), estimate.covariance or ()
    return {
        "t_ns": estimate.t_ns,
        "state": str(estimate.state),
        "valid": estimate.valid,
        "verdict": None if report is None else str(report.verdict),
        "nis": None if report is None else report.nis,
        **{f"mean_{i}": x for i, x in enumerate(mean)},
        **{f"covariance_{i}_{j}": x for i, row in enumerate(covariance) for j, x in enumerate(row) if j <= i},
    }


def write_rows(rows: list[dict[str, object]], path: Path) -> None:
    """Write them as a table, in which an estimate that is lost has no numbers."""
    with path.open("w", encoding="utf-8", newline="") as file:
        table = csv.DictWriter(file, max(rows, key=len))
        table.writeheader()
        table.writerows(rows)


def main(arguments: list[str]) -> int:
    log, out, *settings = arguments
    rows: list[dict[str, object]] = []

    def take(output: Output) -> None:
        if isinstance(output, Estimate) and output.name == "leader":
            rows.append(row_of(output))

    replay(Path(log), load_config(None, tuple(settings)), take=take, keep=False)
    write_rows(rows, Path(out))
    print(f"{out}: {len(rows)} estimates")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
