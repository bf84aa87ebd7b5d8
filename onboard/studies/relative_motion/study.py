"""Oh & Johnson, "Relative Motion Estimation for Vision-based Formation Flight using Unscented Kalman Filter".

The paper's estimator on simulated formation flights: as printed, with noise settings that follow from the camera,
and as this package ships it; on the reference flight and on what makes life hard for it. Each run's initial course
is drawn at random, because sigma points from a Cholesky factor are another set in a turned frame: whether one of
them falls behind the camera depends on where north is.
"""

from importlib import import_module
from pathlib import Path
from typing import Final, NamedTuple

import msgspec

from onboard.arrays import Array
from onboard.estimators.leader.settings import noise_for
from onboard.studies.relative_motion.bound import Bound, bounds
from onboard.studies.relative_motion.claims import claims_of
from onboard.studies.relative_motion.formation import Setting, Tracks, track
from onboard.studies.relative_motion.report import Result, markdown
from onboard.studies.relative_motion.scores import SETTLED, Score, error_over_time, score, unseen_samples
from onboard.studies.relative_motion.table import compare, make_bound, make_row
from onboard.studies.relative_motion.targets import judged
from onboard.studies.relative_motion.variants import (
    BY_NAME,
    SAMPLE,
    VARIANTS,
    Variant,
    course_deg,
    scenario_of,
    setting_of,
)
from onboard.studies.report.workers import Part, Progress, compute, require_seeds
from simlink.flights import Flights, fly_many

NAME: Final = "relative-motion"
TITLE: Final = "Oh & Johnson: relative motion by vision, an unscented Kalman filter"
TOGETHER: Final = 100  # flights advanced at once: their tracks take 200 MB
EXAMPLE: Final = 10  # navigation samples from one point of a picture to the next
BOUNDED: Final = (
    "a",
    "b",
    "c",
    "d",
    "i",
    "k30",
    "k45",
    "k60",
    "hover",
)  # where told what is so, our own motion exactly


class Flown(NamedTuple):
    """What came of some flights of a variant: scores by method, in the order of seeds, and their bounds."""

    scores: dict[str, list[Score]]
    bounds: list[Bound]
    examples: dict[str, Array]  # by method, of the first flight: `error_over_time`, thinned out


def run(
    seeds: int = 100,
    first_seed: int = 1,
    jobs: int | None = None,
    out: Path | None = None,
    progress: Progress | None = None,
    variants: tuple[Variant, ...] = VARIANTS,
) -> Result:
    """Fly every variant `seeds` times with each of its methods, in `jobs` processes (None: one per core).

    `progress(done, total)` is called as groups of flights finish. With `out`, figures, report.md and result.json
    are written there; figures need the extra `study` (else ImportError, before anything is flown).
    """
    if out is not None:
        import_module("matplotlib")
    every = require_seeds(seeds, first_seed)
    groups = [(v, every[i : i + TOGETHER]) for i in range(0, seeds, TOGETHER) for v in variants]
    found = compute([Part(fly_some, (v.name, tuple(group))) for v, group in groups], jobs, progress)
    scores: dict[tuple[str, str], list[Score]] = {}
    limits: dict[str, list[Bound]] = {}
    for (variant, _), flown in zip(groups, found, strict=True):
        for name, more in flown.scores.items():
            scores.setdefault((variant.name, name), []).extend(more)
        limits.setdefault(variant.name, []).extend(flown.bounds)
    rows = [make_row(variant, method, ones) for (variant, method), ones in scores.items()]
    least = tuple(make_bound(name, ones) for name, ones in limits.items() if ones)
    result = Result(
        seeds=seeds,
        first_seed=first_seed,
        rows=tuple(rows),
        bounds=least,
        targets=judged(rows, {variant.name: variant.judged.name for variant in variants}, least),
        comparisons=tuple(c for row in rows for c in compare(row)),
        claims=claims_of({(row.variant, row.method): row for row in rows}),
        figures=(),
    )
    examples = {variant.name: found[i].examples for i, variant in enumerate(variants)}
    return result if out is None else _write(result, examples, out)


def to_json(result: Result) -> bytes:
    """The result as a JSON document, NaN as null."""
    return msgspec.json.format(msgspec.json.encode(result), indent=1)


def fly_some(name: str, seeds: tuple[int, ...]) -> Flown:
    """Flights of a variant, scored with each of its methods."""
    variant = BY_NAME[name]
    flights, setting = flown(variant, seeds)
    scores, examples = {}, {}
    for method in variant.methods:
        tracks = track(flights, setting, method, variant.late)
        examples[method.name] = error_over_time(flights.one(0), tracks.one(0))[::EXAMPLE]
        scores[method.name] = scores_of(flights, tracks, variant.late.stamp * SAMPLE)
    limits = (
        bounds(flights, setting.camera, noise_for("honest", setting.leader_class), SETTLED)
        if name in BOUNDED
        else []
    )
    return Flown(scores, limits, examples)


def flown(variant: Variant, seeds: tuple[int, ...]) -> tuple[Flights, Setting]:
    """The flights, each begun on its own course, and what the filters are told."""
    scenario = scenario_of(variant)
    flights = fly_many(scenario, seeds, [course_deg(seed) for seed in seeds])
    return flights, setting_of(variant, scenario)


def scores_of(flights: Flights, tracks: Tracks, stamps_late: float) -> list[Score]:
    """The score of each flight."""
    rows = range(len(flights.seeds))
    unseen = [unseen_samples(flights.image_at, flights.in_view[b], len(flights.nav_t)) for b in rows]
    return [score(flights.seeds[b], flights.one(b), tracks.one(b), unseen[b], stamps_late) for b in rows]


def _write(result: Result, examples: dict[str, dict[str, Array]], out: Path) -> Result:
    """Figures of the first seed, the report and the JSON, into the folder `out`."""
    from onboard.studies.relative_motion import figures as relative_motion_figures  # noqa: PLC0415 - matplotlib is an extra

    out.mkdir(parents=True, exist_ok=True)
    variant = VARIANTS[0]
    flights, setting = flown(variant, (result.first_seed,))
    tracks = {m.name: track(flights, setting, m).one(0) for m in relative_motion_figures.SHOWN}
    figures = relative_motion_figures.draw(flights.one(0), tracks, result, examples, out)
    result = msgspec.structs.replace(result, figures=figures)
    (out / "report.md").write_text(markdown(result), encoding="utf-8")
    (out / "result.json").write_bytes(to_json(result))
    return result
