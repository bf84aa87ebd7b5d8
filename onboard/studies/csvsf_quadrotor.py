"""Al-Shabi, Gadsden & Wilkerson, "The Cubature Smooth Variable Structure Filter Estimation Strategy Applied to a
Quadrotor Controller".

The paper's filters over simulated flights of a quadrotor whose model is right, or wrong in a dozen ways. Its
equation of motion (4.1) is lost: see `onboard.models.quadrotor`. The truth is that model too, with other
parameters and forces, as in the paper; a simulator with dynamics of its own is simlink's.
"""

from importlib import import_module
from pathlib import Path
from typing import Final, NamedTuple

import msgspec

from onboard.filters.cubature_smooth import FADING, PATIENCE
from onboard.studies._quadrotor_cases import FORCE_SIGMA, NAMED, VARIANTS, simulate
from onboard.studies._quadrotor_claims import claims_of
from onboard.studies._quadrotor_filters import ADAPTIVE, MAIN, METHODS, Method, methods_on, track
from onboard.studies._quadrotor_misprints import misprints
from onboard.studies._quadrotor_report import Result, Setting, markdown
from onboard.studies._quadrotor_table import Row, Score, compare, limits_of, make_row, score
from onboard.studies._workers import Part, Progress, compute, require_seeds

NAME: Final = "csvsf-quadrotor"
TITLE: Final = "Al-Shabi et al.: a quadrotor's own state, smooth variable structure filters"
TOGETHER: Final = 30  # flights in a batch: fixed, so that results do not depend on the number of processes
CHOOSING: Final = range(1000, 1020)  # the seeds that settings were chosen on
FADINGS: Final = (0.02, 0.05, FADING, 0.2, 0.4)
PATIENCES: Final = (1, 2, PATIENCE, 5, 8)
SWEPT: Final = tuple(
    ADAPTIVE._replace(fading=fading, patience=patience)
    for fading, patience in [*((f, PATIENCE) for f in FADINGS), *((FADING, p) for p in PATIENCES if p != PATIENCE)]
)


class Task(NamedTuple):
    """Flights of one variant, and the methods to fly on them."""

    variant: str
    seeds: tuple[int, ...]
    methods: tuple[Method, ...]


def run(
    seeds: int = 60,
    first_seed: int = 1,
    jobs: int | None = None,
    out: Path | None = None,
    progress: Progress | None = None,
    settings: tuple[Method, ...] = SWEPT,
) -> Result:
    """Fly every variant `seeds` times with each of its methods, in `jobs` processes (None: one per core); and, on
    the seeds for choosing, the adaptive form with other `settings`.

    `progress(done, total)` is called as batches of flights finish. With `out`, figures, report.md and result.json
    are written there; figures need the extra `study` (else ImportError, before anything is flown).

    Raises ValueError.
    """
    if out is not None:
        import_module("matplotlib")
    flown, choosing = require_seeds(seeds, first_seed), CHOOSING[:seeds]
    studied = [Task(v.name, s, methods_on(v)) for s in _batches(flown) for v in VARIANTS]
    swept = [Task(name, tuple(choosing), settings) for name in MAIN]
    found = compute([Part(fly_one, (task,)) for task in (*studied, *swept)], jobs, progress)
    rows = _rows(studied, found[: len(studied)])
    result = Result(
        seeds=seeds,
        first_seed=first_seed,
        rows=tuple(rows),
        comparisons=tuple(c for row in rows for c in compare(row)),
        claims=claims_of({(row.variant, row.method): row for row in rows}),
        figures=(),
        limits=tuple(limits_of(rows, [method.name for method in METHODS])),
        sweep=_sweep(swept, found[len(studied) :]),
        sweep_seeds=len(choosing),
        sweep_first_seed=choosing[0],
        misprints=misprints(),
    )
    return result if out is None else _write(result, out)


def to_json(result: Result) -> bytes:
    """The result as a JSON document, NaN as null."""
    return msgspec.json.format(msgspec.json.encode(result), indent=1)


def fly_one(task: Task) -> list[list[Score]]:
    """The scores of each of a task's methods."""
    variant = NAMED[task.variant]
    case = simulate(variant, task.seeds)
    return [score(task.seeds, case, track(case, variant, method)) for method in task.methods]


def _batches(seeds: range) -> list[tuple[int, ...]]:
    return [tuple(seeds[k : k + TOGETHER]) for k in range(0, len(seeds), TOGETHER)]


def _rows(tasks: list[Task], found: list[list[list[Score]]]) -> list[Row]:
    scores: dict[tuple[str, str], list[Score]] = {}
    for task, each in zip(tasks, found, strict=True):
        for method, some in zip(task.methods, each, strict=True):
            scores.setdefault((task.variant, method.name), []).extend(some)
    return [make_row(variant, method, some) for (variant, method), some in scores.items()]


def _sweep(tasks: list[Task], found: list[list[list[Score]]]) -> tuple[Setting, ...]:
    settings = []
    for k, method in enumerate(tasks[0].methods):
        rows = {
            t.variant: make_row(t.variant, method.name, scores[k]) for t, scores in zip(tasks, found, strict=True)
        }
        figures = {name: row.quantities for name, row in rows.items()}
        nan = float("nan")
        settings.append(
            Setting(
                fading=method.fading,
                patience=method.patience,
                none_m_s=figures["none"]["velocity_m_s"].value or nan,
                weak_m_s=figures["weak"]["velocity_m_s"].value or nan,
                outliers_m_s=figures["outliers"]["velocity_m_s"].value or nan,
                motor_rad_s=figures["motor"]["rates_rad_s"].value or nan,
            )
        )
    return tuple(settings)


def _write(result: Result, out: Path) -> Result:
    """Figures of the first seed, the report and the JSON, into the folder `out`."""
    from onboard.studies import _quadrotor_figures  # noqa: PLC0415 - matplotlib is an extra

    out.mkdir(parents=True, exist_ok=True)
    flights = {}
    for name in MAIN:
        case = simulate(NAMED[name], (result.first_seed,))
        flights[name] = (case, {m.name: track(case, NAMED[name], m) for m in _quadrotor_figures.DRAWN})
    figures = _quadrotor_figures.draw(flights, result, out)
    result = msgspec.structs.replace(result, figures=figures)
    (out / "report.md").write_text(markdown(result, FORCE_SIGMA, (FADING, PATIENCE)), encoding="utf-8")
    (out / "result.json").write_bytes(to_json(result))
    return result
