"""The study of a UKF that tracks a launch vehicle by radar.

The paper is Varaprasad, Bhaskara Rao, Narayana Rao & Seshagiri Rao, "Trajectory Estimation of a Satellite Launch
Vehicle Using Unscented Kalman Filter from Noisy Radar Measurements". A constant-acceleration filter uses range,
azimuth and elevation of an ascent out to 1919 km. The paper's trajectory and process noise are not public; ours is
a PSLV-like ascent with several process noises.
"""

from pathlib import Path
from typing import Final

from onboard.analysis.parallel.workers import Jobs, Part, Progress, compute
from studies.report.files import drawing, publish, require_seeds
from studies.report.findings import Check, Findings, check, near
from studies.report.sampling import decided
from studies.ukf_radar_launch_vehicle.claims import claims_of
from studies.ukf_radar_launch_vehicle.runs import DENSITY, NAMES, STAGED_DENSITY, Results, bound, fly
from studies.ukf_radar_launch_vehicle.tables import main_table, sweep_table

NAME: Final = "ukf-radar-launch-vehicle"
TITLE: Final = "Varaprasad et al.: a launch vehicle by radar, unscented and extended"
MIN_SEED_COUNT: Final = 30  # to decide the claims: the sweep flies a fifth of them
SWEPT: Final = (0.01, 0.1, 10.0, 100.0, 1000.0)  # q beside 1
SWEEP_SHARE: Final = 5  # seeds to each one of the sweep, whose answers differ by factors
MAIN: Final = ("ekf", "ukf", "ukf-scaled", "ekf-plain")
PAIR: Final = MAIN[:2]


def run(
    seeds: int = 50,
    first_seed: int = 1,
    jobs: Jobs = None,
    out: Path | None = None,
    progress: Progress | None = None,
) -> Findings:
    """Run the study over `seeds` ascents with each noise.

    With `out`, figures and report are written there (the extra `study`).
    """
    draw = drawing(__package__, out)
    every = require_seeds(seeds, first_seed)
    few = every[: max(1, seeds // SWEEP_SHARE)]
    parts = [
        Part(fly, (every, 1.0, DENSITY, MAIN)),
        Part(fly, (every, 3.0, DENSITY, PAIR)),
        Part(fly, (every, 1.0, STAGED_DENSITY, PAIR, True)),
        *(Part(fly, (few, 1.0, q, PAIR)) for q in SWEPT),
        *(Part(bound, (1.0, q)) for q in (min(SWEPT), DENSITY)),
    ]
    single, triple, staged, *rest = compute(parts, jobs, progress)
    sweep = dict(zip(SWEPT, rest, strict=False))
    bounds = dict(zip((min(SWEPT), DENSITY), rest[len(SWEPT) :], strict=True))
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
        tables=(main_table(single, triple, staged), sweep_table({**sweep, DENSITY: single}, bounds)),
        checks=_checks(single),
        claims=claims_of(single, triple, [single, staged, *sweep.values()], bounds[min(SWEPT)]),
    )
    return publish(decided(found, MIN_SEED_COUNT), out, draw, single, triple)


def _checks(single: Results) -> tuple[Check, ...]:
    ukf, plain = single.outcomes["ukf"], single.outcomes["ekf-plain"]
    expected = zip(NAMES, (4.9, 19.4, 70.0), (0.25, 1.0, 3.5), strict=True)
    return (
        *(
            near(f"position RMS, {n}, q 1", "m", ukf.windows[n].position, m, tolerance)
            for n, m, tolerance in expected
        ),
        check("EKF against UKF, 262-500 s", "mm", 1e3 * single.gap, 0.0, 5.0),
        check("EKF never made symmetric: share that fails", "", plain.failed_share, 1.0, 1.0),
        check("EKF never made symmetric: median time of failure", "s", plain.failed_at, 30.0, 60.0),
        check("UKF diverged", "", float(ukf.diverged), 0.0, 0.0),
    )
