"""Random encounters from any side: the leader's estimate as shipped, with nothing configured but the leader's size
and class, and the camera's mount, which is drawn. The true size is within 2 % (one sigma). Noise, rates, delays,
drop-outs and the errors of our own state are drawn around the defaults, never at them
(`simlink/encounters/conditions.py`).
"""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from onboard.commands.parallel.workers import Jobs, Part, Progress, compute
from studies.encounters import assumptions, peers, reference
from studies.encounters.assumptions import BROKEN
from studies.encounters.flights import CASES, DEFAULTS, Case, Flight, fly
from studies.encounters.peers import BESIDE
from studies.encounters.reference import Pair
from studies.encounters.results import checks_of, claims_of, requirements, table_of
from studies.encounters.scores import over_all, score
from studies.report.files import drawing, publish, require_seeds
from studies.report.findings import Findings
from studies.report.sampling import decided

NAME: Final = "encounters"
TITLE: Final = "Encounters: the leader from any side"
LEAST: Final = 40  # seeds to decide the claims
FIRST_SEED: Final = 501  # settings are chosen on seeds 1 to 100
FEWER: Final = 4  # of so many seeds one is flown with each assumption false, and beside another filter, too
COMPARED: Final = 8  # of so many encounters one is flown by the reference, too: that takes ten times as long


def run(
    seeds: int = 6,
    first_seed: int = FIRST_SEED,
    jobs: Jobs = None,
    out: Path | None = None,
    progress: Progress | None = None,
    cases: Sequence[Case] = CASES,
    settings: tuple[str, ...] = (),
    compared: int | None = None,
    broken: int | None = None,
) -> Findings:
    """The study over `seeds` flights of each case; forty are needed to judge. `settings` are further overrides, as
    of `--set`: to choose settings, on other seeds than those of the report. The first `compared` seeds (None: an
    eighth of all) are flown by the reference, too, and the first `broken` (None: a quarter of all) with one
    assumption false (`assumptions`), and beside another filter (`peers`)."""
    every = require_seeds(seeds, first_seed)
    draw = drawing(__package__, out)
    few = every[: seeds // COMPARED if compared is None else compared]
    some = every[: seeds // FEWER if broken is None else broken]
    beside = [case for case in cases if case in reference.COMPARED and few]
    parts = [Part(fly, (case, seed, (*settings, *reference.SETTINGS))) for case in beside for seed in few]
    parts += [Part(fly, (case, seed, settings)) for case in cases for seed in every]
    parts += [Part(fly, (case, seed, settings)) for case in BROKEN for seed in some]
    parts += [Part(peers.fly, (case, seed, settings)) for case in BESIDE.values() for seed in some]
    references, flights, astray, paired = _split(
        compute(parts, jobs, progress),
        (beside, len(few)),
        (cases, seeds),
        (BROKEN if some else (), len(some)),
        (BESIDE if some else (), len(some)),
    )
    shown = {case: each[0] for case, each in flights.items() if case in DEFAULTS}
    found = findings(flights, first_seed, settings, references, astray, paired)
    return publish(decided(found, LEAST), out, draw, shown)


def findings(
    flights: Mapping[Case, Sequence[Flight]],
    first_seed: int,
    settings: Sequence[str] = (),
    references: Mapping[Case, Sequence[Flight]] | None = None,
    astray: Mapping[Case, Sequence[Flight]] | None = None,
    paired: Mapping[str, Sequence[peers.Pair]] | None = None,
) -> Findings:
    """The results of flights with successive seeds, the first of which the `references` have flown, too; `astray`
    are flights with one assumption false, and `paired` those beside the bearing-angle filter."""
    scores, total = {case: score(each) for case, each in flights.items()}, over_all(flights)
    departed = {case: score(each) for case, each in (astray or {}).items()}
    required = requirements(scores, total) | assumptions.requirements(departed) | peers.requirements(paired or {})
    pairs = {c: [*map(Pair, flights[c], each)] for c, each in (references or {}).items()}
    beside = reference.checks_of(pairs)
    setting = (__doc__ or "").replace("\n", " ").strip()
    return Findings(
        study=NAME,
        title=TITLE,
        setting=f"{setting} Beyond the defaults: {', '.join(settings)}." if settings else setting,
        seeds=max(len(each) for each in flights.values()),
        first_seed=first_seed,
        tables=(
            table_of(scores, total),
            *([reference.table_of(pairs)] if pairs else []),
            *([assumptions.table_of(departed)] if departed else []),
            *([peers.table_of(paired)] if paired else []),
        ),
        checks=(*checks_of(required), *beside),
        claims=(*claims_of(required), *reference.claims_of(beside)),
    )


def _split(flown: Sequence[Any], *groups: tuple[Iterable[Any], int]) -> list[dict[Any, Sequence[Any]]]:
    """The flights of each group by its keys, each of which has so many; they are flown in this order."""
    found, at = [], 0
    for keys, each in groups:
        ordered = list(keys)
        found.append({key: flown[at + k * each : at + (k + 1) * each] for k, key in enumerate(ordered)})
        at += len(ordered) * each
    return found
