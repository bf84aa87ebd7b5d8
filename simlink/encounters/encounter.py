"""One encounter: its truth, and what our vehicle's computer receives. It depends on family and seed alone."""

from collections.abc import Iterator
from typing import Final, Literal, NamedTuple

import numpy as np
from msgspec.structs import replace

from onboard.messages import Datagram
from simlink.encounters.attitudes import fixed_wing_attitude, follower_attitude, multirotor_attitude
from simlink.encounters.conditions import draw_conditions, draw_gimbal, draw_wind
from simlink.encounters.curves import wobble
from simlink.encounters.departures import NONE, Departure, depart
from simlink.encounters.families import FAMILIES, LeaderClass
from simlink.encounters.truth import EncounterTruth, states
from simlink.scenarios.camera import SEES, Sees
from simlink.scenarios.scenario import Scenario
from simlink.sensors.arrays import Array
from simlink.simulation import boot_ns_of, datagrams
from simlink.world.constants import DT, steps_of
from simlink.world.drawn import drawn
from simlink.world.noise import stream

SECONDS: Final = 45.0
BOOT_NS: Final = boot_ns_of(Scenario())  # the boot clock at time 0 of the truth
Mount = Literal["fixed", "gimbal"]
MOUNTS: Final[tuple[Mount, ...]] = ("fixed", "gimbal")


class Encounter(NamedTuple):
    """`scenario` has the camera, the autopilot and their errors as they were drawn; of its leader only the size
    counts, for the truth says how both fly. `drag` (1/s) is the leader's."""

    family: str
    seed: int
    leader_class: LeaderClass
    drag: float
    scenario: Scenario
    truth: EncounterTruth

    def datagrams(self) -> Iterator[Datagram]:
        """What arrives at our vehicle's computer, in order."""
        seconds, world = self.truth.t[-1], states(self.truth)
        flown = datagrams(self.scenario, _seed_of(self.family, self.seed), seconds, world=world)
        return (item for item in flown if isinstance(item, Datagram))


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
    conditions = conditions._replace(scenario=drawn(conditions.scenario, own_seed))
    t: Array = DT * np.arange(steps_of(seconds) + 1, dtype=np.float64)
    scene, (drag, scenario) = depart(
        FAMILIES[family](rng, t, departure.vigour),
        conditions,
        departure,
        stream(own_seed, "encounters.departure"),
    )
    leader, nose, follower, wind, leader_class = scene
    bank_error, nose_error = (
        wobble(own_seed, f"encounters.{name}", process, len(t), np.pi / 180)
        for name, process in (
            ("bank", scenario.leader.bank_wobble_deg),
            ("nose", scenario.leader.heading_wobble_deg),
        )
    )
    nose = nose + nose_error
    if leader_class == "fixed_wing":
        euler_L = fixed_wing_attitude(leader, nose)
    else:
        euler_L = multirotor_attitude(leader, nose, wind, drag)
    euler_L[:, 0] += bank_error
    r_FL_n = leader.r - follower.r
    truth = EncounterTruth(
        t=t,
        leader=leader,
        euler_L=euler_L,
        follower=follower,
        euler_F=follower_attitude(rng, own_seed, t, follower, r_FL_n, scenario.camera.mount_rpy_deg),
    )
    camera, vehicle = replace(scenario.camera, sees=sees), scenario.vehicle
    if mount == "gimbal":  # it sweeps about where the fixed camera would look, but level
        aside = camera.mount_rpy_deg[2]
        gimbal = draw_gimbal(stream(own_seed, "encounters.gimbal"))
        camera = replace(camera, gimbal=gimbal, mount_rpy_deg=(0.0, 0.0, aside))
    if feels_wind:
        vehicle = replace(vehicle, wind=draw_wind(stream(own_seed, "encounters.wind"), wind))
    scenario = replace(scenario, camera=camera, vehicle=vehicle)
    return Encounter(family, seed, leader_class, drag, scenario, truth)


def _seed_of(family: str, seed: int) -> int:
    """A seed of the streams, another for each family and seed."""
    return seed * len(FAMILIES) + list(FAMILIES).index(family)
