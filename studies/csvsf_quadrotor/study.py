"""The study of the cubature SVSF on a quadrotor.

The paper is Al-Shabi, Gadsden & Wilkerson, "The Cubature Smooth Variable Structure Filter Estimation Strategy
Applied to a Quadrotor Controller". Its filters run over simulated flights of a quadrotor whose model is right, or
wrong in a dozen ways. Its equation of motion (4.1) is lost: see `onboard.models.quadrotor`. The truth follows that
model too, with other parameters and forces, as in the paper. simlink, not used here, has dynamics of its own.
"""

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Final, NamedTuple

import msgspec

from onboard.analysis.parallel.workers import Jobs, Part, Progress, compute
from onboard.filters.cubature_smooth import FADING_FRACTION, MIN_EXCEEDANCE_STEPS
from studies.csvsf_quadrotor.cases import NAMED, VARIANTS, Case, one, simulate
from studies.csvsf_quadrotor.claims import claims_of
from studies.csvsf_quadrotor.filters import ADAPTIVE, MAIN, METHODS, Method, Track, methods_on, track
from studies.csvsf_quadrotor.misprints import misprints
from studies.csvsf_quadrotor.report import Result, Setting, findings
from studies.csvsf_quadrotor.scores import (
    ASKED,
    ASKED_SLOW,
    REFERENCE,
    Row,
    Score,
    compare,
    limits_of,
    make_row,
    score,
)
from studies.report.files import require_seeds, write
from studies.report.runs import by_name

NAME: Final = "csvsf-quadrotor"
TITLE: Final = "Al-Shabi et al.: a quadrotor's own state, smooth variable structure filters"
BATCH_SIZE: Final = 60  # flights: fixed, so that results do not depend on the number of processes
UNCOMPARED_SEED_RATIO: Final = 4  # seeds to each one flown where figures are compared with nothing
TUNING_SEEDS: Final = range(1000, 1010)  # the settings were chosen on them
FADINGS: Final = (0.02, 0.05, FADING_FRACTION, 0.2, 0.4)
PATIENCES: Final = (1, 2, MIN_EXCEEDANCE_STEPS, 5, 8)
SWEPT: Final = tuple(
    ADAPTIVE._replace(fading=fading, patience=patience)
    for fading, patience in [
        *((f, MIN_EXCEEDANCE_STEPS) for f in FADINGS),
        *((FADING_FRACTION, p) for p in PATIENCES if p != MIN_EXCEEDANCE_STEPS),
    ]
)


class Task(NamedTuple):
    """Flights of variants, and the methods to fly on them.

    Of several variants the first is without error, and the others begin as it does (see `Variant.late`).
    """

    variants: tuple[
        str, ...
    ]  # of several, the first is without error and the others begin as it does (`Variant.late`)
    seeds: tuple[int, ...]
    methods: tuple[Method, ...]
    drawn: bool = False


class FlightResult(NamedTuple):
    """The scores of each method by variant over a task's flights."""

    scores: dict[str, list[list[Score]]]
    first: dict[str, tuple[Case, dict[str, Track]]]


def run(
    seeds: int = 60,
    first_seed: int = 1,
    jobs: Jobs = None,
    out: Path | None = None,
    progress: Progress | None = None,
    settings: tuple[Method, ...] = SWEPT,
) -> Result:
    """Fly every variant `seeds` times with each of its methods, in `jobs` processes.

    The default is one process per core. On the seeds for choosing, the adaptive form also flies with other
    `settings`. `progress(done, total)` is called as batches of flights finish. With `out`, figures, report.md and
    result.json are written there; figures need the extra `study` (else ImportError, before anything is flown).
    Raises ValueError.
    """
    if out is not None:
        import_module("matplotlib")
    tasks = _tasks(require_seeds(seeds, first_seed))
    choosing = TUNING_SEEDS[:seeds]
    swept = [Task(names, tuple(choosing), settings) for names in _together(MAIN)]
    found = compute([Part(fly, (task,)) for task in (*tasks, *swept)], jobs, progress)
    rows = _rows(tasks, found[: len(tasks)])
    result = Result(
        seeds=seeds,
        first_seed=first_seed,
        rows=tuple(rows),
        comparisons=tuple(c for row in rows for c in compare(row)),
        claims=claims_of(by_name(rows)),
        limits=tuple(limits_of(rows, [method.name for method in METHODS])),
        sweep=_sweep(settings, found[len(tasks) :]),
        sweep_seeds=len(choosing),
        sweep_first_seed=choosing[0],
        misprints=misprints(),
    )
    if out is None:
        return result
    from studies.csvsf_quadrotor import figures  # noqa: PLC0415 - matplotlib is an extra

    drawn = {name: flight for f in found[: len(tasks)] for name, flight in f.first.items()}
    result = msgspec.structs.replace(result, figures=figures.draw(drawn, result, out))
    write(findings(result, NAME, TITLE), out, result)
    return result


