"""Encounters with leaders that others flew: every log of a folder, from every side.

Camera and errors are those of simlink's scenario `recorded`: 1 px, 3 % of images lost, and our own errors within
the daemon's defaults. A log does not say how large its vehicle was: a wingspan is drawn.
"""

from functools import lru_cache
from pathlib import Path
from typing import Final

import numpy as np
from msgspec.structs import replace

from simlink.encounters.encounter import DURATION_S, Encounter
from simlink.encounters.families import LeaderClass
from simlink.encounters.others import GEOMETRY_NAMES, max_duration, recorded_encounter
from simlink.encounters.recording import SUFFIXES, LogError
from simlink.encounters.trajectory import Trajectory, read_trajectories
from simlink.scenarios.scenario import load_scenario
from simlink.world.drawn import Range
from simlink.world.noise import stream

SCENARIO: Final = "recorded"
MIN_DURATION_S: Final = 20.0
WINGSPAN: Final[dict[LeaderClass, Range]] = {"multirotor": (0.35, 1.2), "fixed_wing": (1.0, 2.5)}  # m
RECORDED_FOLLOWER_SHARE: Final = 0.5  # the other followers are drawn
MAX_WRONG_PERCENT: Final = 3.0  # of valid estimates
MIN_INSIDE_PERCENT: Final = 90.0  # of valid estimates


def logs_of(folder: Path) -> list[Path]:
    """The logs in a folder and below."""
    return sorted(path for path in folder.rglob("*") if path.suffix.lower() in SUFFIXES and path.is_file())


def usable(folder: Path) -> tuple[list[Path], list[str]]:
    """The logs of a folder from which a flight can be taken, and why not from others.

    Raises ValueError if no log has a flight.
    """
    found, refused = [], []
    for path in logs_of(folder):
        try:
            read_trajectories(path)
            found.append(path)
        except LogError as error:
            refused.append(str(error).removeprefix(f"{folder}/"))
    if not found:
        why = "; ".join(refused) or f"it holds no {', '.join(SUFFIXES)}"
        raise ValueError(f"{folder} holds no flight: {why}")
    return found, refused


@lru_cache(maxsize=8)
def flight_of(path: Path) -> Trajectory | None:
    """The longest flight of a log; None without one."""
    try:
        return read_trajectories(path)[0]
    except LogError:
        return None


def encounter(path: Path, geometry: str, seed: int) -> Encounter | None:
    """The encounter `seed` with the leader of a log; None where its flight allows none.

    In half of them, another multirotor of the same folder follows.
    """
    leader, rng = flight_of(path), stream(seed, f"encounters.others.{path.name}")
    if leader is None:
        return None
    wingspan = float(np.exp(rng.uniform(*np.log(WINGSPAN[leader.leader_class]))))
    scenario = load_scenario(SCENARIO)
    scenario = replace(scenario, leader=replace(scenario.leader, size=round(wingspan, 3)))
    follower = None
    if rng.uniform() < RECORDED_FOLLOWER_SHARE:
        there = logs_of(path.parent)
        other = flight_of(there[int(rng.integers(len(there)))])
        if other is not None and other.leader_class == "multirotor":
            follower = other
    flights = [leader] if follower is None else [leader, follower]
    seconds = min(DURATION_S, max_duration(geometry, flights))
    try:
        return recorded_encounter(
            scenario, seed, leader, geometry, max(seconds, MIN_DURATION_S), follower=follower
        )
    except LogError:
        return None


GEOMETRIES: Final = GEOMETRY_NAMES
