"""Lay out a data set for `onboard evaluate` from simulated and recorded flights.

    python -m benchmarks.dataset out/flights --seeds 4

Recorded flights are those of ../shared/data, if they are available.
"""

import argparse
import gzip
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

SIMULATED: Final = {"formation": 90.0, "mission": 60.0, "formation-hover": 90.0}  # scenario and seconds
SHARED: Final = Path(__file__).parents[2] / "shared" / "data"
FIRST_SEED: Final = 501  # of flights that nothing was chosen on


class Recorded(NamedTuple):
    """A flight of ../shared/data: its family, log and truth."""

    family: str
    log: str
    truth: str


RECORDED: Final = (
    Recorded("ardupilot-formation", "formation-copter/follower.tlog", "formation-copter/follower_truth.csv.gz"),
    Recorded("ardupilot-hover", "hover-collapse/fresh-noise.tlog", "hover-collapse/fresh-noise_truth.csv.gz"),
    Recorded("ardupilot-follow", "ardupilot-follow/follower.tlog.gz", "ardupilot-follow/follower_truth.csv.gz"),
    Recorded("out-of-view", "target-out-of-view/follower.tlog", "target-out-of-view/follower_truth.csv.gz"),
)
CONFIG: Final = "[camera]\nmount_rpy_deg = [0.0, 15.0, 0.0]\n[estimator.leader]\nsize_prior_m = 2.0\n"


def main(argv: Sequence[str] | None = None) -> int:
    """Write the folders."""
    parser = argparse.ArgumentParser(prog="benchmarks.dataset", description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--seeds", type=int, default=2, help="of each simulated family (default: %(default)s)")
    arguments = parser.parse_args(argv)
    for scenario, seconds in SIMULATED.items():
        write_simulated(
            arguments.out / scenario, scenario, seconds, range(FIRST_SEED, FIRST_SEED + arguments.seeds)
        )
    for flight in RECORDED:
        if (SHARED / flight.log).exists():
            write_recorded(arguments.out / flight.family / Path(flight.log).parent.name, flight)
    return 0


def write_simulated(family: Path, scenario: str, seconds: float, seeds: range) -> None:
    """Write flights of simlink with its configuration."""
    family.mkdir(parents=True, exist_ok=True)
    (family / "config.toml").write_bytes(_simlink("config", scenario).stdout)
    for seed in seeds:
        folder = family / f"seed-{seed}"
        folder.mkdir(exist_ok=True)
        files = ("--out", str(folder / "log.tlog"), "--truth", str(folder / "truth.csv.gz"))
        _simlink("log", scenario, "--seed", str(seed), "--duration", str(seconds), *files)


def write_recorded(folder: Path, flight: Recorded) -> None:
    """Write a recorded flight, unpacked."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder.parent / "config.toml").write_text(CONFIG, encoding="utf-8")
    data = (SHARED / flight.log).read_bytes()
    (folder / "log.tlog").write_bytes(gzip.decompress(data) if flight.log.endswith(".gz") else data)
    (folder / "truth.csv.gz").write_bytes((SHARED / flight.truth).read_bytes())


def _simlink(*arguments: str) -> "subprocess.CompletedProcess[bytes]":
    return subprocess.run([sys.executable, "-m", "simlink", *arguments], check=True, capture_output=True)  # noqa: S603


if __name__ == "__main__":
    sys.exit(main())
