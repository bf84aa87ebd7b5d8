"""The study of relative motion by vision.

The paper is Oh & Johnson, "Relative Motion Estimation for Vision-based Formation Flight using Unscented Kalman
Filter". Its estimator runs on simulated formation flights: as printed, with noise settings that follow from the
camera, and as this package ships it; on the reference flight and on difficult ones. Each run's initial course is
random: sigma points from a Cholesky factor differ in a rotated frame, so that the direction of north decides
whether one of them falls behind the camera.
"""

from importlib import import_module
from pathlib import Path
from typing import Final, NamedTuple

import msgspec

from onboard.analysis.parallel.workers import Jobs, Part, Progress, compute
from onboard.arrays import Array
from simlink.scenarios.camera import Camera
from studies.relative_motion import shipped
from studies.relative_motion.bound import FlightBound, bounds, over_flights
from studies.relative_motion.claims import claims_of
from studies.relative_motion.flight import Flight
from studies.relative_motion.flights import Flights, fly_many
from studies.relative_motion.formation import Setting, Track, track
from studies.relative_motion.noise import honest_noise
from studies.relative_motion.reference import compare
from studies.relative_motion.report import Result, findings
from studies.relative_motion.scores import SETTLING_TIME_S, Score, error_over_time, make_row, score_flight
from studies.relative_motion.shipped import DEFAULT, Shipped
from studies.relative_motion.targets import judge
from studies.relative_motion.variants import (
    BY_NAME,
    SHOWN,
    VARIANTS,
    AnyMethod,
    Variant,
    course_deg,
    scenario_of,
    setting_of,
)
from studies.report.files import require_seeds, write
from studies.report.runs import by_name

NAME: Final = "relative-motion"
TITLE: Final = "Oh & Johnson: relative motion by vision, an unscented Kalman filter"
BATCH_SIZE: Final = 100  # flights: their tracks take 200 MB
SHIPPED_FLIGHT_RATIO: Final = 5  # flights to each one that goes through the pipeline, too, which takes seconds
EXAMPLE_STEP: Final = 10  # navigation samples from one point of a figure to the next
# Variants whose filters know the truth about their setting, and our own motion exactly.
BOUNDED: Final = ("a", "b", "c", "d", "i", "k30", "k45", "k60", "hover")


class FlightResult(NamedTuple):
    """Some flights of a variant: scores by method, in the order of seeds, and their bounds."""

    scores: dict[str, list[Score]]
    bounds: list[FlightBound]
    examples: dict[str, Array]  # by method, of the first flight: `error_over_time`, thinned out


def run(
    seeds: int = 100,
    first_seed: int = 1,
    jobs: Jobs = None,
    out: Path | None = None,
    progress: Progress | None = None,
    variants: tuple[Variant, ...] = VARIANTS,
) -> Result:
    """Fly every variant `seeds` times with each of its methods, in `jobs` processes.

    The default is one process per core. `progress(done, total)` is called as groups of flights finish. With `out`,
    figures, report.md and result.json are written there; figures need the extra `study` (else ImportError, before
    anything is flown).
    """
    if out is not None:
        import_module("matplotlib")
    every = require_seeds(seeds, first_seed)
    groups = [(v, every[i : i + BATCH_SIZE]) for i in range(0, seeds, BATCH_SIZE) for v in variants]
    found = compute([Part(fly_some, (v.name, tuple(group))) for v, group in groups], jobs, progress)
    scores: dict[tuple[str, str], list[Score]] = {}
    limits: dict[str, list[FlightBound]] = {}
    for (variant, _), group in zip(groups, found, strict=True):
        for name, more in group.scores.items():
            scores.setdefault((variant.name, name), []).extend(more)
        limits.setdefault(variant.name, []).extend(group.bounds)
    rows = [make_row(variant, method, of_runs) for (variant, method), of_runs in scores.items()]
    least = tuple(over_flights(name, of_flights) for name, of_flights in limits.items() if of_flights)
    result = Result(
        seeds=seeds,
        first_seed=first_seed,
        rows=tuple(rows),
        bounds=least,
        targets=judge(rows, DEFAULT.name, least),
        comparisons=tuple(c for row in rows for c in compare(row)),
        claims=claims_of(by_name(rows)),
    )
    if out is None:
        return result
    examples = {variant.name: found[i].examples for i, variant in enumerate(variants)}
    result = msgspec.structs.replace(result, figures=_draw(result, examples, out))
    write(findings(result, NAME, TITLE), out, result)
    return result


def fly_some(name: str, seeds: tuple[int, ...], duration: float | None = None) -> FlightResult:
    """Fly a variant over `duration` s, by default the scenario's, and score each of its methods."""
    variant = BY_NAME[name]
    flights, setting = flown(variant, seeds, duration)
    scores, examples = {}, {}
    for method in variant.methods:
        tracks = _tracks(variant, flights, setting, method)
        examples[method.name] = error_over_time(flights.one(0), tracks[0])[::EXAMPLE_STEP]
        scores[method.name] = [score_flight(flights, b, one) for b, one in tracks.items()]
    limits = []
    if name in BOUNDED:
        limits = bounds(flights, setting.camera, honest_noise(setting.leader_class), SETTLING_TIME_S)
    return FlightResult(scores, limits, examples)


def _tracks(variant: Variant, flights: Flights, setting: Setting, method: AnyMethod) -> dict[int, Track]:
    """Return a method's tracks by the flight's index among `flights`, always with the first."""
    count = len(flights.seeds)
    if isinstance(method, Shipped):
        every = range(0, count, SHIPPED_FLIGHT_RATIO)
        return {b: shipped.track(flights.one(b), setting, method, variant.late) for b in every}
    tracks = track(flights, setting, method, variant.late)
    return {b: tracks.one(b) for b in range(count)}


def flown(variant: Variant, seeds: tuple[int, ...], duration: float | None = None) -> tuple[Flights, Setting]:
    """The flights, each with its own initial course, and what the filters know."""
    scenario = scenario_of(variant)
    flights = fly_many(scenario, seeds, [course_deg(seed) for seed in seeds], duration)
    return flights, setting_of(variant, scenario)


def draw_paper(first_seed: int, out: Path) -> tuple[str, ...]:
    """Draw the paper's figures of the flight of this seed into `out`, and return the file names."""
    from studies.relative_motion import figures  # noqa: PLC0415 - matplotlib is an extra

    return figures.draw_flight(*_example(first_seed), out)


def _draw(result: Result, examples: dict[str, dict[str, Array]], out: Path) -> tuple[str, ...]:
    """Figures of the first seed, into the folder `out`."""
    from studies.relative_motion import figures  # noqa: PLC0415 - matplotlib is an extra

    return figures.draw(*_example(result.first_seed), result, examples, out)


def _example(seed: int) -> tuple[Flight, Camera, dict[str, Track]]:
    """The reference flight of a seed, its camera, and the tracks that are drawn, by method."""
    flights, setting = flown(VARIANTS[0], (seed,))
    tracks = {method.name: _tracks(VARIANTS[0], flights, setting, method)[0] for method in SHOWN}
    return flights.one(0), setting.camera, tracks
