"""Random encounters from any side, with the default estimator of the leader.

Only the leader's size and class, and the camera's mount, which is drawn, are configured. The true size is within 2
% (one sigma). Noise, rates, delays, drop-outs and the errors of our own state are drawn around the defaults, never
at them (`simlink/encounters/conditions.py`).
"""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from onboard.analysis.parallel.workers import Jobs, Part, Progress, compute
from studies.encounters import assumptions, peers, recorded, reference
from studies.encounters.assumptions import BROKEN
from studies.encounters.flights import CASES, DEFAULTS, Case, Flight, fly
from studies.encounters.peers import BESIDE
from studies.encounters.reference import Pair
from studies.encounters.results import (
    acceleration_table,
    after_requirements,
    checks_of,
    claims_of,
    log_requirements,
    log_table,
    of_logs,
    requirements,
    table_of,
    velocity_table,
)
from studies.encounters.scores import over_all, score
from studies.report.files import drawing, publish, require_seeds
from studies.report.findings import Findings
from studies.report.sampling import decided

NAME: Final = "encounters"
TITLE: Final = "Encounters: the leader from any side"
DEFAULT_SEED_COUNT: Final = 6
MIN_SEED_COUNT: Final = 40  # to decide the claims
FIRST_SEED: Final = 501  # settings are chosen on seeds 1 to 100
ASSUMPTION_SEED_RATIO: Final = 4  # seeds to each one flown with an assumption false and by another filter, too
REFERENCE_SEED_RATIO: Final = 8  # seeds to each one flown by the reference, too, which takes ten times as long


