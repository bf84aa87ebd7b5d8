"""A follower flies formation on our estimates alone for ten minutes.

The flight has straight legs, turns, a whole circle, drop-outs of 3 s, and one of 20 s, in which it breaks off. The
daemon's pipeline has its defaults, with only the leader's size and class configured. The follower's autopilot
flies on setpoints as ArduCopter's GUIDED does. It begins to follow after 10 s; scores begin 5 s later.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from onboard.analysis.parallel.workers import Jobs, Part, Progress, compute
from simlink.scenarios.scenario import Scenario, load_scenario
from studies.closed_loop.flight import Flight, fly
from studies.closed_loop.scores import (
    MAX_STOP_TIME_S,
    MAX_STRAIGHT_ERROR_PERCENT,
    MAX_TURNING_ERROR_PERCENT,
    MIN_DISTANCE_PERCENT,
    Score,
    score,
)
from studies.report.files import drawing, publish, require_seeds
from studies.report.findings import Claim, Findings, Table, check, verdict
from studies.report.sampling import decided

NAME: Final = "closed-loop"
TITLE: Final = "Closed loop: formation on our estimates alone"
MIN_SEED_COUNT: Final = 2  # to decide the claims: each flight has every kind of leg
FIRST_SEED: Final = 1


def run(
    seeds: int = 2,
    first_seed: int = FIRST_SEED,
    jobs: Jobs = None,
    out: Path | None = None,
    progress: Progress | None = None,
    duration: float | None = None,
) -> Findings:
    """The study over `seeds` flights of `duration` s (None: the scenario's)."""
    draw = drawing(__package__, out)
    scenario = load_scenario("guided")
    length = scenario.duration if duration is None else duration
    parts = [Part(fly, (scenario, seed, length)) for seed in require_seeds(seeds, first_seed)]
    flights: list[Flight] = compute(parts, jobs, progress)
    return publish(decided(findings(flights, scenario, first_seed), MIN_SEED_COUNT), out, draw, flights[0])


def findings(flights: Sequence[Flight], scenario: Scenario, first_seed: int) -> Findings:
    """The results of flights with successive seeds."""
    scores = [score(flight, scenario) for flight in flights]
    straight, turning, nearest, stop = (
        float(column.max()) for column in np.array([[s.straight, s.turning, -s.nearest, s.stop] for s in scores]).T
    )
    checks = (
        check("slot error, straight, worst", "% of the distance", straight, high=MAX_STRAIGHT_ERROR_PERCENT),
        check("slot error, worst", "% of the distance", max(straight, turning), high=MAX_TURNING_ERROR_PERCENT),
        check("least distance", "% of the slot's", -nearest, low=MIN_DISTANCE_PERCENT),
        check("still closing after `valid` ended", "s", stop, high=MAX_STOP_TIME_S),
    )
    statements = (
        (
            f"the follower stays within {MAX_STRAIGHT_ERROR_PERCENT:g} % of the distance from its slot on "
            "straight legs"
        ),
        f"the follower stays within {MAX_TURNING_ERROR_PERCENT:g} % of it in turns",
        f"it never comes nearer than {MIN_DISTANCE_PERCENT:g} % of the slot's distance",
        f"in the long drop-out it has stopped closing within {MAX_STOP_TIME_S:g} s of the end of `valid`",
    )
    return Findings(
        study=NAME,
        title=TITLE,
        setting=" ".join((__doc__ or "").split()),
        seeds=len(flights),
        first_seed=first_seed,
        tables=(_table(scores, first_seed),),
        checks=checks,
        claims=tuple(
            Claim(claim=claim, where="ours", verdict=verdict(c.agrees), evidence=f"{c.ours:.3g} {c.unit}")
            for claim, c in zip(statements, checks, strict=True)
        ),
    )


def _table(scores: Sequence[Score], first_seed: int) -> Table:
    return Table(
        title="Flight by flight",
        note="Slot errors are the greatest, in percent of the slot's distance. They do not count from the "
        "break-off until the follower is back in its slot.",
        header=(
            *("seed", "slot error, straight %", "in turns %", "RMS %", "least distance %"),
            *("closing after `valid` s", "greatest distance m", "back after s"),
        ),
        rows=tuple((f"{first_seed + k}", *s) for k, s in enumerate(scores)),
    )
