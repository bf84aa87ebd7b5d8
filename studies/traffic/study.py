"""Live traffic through the daemon's pipeline, judged by our own requirements.

simlink's scenario `traffic` is flown from bytes for several seeds. There is no paper. Closest approaches are
predicted along straight lines or steady turns. Those of turning aircraft are counted separately; those of aircraft
without detections or messages for a while before are not counted, as they are unpredictable.

Coverage is that of the position's 95 % ellipsoid. Its errors are correlated in time: those of our own attitude,
common to all aircraft, over ten seconds, those of GNSS over a minute. Three minutes are a few independent draws,
so that one aircraft's coverage in one flight scatters by several percent. It is therefore judged over all flights,
with a standard error from their scatter.
"""

import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from onboard.analysis.parallel.workers import Jobs, Part, Progress, compute
from onboard.config import parse_config
from onboard.estimators.traffic.config import FilterName
from onboard.messages import Estimate, TrafficTruth, Truth
from onboard.pipeline import Pipeline
from simlink.scenarios.describe import daemon_config
from simlink.scenarios.scenario import load_scenario
from simlink.simulation import datagrams
from studies.report.files import publish, require_seeds
from studies.report.findings import Cell, Check, Claim, Findings, Table, check, verdict
from studies.report.sampling import decided
from studies.traffic.scores import PREDICTION_HORIZON_S, AircraftScore, Encounter, TrafficScore, score_traffic

NAME: Final = "traffic"
TITLE: Final = "Traffic: twenty aircraft by ADS-B, MAVLink and radar"
MIN_SEED_COUNT: Final = 20  # to decide the claims
SCENARIO: Final = "traffic"
STRAIGHT, STEADY, CHANGING = "straight", "steady", "changing"
LOW, HIGH = 93.0, 97.0  # percent: what a 95 % ellipsoid is to hold
FIRST_SEED: Final = 501  # settings were chosen on seeds 1 to 4 and 1001 to 1016, or with 201 to 424 in view


class Totals(NamedTuple):
    """Totals over all flights and aircraft."""

    swaps: int
    false_tracks: int
    missing_s: float
    coverage: float
    encounters: dict[str, list[Encounter]]


def fly(seed: int, filter_: FilterName = "imm", duration: float | None = None) -> TrafficScore:
    """Score one flight, computed faster than real time."""
    return flight(seed, filter_, duration)[0]


def flight(seed: int, filter_: FilterName, duration: float | None) -> tuple[TrafficScore, Pipeline]:
    """The score of one flight, and the pipeline at its end."""
    scenario = load_scenario(SCENARIO)
    config = tomllib.loads(daemon_config(scenario))
    config["estimator"] = {"traffic": config["estimator"]["traffic"] | {"filter": filter_}}
    pipeline = Pipeline(parse_config(config))
    truth: list[TrafficTruth] = []

    def estimates() -> Iterator[Estimate]:
        for item in datagrams(scenario, seed, duration, "none"):
            if isinstance(item, TrafficTruth):
                truth.append(item)
            elif not isinstance(item, Truth):
                yield from (e for e in pipeline.feed(item) if isinstance(e, Estimate))

    return score_traffic(list(estimates()), truth), pipeline


def run(
    seeds: int = 4,
    first_seed: int = FIRST_SEED,
    jobs: Jobs = None,
    out: Path | None = None,
    progress: Progress | None = None,
) -> Findings:
    """The study over `seeds` flights of three minutes; with `out`, the report is written."""
    every = require_seeds(seeds, first_seed)
    scores = compute([Part(fly, (seed,)) for seed in every], jobs, progress)
    return publish(decided(findings(scores, first_seed), MIN_SEED_COUNT), out)


def findings(scores: Sequence[TrafficScore], first_seed: int) -> Findings:
    """The results of flights with successive seeds."""
    rows = tuple(_row([score.aircraft[k] for score in scores]) for k in range(len(scores[0].aircraft)))
    totals = _totals(scores)
    return Findings(
        study=NAME,
        title=TITLE,
        setting=f"{len(scores)} flights of simlink's scenario `{SCENARIO}` through the pipeline, filter imm.",
        seeds=len(scores),
        first_seed=first_seed,
        tables=(_table(rows),),
        checks=_checks(totals),
        claims=(*_claims(totals), _coverage_claim(totals.coverage, rows)),
    )


def _totals(scores: Sequence[TrafficScore]) -> Totals:
    aircraft = [a for score in scores for a in score.aircraft]
    kinds = {
        a.name: CHANGING if a.a_lat.amplitude else STEADY if a.a_lat.mean else STRAIGHT
        for a in load_scenario(SCENARIO).traffic.aircraft
    }
    return Totals(
        swaps=sum(len(score.swaps) for score in scores),
        false_tracks=sum(len(score.false_tracks) for score in scores),
        missing_s=sum(a.missing_s for a in aircraft),
        coverage=100.0 * sum(a.inside for a in aircraft) / sum(a.samples for a in aircraft),
        encounters={
            kind: [e for a in aircraft if kinds.get(a.name, STRAIGHT) == kind for e in a.encounters]
            for kind in (STRAIGHT, STEADY, CHANGING)
        },
    )


