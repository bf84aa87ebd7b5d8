"""Varaprasad, Bhaskara Rao, Narayana Rao & Seshagiri Rao, "Trajectory Estimation of a Satellite Launch Vehicle
Using Unscented Kalman Filter from Noisy Radar Measurements".

A constant-acceleration filter on range, azimuth and elevation of an ascent out to 1919 km. The paper's
trajectory and process noise are not public; ours is a PSLV-like ascent, and process noise is swept.
"""

from importlib import import_module
from pathlib import Path
from typing import Final

import msgspec

from onboard.filters.gating import mean_bounds
from onboard.studies.report import findings as report
from onboard.studies.report.findings import Cell, Findings, Table
from onboard.studies.report.workers import Part, Progress, compute, require_seeds, write
from onboard.studies.tracking.outcomes import Outcome
from onboard.studies.ukf_radar_launch_vehicle import runs
from onboard.studies.ukf_radar_launch_vehicle.claims import claims_of
from onboard.studies.ukf_radar_launch_vehicle.runs import Flown

NAME: Final = "ukf-radar-launch-vehicle"
TITLE: Final = "Varaprasad et al.: a launch vehicle by radar, unscented and extended"
SWEPT: Final = (0.01, 0.1, 10.0, 100.0, 1000.0)  # q beside 1
SWEEP_SHARE: Final = 5  # one seed in so many for the sweep: its answers differ by factors
MAIN: Final = ("ekf", "ukf", "ukf-scaled", "ekf-plain")


def run(
    seeds: int = 50,
    first_seed: int = 1,
    jobs: int | None = None,
    out: Path | None = None,
    progress: Progress | None = None,
) -> Findings:
    """The study over `seeds` ascents with each noise; with `out`, figures and report are written (the extra
    `study`)."""
    if out is not None:
        import_module("matplotlib")
    every = require_seeds(seeds, first_seed)
    few = every[: max(1, seeds // SWEEP_SHARE)]
    parts = [
        Part(runs.fly, (every, 1.0, runs.DENSITY, MAIN)),
        Part(runs.fly, (every, 3.0, runs.DENSITY, ("ekf", "ukf"))),
        Part(runs.fly, (every, 1.0, runs.STAGED, ("ekf", "ukf"), True)),
        *(Part(runs.fly, (few, 1.0, q, ("ekf", "ukf"))) for q in SWEPT),
        *(Part(runs.bound, (1.0, q)) for q in (min(SWEPT), runs.DENSITY)),
    ]
    single, triple, staged, *rest = compute(parts, jobs, progress)
    sweep: list[Flown] = rest[: len(SWEPT)]
    bounds: list[dict[str, float]] = rest[len(SWEPT) :]
    found = Findings(
        study=NAME,
        title=TITLE,
        setting=(
            f"{seeds} ascents of 500 s at 10 Hz, radar noise 10 m, 0.2 and 0.2 mrad, out to 1919 km. Windows "
            "leave out 0.5 s before to 5 s after each of 15 events of the thrust, as the paper leaves out "
            "burn-outs and separations. Runs begin at a draw from P₀ (100 m, 20 m/s, 3 m/s²). The sweep flies "
            f"{len(few)} of them."
        ),
        seeds=seeds,
        first_seed=first_seed,
        tables=(_table(single, triple, staged), _sweep_table(sweep, single, bounds)),
        checks=_checks(single),
        claims=claims_of(single, triple, [single, staged, *sweep], bounds[0]),
        misprints=(),
        figures=(),
    )
    if out is not None:
        from onboard.studies.ukf_radar_launch_vehicle import figures as launch_figures  # noqa: PLC0415 - matplotlib is an extra

        found = msgspec.structs.replace(found, figures=launch_figures.draw(single, triple, out))
        write(found, out)
    return found


def _table(single: Flown, triple: Flown, staged: Flown) -> Table:
    names = [f"{a}-{b} s" for a, b in runs.WINDOWS]
    groups = (("1σ, q 1", single), ("3σ, q 1", triple), (f"1σ, q {runs.STAGED:g}, raised at events", staged))
    rows: list[tuple[Cell, ...]] = []
    low, high = mean_bounds(9, single.outcomes[0].runs)
    for noise, flown in groups:
        for o in flown.outcomes:
            position = [o.windows[n].position for n in names]
            velocity = [o.windows[n].velocity for n in names]
            nees = o.windows[names[-1]].nees
            rows.append((noise, o.label, *position, *velocity, nees, flown.within[o.tracker], _failures(o)))
    return Table(
        title="Results",
        note="Root mean squares of the lengths of error vectors, by window of flight, over the runs that did "
        f"not fail. NEES of nine states in the last window: 9 when consistent (95 %: {low:.1f} to {high:.1f}, "
        "were each run one sample). Within 1σ: components of position and velocity by the filter's own "
        "account; 0.683 when it is right.",
        header=(
            "radar noise",
            "filter",
            *(f"position m, {n}" for n in names),
            *(f"velocity m/s, {n}" for n in names),
            "NEES",
            "within 1σ",
            "failed",
        ),
        rows=tuple(rows),
    )


def _sweep_table(sweep: list[Flown], single: Flown, bounds: list[dict[str, float]]) -> Table:
    names = [f"{a}-{b} s" for a, b in runs.WINDOWS]
    flights = sorted([*zip(SWEPT, sweep, strict=True), (runs.DENSITY, single)], key=lambda pair: pair[0])
    known = {min(SWEPT): bounds[0], runs.DENSITY: bounds[1]}
    rows = [
        (
            q,
            *(flown.outcomes[1].windows[n].position for n in names),
            *(flown.outcomes[1].windows[n].velocity for n in names),
            1e3 * flown.gap,
            *(known.get(q, {}).get(n) for n in names),
        )
        for q, flown in flights
    ]
    return Table(
        title="Every process noise",
        note="The unscented filter. The last columns: how far the extended filter's position is from it after "
        "262 s, and the least position error of any filter that knows as much of the motion as q says "
        "(posterior Cramér–Rao bound; the true motion is smoother than q = 1 says, so a filter may be better "
        "than that).",
        header=(
            "q (m/s³)²/Hz",
            *(f"position m, {n}" for n in names),
            *(f"velocity m/s, {n}" for n in names),
            "EKF − UKF mm",
            *(f"bound m, {n}" for n in names),
        ),
        rows=tuple(rows),
    )


def _failures(o: Outcome) -> str:
    return f"{o.failed} of {o.runs}" + (f", median {o.failed_at:.0f} s" if o.failed else "")


def _checks(single: Flown) -> tuple[report.Check, ...]:
    ukf = next(o for o in single.outcomes if o.tracker == "ukf")
    plain = next(o for o in single.outcomes if o.tracker == "ekf-plain")
    expected = {"10-112 s": (4.9, 0.25), "112-262 s": (19.4, 1.0), "262-500 s": (70.0, 3.5)}
    positions = [
        report.near(f"position RMS, {name}, q 1", "m", ukf.windows[name].position, value, tolerance)
        for name, (value, tolerance) in expected.items()
    ]
    return (
        *positions,
        report.check("EKF against UKF, 262-500 s", "mm", 1e3 * single.gap, 0.0, 5.0),
        report.check("EKF never made symmetric: share that fails", "", plain.failed / plain.runs, 1.0, 1.0),
        report.check("EKF never made symmetric: median time of failure", "s", plain.failed_at, 30.0, 60.0),
        report.check("UKF diverged", "", float(ukf.diverged), 0.0, 0.0),
    )
