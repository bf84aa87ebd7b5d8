"""One encounter: its truth, and what our vehicle's computer receives. It depends on family and seed alone."""

from typing import Final, NamedTuple

import numpy as np

from onboard.messages import Message
from simlink.encounters.attitudes import fixed_wing_attitude, follower_attitude, multirotor_attitude
from simlink.encounters.conditions import Conditions, draw_conditions
from simlink.encounters.curves import wobble
from simlink.encounters.departures import NONE, Departure, depart
from simlink.encounters.families import FAMILIES, LeaderClass
from simlink.encounters.gimbals import MOUNTS, Mount
from simlink.encounters.reports import in_order, received, winds
from simlink.encounters.shapes import SEES, Sees
from simlink.encounters.truth import EncounterTruth
from simlink.sensors.arrays import Array
from simlink.world.constants import DT, steps_of
from simlink.world.noise import stream

SECONDS: Final = 45.0


class Encounter(NamedTuple):
    """`messages` are in the order of their arrival; times are on the boot clock, as is `truth.t`."""

    family: str
    seed: int
    leader_class: LeaderClass
    conditions: Conditions
    truth: EncounterTruth
    messages: tuple[Message, ...]
    mount: Mount = "fixed"


def make_encounter(
    family: str,
    seed: int,
    seconds: float = SECONDS,
    sees: Sees = "wing",
    *,
    mount: Mount = "fixed",
    feels_wind: bool = False,
    departure: Departure = NONE,
) -> Encounter:
    """The encounter `seed` (>= 0) of a family. The flight is the same whatever the detector `sees` of the leader,
    whatever the camera's `mount` is, and whether our autopilot estimates the wind; a `departure` changes nothing
    but what it names.

    Raises ValueError for a family that is none of FAMILIES, for `sees` that is none of SEES, and for a `mount`
    that is none of MOUNTS.
    """
    if mount not in MOUNTS:
        raise ValueError(f"no mount {mount!r}; known: {', '.join(MOUNTS)}")
    if sees not in SEES:
        raise ValueError(f"no detector sees {sees!r}; known: {', '.join(SEES)}")
    if family not in FAMILIES:
        raise ValueError(f"no family {family!r}; known: {', '.join(FAMILIES)}")
    own_seed = _seed_of(family, seed)
    rng = stream(own_seed, "encounters.geometry")
    conditions = draw_conditions(stream(own_seed, "encounters.conditions"))
    t: Array = DT * np.arange(steps_of(seconds) + 1, dtype=np.float64)
    scene, conditions = depart(
        FAMILIES[family](rng, t, departure.vigour),
        conditions,
        departure,
        stream(own_seed, "encounters.departure"),
    )
    leader, nose, follower, wind, leader_class = scene
    nose = nose + wobble(own_seed, "encounters.nose", conditions.nose_wobble_deg, len(t), np.pi / 180)
    if leader_class == "fixed_wing":
        euler_L = fixed_wing_attitude(leader, nose)
    else:
        euler_L = multirotor_attitude(leader, nose, wind, conditions.drag)
    euler_L[:, 0] += wobble(own_seed, "encounters.bank", conditions.bank_wobble_deg, len(t), np.pi / 180)
    r_FL_n = leader.r - follower.r
    truth = EncounterTruth(
        t=t,
        leader=leader,
        euler_L=euler_L,
        follower=follower,
        euler_F=follower_attitude(rng, own_seed, t, follower, r_FL_n, conditions.camera.mount_rpy_deg),
    )
    messages = received(truth, conditions, own_seed, sees, mount)
    if feels_wind:
        messages = in_order([*messages, *winds(truth, wind, own_seed)])
    return Encounter(family, seed, leader_class, conditions, truth, messages, mount)


def _seed_of(family: str, seed: int) -> int:
    """A seed of the streams, another for each family and seed."""
    return seed * len(FAMILIES) + list(FAMILIES).index(family)
