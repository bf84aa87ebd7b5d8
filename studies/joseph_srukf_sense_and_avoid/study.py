"""The study of the square-root UKF with Joseph's formula, for sense and avoid.

The paper is De Vivo, Brandl, Battipede & Gili, "Joseph covariance formula adaptation to Square-Root Sigma-Point
Kalman filters" (Nonlinear Dynamics, 2017). A square-root unscented filter with a covariance update in Joseph's
form, with the Jacobian at the posterior mean, is compared with related filters: on the paper's validation, on a
phased-array radar that is jammed and loses the signal, and on GNSS with a degraded clock and without satellites.
"""

from pathlib import Path
from typing import Final

from onboard.analysis.parallel.workers import Jobs, Part, Progress, compute
from studies.joseph_srukf_sense_and_avoid import runs
from studies.joseph_srukf_sense_and_avoid.claims import claims_of
from studies.joseph_srukf_sense_and_avoid.misprints import filters, models, sensors
from studies.joseph_srukf_sense_and_avoid.runs import JOSEPH, SYMMETRIC, AllResults
from studies.joseph_srukf_sense_and_avoid.scenes import EXTREME_SIGMA, SHARP_SIGMA
from studies.joseph_srukf_sense_and_avoid.tables import tables_of
from studies.report.files import drawing, publish, require_seeds
from studies.report.findings import Check, Findings, Misprint, check, near
from studies.report.sampling import decided
from studies.tracking.outcomes import Outcome

NAME: Final = "joseph-srukf-sense-and-avoid"
TITLE: Final = "De Vivo et al.: Joseph's form for square-root sigma-point filters"
MIN_SEED_COUNT: Final = 30  # to decide the claims
VALIDATION_RUN_COUNT: Final = 10  # for each seed: the paper flies 500, and 10 of the others
FAR_RUN_COUNT: Final = 4
RAIN_RATE_MM_H: Final = 50.0
FORMULAS: Final = (*filters.MISPRINTS, *models.MISPRINTS, *sensors.MISPRINTS)


def run(
    seeds: int = 50,
    first_seed: int = 1,
    jobs: Jobs = None,
    out: Path | None = None,
    progress: Progress | None = None,
) -> Findings:
    """Run the study over `seeds` runs by radar and GNSS, and ten times as many of the validation.

    With `out`, figures and report are written (the extra `study`).
    """
    draw = drawing(__package__, out)
    every = require_seeds(seeds, first_seed)
    many = range(first_seed, first_seed + VALIDATION_RUN_COUNT * seeds)
    some = range(first_seed, first_seed + FAR_RUN_COUNT * seeds)
    parts = (
        Part(runs.fly_gnss, (every, True)),
        Part(runs.fly_validation, (many,)),
        Part(runs.fly_radar, (every,)),
        Part(runs.fly_gnss, (every, False, JOSEPH)),
        Part(runs.fly_radar, (every, RAIN_RATE_MM_H, JOSEPH)),
        Part(runs.fly_sharp, (every, SHARP_SIGMA)),
        Part(runs.fly_sharp, (every, EXTREME_SIGMA)),
        Part(runs.fly_acquisition, (some,)),
        Part(runs.fly_literal, (some,)),
        Part(runs.fly_printed_alpha, (every,)),
        Part(runs.durations, ()),
    )
    results = AllResults(*compute(parts, jobs, progress))
    found = Findings(
        study=NAME,
        title=TITLE,
        setting=_setting(len(many), seeds, results),
        seeds=seeds,
        first_seed=first_seed,
        tables=tables_of(results),
        checks=_checks(results),
        claims=claims_of(results),
        misprints=_misprints(results),
    )
    return publish(decided(found, MIN_SEED_COUNT), out, draw, results, every[:1])


def _setting(validations: int, seeds: int, m: AllResults) -> str:
    return (
        f"Validation: {validations} runs of 100 s at 2 Hz, 30 m, 1.45° and 5° (constant acceleration, q "
        f"0.01). Radar: {seeds} runs of 120 s at 10 Hz against a manoeuvring intruder, Table 4's phased "
        "array, jammed 70-85 s, no signal 95-105 s (variable turn, q 1). GNSS: the same flight by "
        f"pseudoranges at 1 Hz, {m.gnss.extra['satellites_least']:.0f} satellites, filter at 10 Hz, "
        "clock degraded 60-75 s, no satellites 90-102 s. Each run starts at a draw from P₀. Sigma points "
        "are √n σ apart, with no weight at the centre. Diverged: a numerical failure, or the last 50 steps "
        "more than 500 m off in the mean."
    )


