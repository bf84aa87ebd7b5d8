"""Measure both example detectors, and print the tables of docs/detectors.md.

    python examples/learned_train.py
    python docs/detectors.py --pictures 200 --seeds 5

Pictures and flights are those of seeds that `learned_train.py` does not use. A wingtip is right within 3 px, or
within a tenth of the visible wing if that is more; an aircraft is found if both are right. The contour has no
center of its own, so the middle between its wingtips is used.
"""

import argparse
import sys
import time
from collections.abc import Iterator, Mapping
from itertools import chain
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from onboard.arrays import Array
from simlink.scenarios.scenario import load_scenario
from simlink.sensors.pictures import Find, Painter, picture_detector
from simlink.world.drawn import draw_scenario
from simlink.world.truth import true_size
from studies.closed_loop.flight import Flight, fly
from studies.closed_loop.scores import SETTLING_TIME_S

sys.path.insert(0, str(Path(__file__).parents[1] / "examples"))

import contour
import learned
from learned_train import Scene, draw_pictures

FIRST_SEED: Final = 901  # of what nothing was trained or chosen on
DETECTORS: Final[dict[str, Find]] = {"contour": contour.find, "learned": learned.find}
MAX_ERROR_PX: Final = 3.0
MAX_ERROR_RATIO: Final = 0.1  # of the wing
SCENES: Final = {
    "7 to 15 m, from behind": Scene((7.0, 15.0), 0.0, 0.0, 1.0),
    "15 to 30 m, from behind": Scene((15.0, 30.0), 0.0, 0.0, 1.0),
    "30 to 50 m, from behind": Scene((30.0, 50.0), 0.0, 0.0, 1.0),
    "50 to 70 m, from behind": Scene((50.0, 70.0), 0.0, 0.0, 1.0),
    "15 to 30 m, from any side": Scene((15.0, 30.0), 0.0, 0.0, 0.0),
    "15 to 30 m, from behind, beside other things": Scene((15.0, 30.0), 0.0, 1.0, 1.0),
    "no aircraft": Scene((15.0, 30.0), 1.0, 0.0, 1.0),
    "no aircraft, other things": Scene((15.0, 30.0), 1.0, 1.0, 1.0),
}


class Counted(NamedTuple):
    """The results of a detector on pictures."""

    found: float  # %
    wrong: float  # %
    missed: float  # %
    center: float  # px, RMS of each coordinate where it was found
    tips: float  # px, the same
    ms: float  # of one core for a picture


def measured(find: Find, scene: Scene, seed: int, count: int) -> Counted:
    """Measure a detector on drawn pictures."""
    outcomes, errors = [], []
    took = 0.0
    for picture, truth in draw_pictures(seed, count, scene):
        before = time.process_time()
        points = find(picture)
        took += time.process_time() - before
        if points is None:
            outcomes.append("missed")
            continue
        if truth is None:
            outcomes.append("wrong")
            continue
        off = _off(points, truth)
        within = max(MAX_ERROR_PX, MAX_ERROR_RATIO * float(np.linalg.norm(truth[1] - truth[2])))
        is_right = bool((np.linalg.norm(off[1:], axis=1) <= within).all())
        outcomes.append("found" if is_right else "wrong")
        errors += [off] if is_right else []
    found, wrong, missed = (100.0 * outcomes.count(name) / count for name in ("found", "wrong", "missed"))
    squares = np.array(errors).reshape(-1, 3, 2) ** 2
    center, tips = (float(np.sqrt(part.mean())) if errors else np.nan for part in (squares[:, 0], squares[:, 1:]))
    return Counted(found, wrong, missed, center, tips, 1e3 * took / count)


def _off(points: Mapping[str, tuple[float, float, float]], truth: npt.NDArray[np.float32]) -> Array:
    """Return the errors of center, left and right (3, 2), px."""
    left, right = (np.array(points[name][:2]) for name in ("left", "right"))
    center = np.array(points["center"][:2]) if "center" in points else (left + right) / 2
    # of an upright wing it is open which tip is the left one
    return min((np.array([center, *tips]) - truth for tips in ((left, right), (right, left))), key=np.linalg.norm)


def pictures(count: int) -> Iterator[str]:
    """Yield the table of single pictures, line by line."""
    yield "| pictures | detector | found | wrong | missed | center | wingtips | a picture |"
    yield "|---|---|---|---|---|---|---|---|"
    for k, (name, scene) in enumerate(SCENES.items()):
        for detector, find in DETECTORS.items():
            c = measured(find, scene, FIRST_SEED + k, count)
            errors = (f"{error:.2f} px" if c.found else "–" for error in (c.center, c.tips))
            yield (
                f"| {name} | {detector} | {c.found:.1f} % | {c.wrong:.1f} % | {c.missed:.1f} % | "
                f"{' | '.join(errors)} | {c.ms:.1f} ms |"
            )


def flown(find: Find, seed: int, seconds: float) -> Flight:
    """Fly `pictures-follow` in simulated time on the detections of a detector alone."""
    scenario = load_scenario("pictures-follow")
    painter = Painter(draw_scenario(scenario, seed).camera, true_size(scenario, seed), seed)
    return fly(scenario, seed, seconds, detect=picture_detector(find, painter))


def flights(seeds: int, seconds: float) -> Iterator[str]:
    """Yield the table of flights, line by line."""
    yield "| seed | detector | valid | follows | slot error, RMS | at most | least distance |"
    yield "|---|---|---|---|---|---|---|"
    engage = load_scenario("pictures-follow").follow
    begin = (0.0 if engage is None else engage.engage) + SETTLING_TIME_S
    for seed in range(FIRST_SEED, FIRST_SEED + seeds):
        for detector, find in DETECTORS.items():
            flight = flown(find, seed, seconds)
            k = flight.t >= begin
            error = flight.slot_error[k]
            valid, following = (100.0 * float(share[k].mean()) for share in (flight.valid, flight.following))
            rms, most, least = np.sqrt((error**2).mean()), error.max(), flight.distance[k].min()
            yield (
                f"| {seed} | {detector} | {valid:.1f} % | {following:.1f} % | {rms:.2f} m | {most:.2f} m | "
                f"{least:.1f} m |"
            )


def main() -> int:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pictures", type=int, default=200, metavar="N", help="of a kind (default: %(default)s)")
    parser.add_argument("--seeds", type=int, default=5, metavar="N", help="flights (default: %(default)s)")
    parser.add_argument("--duration", type=float, default=90.0, metavar="S", help="of each (default: %(default)s)")
    given = parser.parse_args()
    for line in chain(pictures(given.pictures), [""], flights(given.seeds, given.duration)):
        print(line, flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
