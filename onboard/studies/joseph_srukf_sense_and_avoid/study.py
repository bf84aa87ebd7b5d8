"""De Vivo, Brandl, Battipede & Gili, "Joseph covariance formula adaptation to Square-Root Sigma-Point Kalman
filters" (Nonlinear Dynamics, 2017).

A square-root unscented filter whose covariance is updated in Joseph's form with the Jacobian at the posterior
mean, against its neighbours: on the paper's validation, on a phased-array radar that is jammed and loses the
signal, and on GNSS with a degraded clock and without satellites.
"""

from importlib import import_module
from pathlib import Path
from typing import Final

import msgspec

from onboard.studies.joseph_srukf_sense_and_avoid import misprints_filters, misprints_models, misprints_sensors
from onboard.studies.joseph_srukf_sense_and_avoid import runs as flights
from onboard.studies.joseph_srukf_sense_and_avoid.claims import Measured, claims_of
from onboard.studies.joseph_srukf_sense_and_avoid.tables import tables_of
from onboard.studies.report import findings as report
from onboard.studies.report.findings import Findings, Misprint
from onboard.studies.report.workers import Part, Progress, compute, require_seeds, write
from onboard.studies.tracking.outcomes import Outcome

NAME: Final = "joseph-srukf-sense-and-avoid"
TITLE: Final = "De Vivo et al.: Joseph's form for square-root sigma-point filters"
VALIDATION_RUNS: Final = 10  # for each seed: the paper flies 500, and 10 of the others
FAR_RUNS: Final = 4
RAIN_MM_H: Final = 50.0
MINE: Final = "srukf-joseph"


def run(
    seeds: int = 50,
    first_seed: int = 1,
    jobs: int | None = None,
    out: Path | None = None,
    progress: Progress | None = None,
) -> Findings:
    """The study over `seeds` runs by radar and GNSS, ten times as many of the validation; with `out`, figures and
    report are written (the extra `study`)."""
    if out is not None:
        import_module("matplotlib")
    every = require_seeds(seeds, first_seed)
    many = range(first_seed, first_seed + VALIDATION_RUNS * seeds)
    some = range(first_seed, first_seed + FAR_RUNS * seeds)
    measured = Measured(
        *compute(
            [
                Part(flights.fly_gnss, (every,)),
                Part(flights.fly_validation, (many,)),
                Part(flights.fly_radar, (every,)),
                Part(flights.fly_gnss, (every, False, MINE)),
                Part(flights.fly_radar, (every, RAIN_MM_H, MINE)),
                Part(flights.fly_sharp, (every, True)),
                Part(flights.fly_sharp, (every, False)),
                Part(flights.fly_acquisition, (some,)),
                Part(flights.fly_literal, (some,)),
                Part(flights.fly_printed_alpha, (every,)),
                Part(flights.durations, ()),
            ],
            jobs,
            progress,
        )
    )
    found = Findings(
        study=NAME,
        title=TITLE,
        setting=(
            f"Validation: {len(many)} runs of 100 s at 2 Hz, 30 m, 1.45° and 5° (constant acceleration, q "
            f"0.01). Radar: {seeds} runs of 120 s at 10 Hz against a manoeuvring intruder, Table 4's phased "
            "array, jammed 70-85 s, no signal 95-105 s (variable turn, q 1). GNSS: the same flight by "
            f"pseudoranges at 1 Hz, {measured.gnss.extra['satellites_least']:.0f} satellites, filter at 10 Hz, "
            "clock degraded 60-75 s, no satellites 90-102 s. Each run starts at a draw from P₀. Sigma points "
            "are √n σ apart, with no weight at the centre. Diverged: a numerical failure, or the last 50 steps "
            "more than 500 m off in the mean."
        ),
        seeds=seeds,
        first_seed=first_seed,
        tables=tables_of(measured),
        checks=_checks(measured),
        claims=claims_of(measured),
        misprints=_misprints(measured),
        figures=(),
    )
    if out is not None:
        from onboard.studies.joseph_srukf_sense_and_avoid import figures as avoid_figures  # noqa: PLC0415 - matplotlib is an extra

        found = msgspec.structs.replace(found, figures=avoid_figures.draw(measured, every[:1], out))
        write(found, out)
    return found