def _checks(m: AllResults) -> tuple[Check, ...]:
    """The numbers of an independent implementation."""
    validation, radar, gnss = (results.outcomes for results in (m.validation, m.radar, m.gnss))
    sharp, extreme, far = (results.outcomes for results in (m.sharp, m.extreme, m.acquisition))
    ours, raw = radar[JOSEPH].windows, m.radar.raw
    nees = {name: far[name].windows["all"].nees for name in (JOSEPH, "srukf")}

    def diverged(outcomes: dict[str, Outcome]) -> float:
        return float(max(outcomes[name].diverged for name in SYMMETRIC))

    rows: tuple[tuple[str, str, float, float | None, float], ...] = (
        ("validation: UKF against square-root UKF", "m", m.validation.gap, 0.0, 1e-8),
        ("radar: position RMSE, nominal", "m", ours["nominal"].position, 0.0, 4.5),
        ("radar: position RMSE, jammed", "m", ours["jammed"].position, 0.0, 26.0),
        ("radar: runs that diverge, symmetric filters", "", diverged(radar), 0.0, 0.0),
        ("radar: RMSE over raw, nominal", "", ours["nominal"].position / raw["nominal"], 0.0, 0.5),
        ("radar: RMSE over raw, jammed", "", ours["jammed"].position / raw["jammed"], 0.0, 0.5),
        ("GNSS: position RMSE, nominal", "m", gnss[JOSEPH].windows["nominal"].position, 0.0, 2.8),
        ("GNSS: runs that diverge, symmetric filters", "", diverged(gnss), 0.0, 0.0),
        ("10 nm: share that fails, EKF as printed", "", extreme["ekf-plain"].failed_share, 1.0, 1.0),
        ("10 nm: share that fails, textbook downdates", "", extreme["srukf-textbook"].failed_share, 0.5, 1.0),
        ("10 nm: share that fails, Joseph", "", extreme[JOSEPH].failed_share, 0.0, 0.0),
        ("1 cm: share that fails, textbook downdates", "", sharp["srukf-textbook"].failed_share, 0.0, 0.0),
        ("eqs 21, 22 as printed: share diverged", "", m.literal.diverged_share, 0.95, 1.0),
        ("α as printed: share diverged", "", m.alpha.diverged_share, 0.75, 1.0),
        ("20 km: first position, UKF", "m", far["ukf"].windows["first"].position, 60.0, 130.0),
        ("20 km: first position, iterated", "m", far["iplf"].windows["first"].position, 4.0, 8.0),
    )
    ukf, mine = (validation[name].windows["settled"].position for name in ("ukf", JOSEPH))
    return (
        near("validation: position RMSE, UKF", "m", ukf, 88.8, 2.0),
        near("validation: position RMSE, Joseph", "m", mine, 88.8, 2.0),
        *(check(*row) for row in rows),
        check("20 km: NEES of Joseph over UKF", "", nees[JOSEPH] / nees["srukf"], 1.2),
    )


def _misprints(m: AllResults) -> tuple[Misprint, ...]:
    """All misprints; of two of them the effect in flight too."""
    literal, alpha = m.literal, m.alpha
    sound, steady = m.validation.outcomes["srukf"], m.radar.outcomes["ukf"]
    return (
        *(formula() for formula in FORMULAS),
        Misprint(
            where="eqs 21, 22",
            printed="as above",
            right="as above",
            proof="in flight: share of runs of the validation that diverge",
            printed_value=literal.diverged_share,
            right_value=sound.diverged_share,
            proven=literal.diverged > 0.5 * literal.runs and sound.diverged == 0,
        ),
        Misprint(
            where="below eq 42",
            printed="α = −v·a / |a|²",
            right="α = −v·a / |v|²",
            proof="in flight: share of runs by radar that diverge",
            printed_value=alpha.diverged_share,
            right_value=steady.diverged_share,
            proven=alpha.diverged > 0.5 * alpha.runs and steady.diverged == 0,
        ),
    )