def run(
    seeds: int = DEFAULT_SEED_COUNT,
    first_seed: int = FIRST_SEED,
    jobs: Jobs = None,
    out: Path | None = None,
    progress: Progress | None = None,
    cases: Sequence[Case] = CASES,
    settings: tuple[str, ...] = (),
    compared: int | None = None,
    broken: int | None = None,
    departures: Sequence[Case] = BROKEN,
) -> Findings:
    """The study over `seeds` flights of each case; forty are needed to judge.

    `settings` are further overrides, as of `--set`: to choose settings, on other seeds than those of the report.
    The first `compared` seeds (None: an eighth of all) are flown by the reference, too, and the first `broken`
    (None: a quarter of all) with one assumption false (`assumptions`: the `departures`), and beside another filter
    (`peers`).
    """
    every = require_seeds(seeds, first_seed)
    draw = drawing(__package__, out)
    few = every[: seeds // REFERENCE_SEED_RATIO if compared is None else compared]
    some = every[: seeds // ASSUMPTION_SEED_RATIO if broken is None else broken]
    beside = [case for case in cases if case in reference.COMPARED and few]
    others = list(BESIDE) if some and cases else []
    parts = [Part(fly, (case, seed, (*settings, *reference.SETTINGS))) for case in beside for seed in few]
    parts += [Part(fly, (case, seed, settings)) for case in cases for seed in every]
    parts += [Part(fly, (case, seed, settings)) for case in departures for seed in some]
    parts += [Part(peers.fly, (BESIDE[name], seed, settings)) for name in others for seed in some]
    references, flights, astray, paired = _split(
        compute(parts, jobs, progress),
        (beside, len(few)),
        (cases, seeds),
        (departures if some else (), len(some)),
        (others, len(some)),
    )
    flights = {case: each for case, all_ in flights.items() if (each := of_use(case, all_))}
    shown = {case: each[0] for case, each in flights.items() if case in DEFAULTS}
    found = findings(flights, first_seed, settings, references, astray, paired)
    return publish(decided(found, MIN_SEED_COUNT), out, draw if shown else None, *([shown] if shown else []))


def options(
    seeds: int | None, cases: str | None, *, departures: bool, leaders_from: Path | None = None
) -> dict[str, Any]:
    """Return the arguments of `run` for a part of the study.

    `cases` are names as in the keys of the page's figures (`hover`, `hover_five_points`); with `departures` their
    families with one assumption false each; with a folder `leaders_from` its logs, from the named sides or all.
    None is flown by the reference or another filter. `refused` is no argument: it tells why other logs are not
    flown. Raises ValueError with the known names.
    """
    if leaders_from is not None:
        if departures:
            raise ValueError("leaders that others flew depart from nothing")
        sides = cases.split(",") if cases else recorded.GEOMETRIES
        if strange := [side for side in sides if side not in recorded.GEOMETRIES]:
            raise ValueError(f"no geometry {strange[0]!r}; there are: {', '.join(recorded.GEOMETRIES)}")
        logs, refused = recorded.usable(leaders_from)
        chosen = [Case(side, log=str(log)) for log in logs for side in sides]
        return {"cases": chosen, "compared": 0, "broken": 0, "refused": refused}
    known = {key_of(case): case for case in CASES}
    names = cases.split(",") if cases else list(known)
    if unknown := [name for name in names if name not in known]:
        raise ValueError(f"no case {unknown[0]!r}; there are: {', '.join(known)}")
    chosen = [known[name] for name in names]
    if not departures:
        return {"cases": chosen, "compared": 0, "broken": 0}
    families = {case.family for case in chosen}
    astray = [case for case in BROKEN if case.family in families]
    return {"cases": (), "compared": 0, "broken": seeds or DEFAULT_SEED_COUNT, "departures": astray}


def key_of(case: Case) -> str:
    """The case's name without commas and spaces."""
    return case.name.replace(",", "").replace(" ", "_")


def findings(
    flights: Mapping[Case, Sequence[Flight]],
    first_seed: int,
    settings: Sequence[str] = (),
    references: Mapping[Case, Sequence[Flight]] | None = None,
    astray: Mapping[Case, Sequence[Flight]] | None = None,
    paired: Mapping[str, Sequence[peers.Pair]] | None = None,
) -> Findings:
    """Return the results of flights with successive seeds.

    The first of them were also flown by the `references`. `astray` are flights with one assumption false, `paired`
    those with the bearing-angle filter.
    """
    scores, total = {case: score(each) for case, each in flights.items()}, over_all(flights)
    departed = {case: score(each) for case, each in (astray or {}).items()}
    after = {c: score([f.after for f in each]) for c, each in flights.items() if has_manoeuvre(each)}
    required = requirements(scores, total) | after_requirements(after)
    required |= assumptions.requirements(departed) | peers.requirements(paired or {})
    required |= log_requirements(by_log := of_logs(flights))
    pairs = {c: [*map(Pair, flights[c], each)] for c, each in (references or {}).items()}
    beside = reference.checks_of(pairs)
    setting = " ".join((__doc__ or "").split())
    return Findings(
        study=NAME,
        title=TITLE,
        setting=f"{setting} Beyond the defaults: {', '.join(settings)}." if settings else setting,
        seeds=max((len(each) for each in (*flights.values(), *(astray or {}).values())), default=0),
        first_seed=first_seed,
        tables=(
            table_of(scores, total),
            velocity_table(scores, after),
            acceleration_table(scores),
            *([log_table(by_log)] if by_log else []),
            *([reference.table_of(pairs)] if pairs else []),
            *([assumptions.table_of(departed), assumptions.summary_of(astray or {})] if departed else []),
            *([peers.table_of(paired)] if paired else []),
        ),
        checks=(*checks_of(required), *beside),
        claims=(*claims_of(required), *reference.claims_of(beside)),
    )


def of_use(case: Case, flights: Sequence[Flight]) -> Sequence[Flight]:
    """Return the flights that exist: not every recorded flight can be seen from everywhere."""
    return [flight for flight in flights if len(flight.t)] if case.log else flights


def has_manoeuvre(flights: Sequence[Flight]) -> bool:
    """Whether the leaders of these flights have one."""
    return any(np.isfinite(flight.manoeuvre) for flight in flights)


def _split(flown: Sequence[Any], *groups: tuple[Iterable[Any], int]) -> list[dict[Any, Sequence[Any]]]:
    """Return the flights of each group by its keys, in the order in which they are flown."""
    found, at = [], 0
    for keys, each in groups:
        ordered = list(keys)
        found.append({key: flown[at + k * each : at + (k + 1) * each] for k, key in enumerate(ordered)})
        at += len(ordered) * each
    return found