def _checks(m: Measured) -> tuple[report.Check, ...]:
    validation, radar, gnss = (flown.outcomes for flown in (m.validation, m.radar, m.gnss))
    ours = radar[MINE].windows

    def diverged(outcomes: dict[str, Outcome]) -> float:
        return float(max(outcomes[name].diverged for name in ("ekf", "ukf", "srukf", MINE)))

    def failed(outcomes: dict[str, Outcome], name: str) -> float:
        return outcomes[name].failed / outcomes[name].runs

    sharp, double, far = (flown.outcomes for flown in (m.sharp_single, m.sharp_double, m.acquisition))
    return (
        report.near(
            "validation: position RMSE, UKF", "m", validation["ukf"].windows["settled"].position, 88.8, 2.0
        ),
        report.near(
            "validation: position RMSE, Joseph", "m", validation[MINE].windows["settled"].position, 88.8, 2.0
        ),
        report.check("validation: UKF against square-root UKF", "m", m.validation.gap, 0.0, 1e-8),
        report.check("radar: position RMSE, nominal", "m", ours["nominal"].position, 0.0, 4.5),
        report.check("radar: position RMSE, jammed", "m", ours["jammed"].position, 0.0, 26.0),
        report.check("radar: runs that diverge, symmetric filters", "", diverged(radar), 0.0, 0.0),
        report.check(
            "radar: RMSE over raw, nominal", "", ours["nominal"].position / m.radar.raw["nominal"], 0.0, 0.5
        ),
        report.check(
            "radar: RMSE over raw, jammed", "", ours["jammed"].position / m.radar.raw["jammed"], 0.0, 0.5
        ),
        report.check("GNSS: position RMSE, nominal", "m", gnss[MINE].windows["nominal"].position, 0.0, 2.8),
        report.check("GNSS: runs that diverge, symmetric filters", "", diverged(gnss), 0.0, 0.0),
        report.check("float32: share that fails, EKF as printed", "", failed(sharp, "ekf-plain"), 1.0, 1.0),
        report.check(
            "float32: share that fails, textbook downdates", "", failed(sharp, "srukf-textbook"), 0.1, 0.9
        ),
        report.check("float32: share that fails, Joseph", "", failed(sharp, MINE), 0.0, 0.0),
        report.check(
            "float64: share that fails, textbook downdates", "", failed(double, "srukf-textbook"), 0.0, 0.0
        ),
        report.check("eqs 21, 22 as printed: share diverged", "", m.literal.diverged / m.literal.runs, 0.95, 1.0),
        report.check("α as printed: share diverged", "", m.alpha.diverged / m.alpha.runs, 0.75, 1.0),
        report.check("20 km: first position, UKF", "m", far["ukf"].windows["first"].position, 60.0, 130.0),
        report.check("20 km: first position, iterated", "m", far["iplf"].windows["first"].position, 4.0, 8.0),
        report.check("20 km: NEES of Joseph over UKF", "", _overconfident(m), 1.2),
    )


def _overconfident(m: Measured) -> float:
    windows = (m.acquisition.outcomes[name].windows["all"].nees for name in (MINE, "srukf"))
    joseph, production = windows
    return joseph / production


def _misprints(m: Measured) -> tuple[Misprint, ...]:
    """All of them; of two, what they do in flight as well."""
    formulas = (*misprints_filters.MISPRINTS, *misprints_models.MISPRINTS, *misprints_sensors.MISPRINTS)
    literal, alpha = m.literal, m.alpha
    sound, steady = m.validation.outcomes["srukf"], m.radar.outcomes["ukf"]
    return (
        *(formula() for formula in formulas),
        Misprint(
            where="eqs 21, 22",
            printed="as above",
            right="as above",
            proof="in flight: share of runs of the validation that diverge",
            printed_value=literal.diverged / literal.runs,
            right_value=sound.diverged / sound.runs,
            proven=literal.diverged > 0.5 * literal.runs and sound.diverged == 0,
        ),
        Misprint(
            where="below eq 42",
            printed="α = −v·a / |a|²",
            right="α = −v·a / |v|²",
            proof="in flight: share of runs by radar that diverge",
            printed_value=alpha.diverged / alpha.runs,
            right_value=steady.diverged / steady.runs,
            proven=alpha.diverged > 0.5 * alpha.runs and steady.diverged == 0,
        ),
    )
