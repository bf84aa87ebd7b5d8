"""Oh & Johnson, "Relative Motion Estimation for Vision-based Formation Flight using Unscented Kalman Filter".

The paper's estimator on simulated formation flights: as printed, with noise settings that follow from the camera,
and as this package ships it. Each run's initial course is drawn at random, because sigma points from a Cholesky
factor are another set in a turned frame: whether one of them falls behind the camera depends on where north is.
"""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from importlib import import_module
from multiprocessing import get_context
from pathlib import Path
from typing import Final, NamedTuple

import msgspec
import numpy as np

from onboard.studies._formation import AS_PRINTED, METHODS, R_ALONE, SHIPPED, TUNED, Method, track
from onboard.studies._formation_scores import Score, score
from onboard.studies._relative_motion_claims import claims_of
from onboard.studies._relative_motion_report import Result, markdown
from onboard.studies._relative_motion_table import compare, make_row
from simlink.flight import fly
from simlink.scenario import Scenario, load_scenario

NAME: Final = "relative-motion"
TITLE: Final = "Oh & Johnson: relative motion by vision, an unscented Kalman filter"


class Variant(NamedTuple):
    """A scenario of simlink, and the methods flown on it."""

    name: str
    scenario: str
    label: str
    methods: tuple[Method, ...]


VARIANTS: Final = (
    Variant("a", "formation", "reference formation", (*METHODS, R_ALONE)),
    Variant("d", "formation-drop-out", "no image at 30-35 s", (AS_PRINTED, *METHODS)),
    Variant("e", "formation-wrong-blobs", "2 % wrong blobs", (TUNED, SHIPPED)),
)


def run(
    seeds: int = 50,
    first_seed: int = 1,
    jobs: int | None = None,
    out: Path | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Result:
    """Fly every variant `seeds` times with each of its methods, in `jobs` processes (None: one per core).

    `progress(done, total)` is called as flights finish. With `out`, figures, report.md and result.json are
    written there; figures need the extra `study` (else ImportError, before anything is flown).
    """
    if out is not None:
        import_module("matplotlib")
    if seeds < 1 or first_seed < 0:
        raise ValueError("needs at least one seed, none of them negative")
    scores = _fly_all(range(first_seed, first_seed + seeds), jobs or os.cpu_count() or 1, progress)
    rows = [make_row(v.name, m.name, scores[v.name, m.name]) for v in VARIANTS for m in v.methods]
    result = Result(
        seeds=seeds,
        first_seed=first_seed,
        rows=tuple(rows),
        comparisons=tuple(c for row in rows for c in compare(row)),
        claims=claims_of({(row.variant, row.method): row for row in rows}),
        figures=(),
    )
    return result if out is None else _write(result, out)


def scenario_of(variant: Variant, seed: int) -> Scenario:
    """The variant's scenario, begun on a course of the seed's own."""
    scenario = load_scenario(variant.scenario)
    course_deg = float(np.random.default_rng([seed, 7]).uniform(0.0, 360.0))
    leader = msgspec.structs.replace(scenario.leader, course_deg=course_deg)
    return msgspec.structs.replace(scenario, leader=leader)


def to_json(result: Result) -> bytes:
    """The result as a JSON document, NaN as null."""
    return msgspec.json.format(msgspec.json.encode(result), indent=1)


def _fly_all(
    seeds: range, jobs: int, progress: Callable[[int, int], None] | None
) -> dict[tuple[str, str], list[Score]]:
    """Scores by variant and method, in the order of seeds."""
    tasks = [(variant, seed) for seed in seeds for variant in VARIANTS]
    scores: dict[tuple[str, str], list[Score]] = {(v.name, m.name): [] for v in VARIANTS for m in v.methods}
    for done, ((variant, _), found) in enumerate(zip(tasks, _map(tasks, jobs), strict=True), 1):
        for method, one in zip(variant.methods, found, strict=True):
            scores[variant.name, method.name].append(one)
        if progress is not None:
            progress(done, len(tasks))
    return scores


def _map(tasks: list[tuple[Variant, int]], jobs: int) -> Iterator[list[Score]]:
    names, seeds = [variant.name for variant, _ in tasks], [seed for _, seed in tasks]
    if jobs == 1:
        yield from map(fly_one, names, seeds)
        return
    # spawned, not forked: whoever shows the progress may run threads
    with ProcessPoolExecutor(min(jobs, len(tasks)), mp_context=get_context("spawn")) as pool:
        yield from pool.map(fly_one, names, seeds)


def fly_one(name: str, seed: int) -> list[Score]:
    """One flight of a variant, scored with each of its methods."""
    variant = next(v for v in VARIANTS if v.name == name)
    scenario = scenario_of(variant, seed)
    flight = fly(scenario, seed)
    return [score(seed, flight, track(flight, scenario.camera, method)) for method in variant.methods]


def _write(result: Result, out: Path) -> Result:
    """Figures of the first seed, the report and the JSON, into the folder `out`."""
    from onboard.studies import _relative_motion_figures  # noqa: PLC0415 - matplotlib is an extra

    out.mkdir(parents=True, exist_ok=True)
    scenario = scenario_of(VARIANTS[0], result.first_seed)
    flight = fly(scenario, result.first_seed)
    tracks = {method.name: track(flight, scenario.camera, method) for method in METHODS}
    figures = _relative_motion_figures.draw(flight, tracks, out)
    result = msgspec.structs.replace(result, figures=figures)
    (out / "report.md").write_text(markdown(result), encoding="utf-8")
    (out / "result.json").write_bytes(to_json(result))
    return result
