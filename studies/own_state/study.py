"""The estimator of our own state in the daemon's own pipeline, with faults.

simlink's quadrotor sends MAVLink. There is no paper: our own product is judged. GPS has 10 Hz and is 0.1 s late,
with heights but no vertical velocity (as in MAVLink); attitude, rates and accelerometer have 100 Hz, barometer and
motor outputs 50 Hz.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

from onboard.analysis.parallel.workers import Jobs, Part, Progress, compute
from studies.own_state.flights import (
    DEFAULT,
    EXPECTED,
    FILTERS,
    NO_BAROMETER,
    WITH_VERTICAL,
    FlightScore,
    fly_and_judge,
)
from studies.own_state.results import accuracy_table, checks_of, claims_of, naming_table
from studies.report.files import publish, require_seeds
from studies.report.findings import Findings

NAME: Final = "own-state"
TITLE: Final = "Our own state from MAVLink: accuracy under faults, and faults named"
COMPARED: Final = ("quadrotor-weak-inputs", "quadrotor-gust", "quadrotor-outliers")
KEYS: Final = (  # scenarios and methods, in the order of the report
    *((name, DEFAULT) for name in EXPECTED),
    *((name, DEFAULT + how) for name in COMPARED[:2] for how in (WITH_VERTICAL, NO_BAROMETER)),
    *((name, other) for name in COMPARED for other in FILTERS[:-1]),
)


def run(
    seeds: int = 2,
    first_seed: int = 101,
    jobs: Jobs = None,
    out: Path | None = None,
    progress: Progress | None = None,
) -> Findings:
    """The study.

    Thresholds were chosen on seeds 1 to 20. Sixty seeds take a quarter of an hour on two cores.
    """
    work = list(_work(require_seeds(seeds, first_seed)))
    flights: dict[tuple[str, str], list[FlightScore]] = {key: [] for key in KEYS}
    found_of_parts = compute([Part(fly_and_judge, arguments) for arguments in work], jobs, progress)
    for (name, _, methods), found_of_methods in zip(work, found_of_parts, strict=True):
        for method, scores in zip(methods, found_of_methods, strict=True):
            flights[name, method] += scores
    found = Findings(
        study=NAME,
        title=TITLE,
        setting=" ".join((__doc__ or "").split()),
        seeds=seeds,
        first_seed=first_seed,
        tables=(accuracy_table(flights), naming_table(flights)),
        checks=checks_of(flights),
        claims=claims_of(flights),
    )
    return publish(found, out)


def _work(seeds: range) -> Iterator[tuple[str, Sequence[int], tuple[str, ...]]]:
    """Scenario, seeds and methods of each part.

    Methods with the same input fly together; those other than the default fly a quarter of the seeds. Parts have
    ten seeds at most, so that the progress moves.
    """
    few = -(-len(seeds) // 4)
    for name in EXPECTED:
        methods = [method for scenario, method in KEYS if scenario == name]
        by_records = tuple(method for method in methods if method.endswith(WITH_VERTICAL))
        by_bytes = tuple(method for method in methods if method not in by_records)
        groups = ((by_bytes, seeds[:few]), ((DEFAULT,), seeds[few:]), (by_records, seeds[:few]))
        for together, each in groups:
            if together:
                yield from ((name, each[i : i + 10], together) for i in range(0, len(each), 10))
