"""Lazarov, Kabakchiev, Dimitrov & Minchev, "Kalman Tracking Filter in 3-D Space".

A linear Kalman filter on a continuous Wiener process acceleration, whose process noise is misprinted (eq 14). The
paper gives no sampling interval; half a second here.
"""

from pathlib import Path
from typing import Final

import numpy as np

from onboard.analysis.parallel.workers import Jobs, Part, Progress, compute
from onboard.arrays import Array
from onboard.filters import kalman
from onboard.filters.belief import Belief
from onboard.filters.discretisation import wiener_acceleration
from onboard.filters.gating import mean_bounds
from studies.cwpa_kalman_tracker_3d.claims import claims_of, misprints_of
from studies.cwpa_kalman_tracker_3d.runs import (
    DENSITY,
    DT,
    P0,
    RUNS_PER_SEED,
    STEPS,
    H,
    R,
    Scores,
    fly,
    fraction_noise,
    printed_noise,
    score,
)
from studies.report.files import drawing, publish, require_seeds
from studies.report.findings import Cell, Check, Findings, Table, check, near
from studies.report.sampling import decided

NAME: Final = "cwpa-kalman-tracker-3d"
TITLE: Final = "Lazarov et al.: a linear Kalman tracker in three dimensions"
MIN_SEED_COUNT: Final = 20  # to decide the claims
HEADER: Final = (
    *("filter", "position m", "±", "velocity m/s", "acceleration m/s²"),
    *("raw m", "bound m", "NEES", "±", "in 95 %"),
)
GOLDEN: Final = (4.427842, 3.639966, 2.406474, 0.442784, 0.257108, 0.074647)


def run(
    seeds: int = 50,
    first_seed: int = 1,
    jobs: Jobs = None,
    out: Path | None = None,
    progress: Progress | None = None,
) -> Findings:
    """Run the study over `seeds` times 20 runs.

    With `out`, figures and report are written (the extra `study`).
    """
    draw = drawing(__package__, out)
    every = require_seeds(seeds, first_seed)
    cases = ((True, None), (False, None), (True, printed_noise(DT, DENSITY)))
    parts = [Part(score, (every, at_random, noise)) for at_random, noise in cases]
    drawn, rest, printed = compute(parts, jobs if jobs is not None else 1, progress)  # each takes a second
    found = Findings(
        study=NAME,
        title=TITLE,
        setting=(
            f"{seeds * RUNS_PER_SEED} runs of {STEPS} steps on the paper's model, {DT:g} s apart (an "
            "assumption: the paper states no interval), q 0.2, R = diag(10, 8, 5), P₀ as printed. The bound is "
            "the posterior Cramér–Rao bound, which a Kalman filter on its own linear model attains."
        ),
        seeds=seeds,
        first_seed=first_seed,
        tables=(_table(drawn, rest, printed),),
        checks=_checks(drawn),
        claims=claims_of(drawn, rest, printed),
        misprints=misprints_of(drawn, printed),
    )
    return publish(decided(found, MIN_SEED_COUNT), out, draw, fly(first_seed, 1, drawn=False))


def _table(*scores: Scores) -> Table:
    names = (
        "right Q, start drawn from P₀",
        "right Q, start at rest (the paper)",
        "Q of eq 14, start drawn from P₀",
    )
    low, high = mean_bounds(9, 50)
    return Table(
        title="Results",
        note="Root mean squares of vector lengths over all steps. NEES of nine states: 9 (95 % of 50 runs: "
        f"{low:.1f} to {high:.1f}); failed: it is negative, so the covariance is none. ±: standard errors, by the "
        "scatter over runs.",
        header=HEADER,
        rows=tuple((name, *_cells(s)) for name, s in zip(names, scores, strict=True)),
    )


def _cells(s: Scores) -> tuple[Cell, ...]:
    figures = (s.position, s.position_error, s.velocity, s.acceleration)
    shown: tuple[Cell, ...] = ("failed",) * len(figures) if s.failed else figures
    consistency: tuple[Cell, ...] = ("failed",) * 3 if s.failed else (s.nees, s.nees_error, s.inside)
    return (*shown, s.raw, s.bound, *consistency)


def final() -> tuple[Array, Array]:
    """Return covariance (9, 9) and gain (9, 3) after the last step, by the package's own filter."""
    F, Q = wiener_acceleration(DT, DENSITY)
    belief, gain = Belief(np.zeros(9), P0), np.zeros((9, 3))
    for _ in range(STEPS):
        belief = kalman.update(kalman.predict(belief, F, Q), np.zeros(3), H, R).belief
        gain = belief.covariance @ H.T @ np.linalg.inv(R)  # K = P+ H^T R^-1
    return belief.covariance, gain


def _checks(drawn: Scores) -> tuple[Check, ...]:
    P, K = final()
    ours = (*np.diag(P)[:3], K[0, 0], K[3, 0], K[6, 0])
    names = ("P₅₀ x", "P₅₀ y", "P₅₀ z", "gain x", "gain vx", "gain ax")
    units = ("m²",) * 3 + ("", "1/s", "1/s²")
    exact = np.abs(wiener_acceleration(DT, DENSITY).Q - fraction_noise(DT, DENSITY)).max()
    return (
        *(near(n, u, float(v), g, 5e-7) for n, u, v, g in zip(names, units, ours, GOLDEN, strict=True)),
        near("mean NEES of 9 states", "", drawn.nees, 9.0, 0.3),
        check("closed Q against the matrix fraction", "", float(exact), 0.0, 1e-15),
        near("position RMSE over the Cramér–Rao bound", "", drawn.position / drawn.bound, 1.0, 0.03),
    )
