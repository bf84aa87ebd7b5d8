"""Followers of both autopilots behind a leader that leaves a hover and then manoeuvres.

In some flights the leader is not seen for a while, or the daemon is killed. The daemon's pipeline has its
defaults, with only the leader's size and class and the slot, 30 m behind, configured. simlink's followers fly its
setpoints as ArduCopter's GUIDED and PX4's OFFBOARD do. ArduPilot's leader flies 8 m/s, PX4's 5 m/s. Distances are
percent of the slot's.
"""

from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import Final

import numpy as np

from onboard.analysis.parallel.workers import Jobs, Part, Progress, compute
from studies.manoeuvres.flights import MANOEUVRES, SPEEDS, Autopilot, Manoeuvre, Result, flown
from studies.report.files import drawing, publish, require_seeds
from studies.report.findings import Claim, Findings, Table, verdict
from studies.report.sampling import DECISIVE_RUN_COUNT, decided

NAME: Final = "manoeuvres"
TITLE: Final = "Manoeuvres: followers of both autopilots"
FIRST_SEED: Final = 501
MIN_DISTANCE_PERCENT: Final = 200.0 / 3.0  # of the slot's distance
MAX_DISTANCE_PERCENT: Final = 200.0  # of the slot's distance, in circles
HEADER: Final = (
    *("autopilot", "leader", "flights", "followed at the end"),
    *("least distance %", "median %", "greatest distance %", "median %"),
    *("off its slot %", "at most %", "images with the leader %", "valid %"),
    *("degrees off its side", "false advice"),
)

Row = tuple[Autopilot, Manoeuvre, Sequence[Result]]


def run(
    seeds: int = DECISIVE_RUN_COUNT,
    first_seed: int = FIRST_SEED,
    jobs: Jobs = None,
    out: Path | None = None,
    progress: Progress | None = None,
    manoeuvres: Sequence[Manoeuvre] = MANOEUVRES,
) -> Findings:
    """The study over `seeds` flights of each manoeuvre and autopilot."""
    draw = drawing(__package__, out)
    numbers = require_seeds(seeds, first_seed)
    cases = list(product(SPEEDS, manoeuvres))
    results: list[Result] = compute([Part(flown, (*case, n)) for case in cases for n in numbers], jobs, progress)
    rows = [(*case, results[k * seeds : (k + 1) * seeds]) for k, case in enumerate(cases)]
    return publish(decided(findings(rows, first_seed), DECISIVE_RUN_COUNT), out, draw, rows)


def findings(rows: Sequence[Row], first_seed: int) -> Findings:
    """The results of flights with successive seeds."""
    return Findings(
        study=NAME,
        title=TITLE,
        setting=" ".join((__doc__ or "").split()),
        seeds=len(rows[0][2]),
        first_seed=first_seed,
        tables=(
            Table(
                title="Manoeuvre by manoeuvre",
                note="The worst and the median flight. Distances count from 5 s after the mode is entered. "
                "Followed: seen, valid, at 50 to 150 % of the slot's distance and within 60 degrees of its side "
                "of the leader for the last 5 s. A leader that flies back for 8 s has turned: its other side "
                "counts. False advice: about the set-up, which is right.",
                header=HEADER,
                rows=tuple((autopilot, m.name, *_row(found)) for autopilot, m, found in rows),
            ),
        ),
        claims=tuple(claim for autopilot in SPEEDS for claim in _claims(autopilot, rows)),
    )


def _row(found: Sequence[Result]) -> tuple[float, ...]:
    least, greatest, off, farthest, seen, valid, aside, followed, advised = np.array(found, float).T
    return (
        float(len(found)),
        float(followed.sum()),
        *(float(least.min()), float(np.median(least)), float(greatest.max()), float(np.median(greatest))),
        *(float(np.median(off)), float(farthest.max())),
        *(float(seen.mean()), float(valid.mean()), float(aside.max()), float(advised.sum())),
    )


def _claims(autopilot: Autopilot, rows: Sequence[Row]) -> tuple[Claim, ...]:
    mine = [(m, found) for name, m, found in rows if name == autopilot]
    near = [m.name for m, found in mine if min(r.least for r in found) < MIN_DISTANCE_PERCENT]
    far = [
        m.name
        for m, found in mine
        if m.name.startswith("circle") and max(r.greatest for r in found) > MAX_DISTANCE_PERCENT
    ]
    lost = [m.name for m, found in mine if not all(r.followed for r in found)]
    advised = [m.name for m, found in mine if any(r.advised for r in found)]
    said = (
        (f"{autopilot}: no flight comes nearer than two thirds of the slot's distance", near),
        (f"{autopilot}: in circles no flight is led farther than twice it", far),
        (f"{autopilot}: after each manoeuvre, drop-out and restart the leader is followed again", lost),
        (f"{autopilot}: no flight is given advice about the set-up, which is right", advised),
    )
    return tuple(
        Claim(
            claim=claim,
            where="ours",
            verdict=verdict(not misses),
            evidence=f"misses: {'; '.join(misses) or 'none'}",
        )
        for claim, misses in said
    )