def _table(rows: tuple[tuple[Cell, ...], ...]) -> Table:
    return Table(
        title="Aircraft by aircraft",
        note=f"All flights together. Closest approach: as predicted {PREDICTION_HORIZON_S:g} s before, good "
        "within 15 m or 10 %. Untracked: seconds in which detections or messages came and no valid track "
        "followed the aircraft.",
        header=(
            "aircraft",
            "in 95 % ellipsoid, %",
            "± (sampling), %",
            "position RMSE, m",
            "untracked, s",
            "approaches",
            "good",
            "valid %",
        ),
        rows=rows,
    )


def _row(each: Sequence[AircraftScore]) -> tuple[Cell, ...]:
    """Return the row of one aircraft, over all flights."""
    encounters = [e for a in each for e in a.encounters if e.known]
    samples = sum(a.samples for a in each)
    return (
        each[0].name,
        100.0 * sum(a.inside for a in each) / samples if samples else None,
        _sampling(each) if samples else None,
        (sum(a.rmse**2 for a in each) / len(each)) ** 0.5,
        sum(a.missing_s for a in each),
        float(len(encounters)),
        float(sum(e.predicted_well for e in encounters)),
        _valid_percent(each),
    )


def _valid_percent(each: Sequence[AircraftScore]) -> float | None:
    """Share of the time in which the aircraft could be tracked and a valid track followed it."""
    trackable = sum(a.trackable_s for a in each)
    return 100.0 * (1.0 - sum(a.missing_s for a in each) / trackable) if trackable else None


def _sampling(each: Sequence[AircraftScore]) -> float:
    """Standard error of the coverage, percent, by the scatter from flight to flight."""
    samples, inside = (np.array([getattr(a, f) for a in each], float) for f in ("samples", "inside"))
    off = inside - samples * inside.sum() / samples.sum()
    few = max(len(each) - 1, 1)
    return float(100.0 * np.sqrt(len(each) / few * np.sum(off**2)) / samples.sum())


def _checks(totals: Totals) -> tuple[Check, ...]:
    straight, steady = (_good_percent(totals.encounters[kind]) for kind in (STRAIGHT, STEADY))
    return (
        check("tracks that changed from one aircraft to another", "", totals.swaps, high=0),
        check("tracks of nothing", "", totals.false_tracks, high=0),
        check("time untracked, all aircraft", "s", totals.missing_s, high=0.5),
        check("truth in the 95 % ellipsoid, all aircraft", "%", totals.coverage, LOW, HIGH),
        check("closest approaches predicted well, aircraft that fly straight", "%", straight, 95.0),
        check("closest approaches predicted well, aircraft that keep their turn", "%", steady, 95.0),
    )


def _claims(totals: Totals) -> tuple[Claim, ...]:
    straight, steady, changing = totals.encounters.values()
    every = straight + steady + changing
    good, known = _well(every), [e for e in straight + steady if e.known]
    return (
        _claim(
            "no track swap", totals.swaps == 0, f"{totals.swaps} swaps, {totals.false_tracks} tracks of nothing"
        ),
        _claim("no lost track that has detections", totals.missing_s < 0.5, f"{totals.missing_s:.1f} s untracked"),
        Claim(
            claim=f"closest approach, {PREDICTION_HORIZON_S:g} s before, within 10 % or 15 m (95 % of all)",
            where="required",
            verdict=verdict(good >= 95.0, _good_percent(known) >= 95.0),
            evidence=f"{good:.1f} % of all {len(every)}. Only of aircraft that keep their course or their turn, "
            f"and that had detections or messages shortly before: {_good_percent(known):.1f} % of {len(known)}; "
            f"{_good_count(straight)} that fly straight, {_good_count(steady)} that keep their turn. Of those "
            f"that change their turn {_good_count(changing)}",
        ),
    )


def _coverage_claim(coverage: float, rows: Sequence[tuple[Cell, ...]]) -> Claim:
    """Return the claim that every aircraft's coverage is inside the bounds.

    It does not hold if one is outside by more than twice its standard error.
    """
    little: list[str] = []
    surely: list[str] = []
    for name, share, error, *_ in rows:
        if share is None or error is None:
            continue
        off = max(LOW - float(share), float(share) - HIGH)
        if off > 0:
            (surely if off > 2.0 * float(error) else little).append(f"{name} {share:.1f} ± {error:.1f} %")
    return Claim(
        claim="each track's 95 % ellipsoid holds 93 to 97 % of the truth",
        where="required",
        verdict=verdict(not surely and not little, not surely),
        evidence=f"{coverage:.1f} % over all. Outside these bounds by more than twice the error of sampling: "
        f"{', '.join(surely) or 'none'}; by less: {', '.join(little) or 'none'}",
    )


def _good_count(encounters: Sequence[Encounter]) -> str:
    known = [e for e in encounters if e.known]
    return f"{sum(e.predicted_well for e in known)} of {len(known)}"


def _good_percent(encounters: Sequence[Encounter]) -> float:
    known = [e for e in encounters if e.known]
    return 100.0 * sum(e.predicted_well for e in known) / len(known) if known else float("nan")


def _well(encounters: Sequence[Encounter]) -> float:
    """Share of all encounters, known to anybody or not, that were predicted well, %."""
    return 100.0 * sum(e.predicted_well for e in encounters) / len(encounters) if encounters else float("nan")


def _claim(claim: str, holds: bool, evidence: str) -> Claim:
    return Claim(claim=claim, where="required", verdict=verdict(holds), evidence=evidence)