def fly(task: Task) -> FlightResult:
    """Fly each variant of a task with each method."""
    scores: dict[str, list[list[Score]]] = {}
    first: dict[str, tuple[Case, dict[str, Track]]] = {}
    clean: list[Track | None] = [None] * len(task.methods)
    for name in task.variants:
        variant = NAMED[name]
        case = simulate(variant, task.seeds)
        tracks = [track(case, variant, m, since) for m, since in zip(task.methods, clean, strict=True)]
        scores[name] = [score(task.seeds, case, found) for found in tracks]
        if task.drawn:
            alone = {m.name: _first(found) for m, found in zip(task.methods, tracks, strict=True)}
            first[name] = one(case, 0), alone
        if len(task.variants) > 1 and not variant.late:
            clean = list(tracks)
    return FlightResult(scores, first)


def _tasks(seeds: range) -> list[Task]:
    """The largest first.

    Variants whose figures are compared with nothing are flown fewer times.
    """
    judged = {variant for variant, _ in REFERENCE} | {variant for variant, _, _ in (*ASKED, *ASKED_SLOW)}
    together = _together([v.name for v in VARIANTS])
    tasks = []
    for names in together:
        flown = seeds if judged.intersection(names) else seeds[: -(-len(seeds) // UNCOMPARED_SEED_RATIO)]
        methods = methods_on(NAMED[names[0]])
        tasks += [
            Task(names, tuple(flown[k : k + BATCH_SIZE]), methods, k == 0 and names[0] in MAIN)
            for k in range(0, len(flown), BATCH_SIZE)
        ]
    return tasks


def _first(found: Track) -> Track:
    """The track of the first flight; a copy, since a view would keep all the others in memory."""
    return Track(found.mean[:, [0]], found.nees[[0]], found.nis[[0]], found.switching[:, [0]])


def _together(names: Sequence[str]) -> list[tuple[str, ...]]:
    """The variants that begin alike as one tuple, each other one as a tuple of its own."""
    late = tuple(name for name in names if NAMED[name].late)
    return [("none", *late), *((name,) for name in names if name != "none" and name not in late)]


def _rows(tasks: list[Task], found: list[FlightResult]) -> list[Row]:
    scores: dict[tuple[str, str], list[Score]] = {}
    for task, flown in zip(tasks, found, strict=True):
        for name in task.variants:
            for method, some in zip(task.methods, flown.scores[name], strict=True):
                scores.setdefault((name, method.name), []).extend(some)
    return [make_row(variant, method, some) for (variant, method), some in scores.items()]


def _sweep(methods: Sequence[Method], found: list[FlightResult]) -> tuple[Setting, ...]:
    scores = {name: each for flown in found for name, each in flown.scores.items()}
    settings = []
    for k, method in enumerate(methods):
        rows = {name: make_row(name, method.name, each[k]) for name, each in scores.items()}
        settings.append(
            Setting(
                fading=method.fading,
                patience=method.patience,
                none_m_s=rows["none"].value("velocity_m_s"),
                weak_m_s=rows["weak"].value("velocity_m_s"),
                outliers_m_s=rows["outliers"].value("velocity_m_s"),
                motor_rad_s=rows["motor"].value("rates_rad_s"),
            )
        )
    return tuple(settings)
