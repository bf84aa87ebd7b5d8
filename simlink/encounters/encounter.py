"""One encounter: its truth, and what our vehicle's computer receives. It depends on family and seed alone."""

from collections.abc import Iterator
from typing import Final, Literal, NamedTuple
from zlib import crc32

import numpy as np
from msgspec.structs import replace

from onboard.messages import Datagram
from simlink.encounters.attitudes import fixed_wing_attitude, follower_attitude, multirotor_attitude
from simlink.encounters.conditions import NOMINAL_SIZE, draw_conditions, draw_gimbal, draw_wind
from simlink.encounters.curves import Motion, wobble
from simlink.encounters.departures import NONE, Departure, depart
from simlink.encounters.families import FAMILIES, LeaderClass, Scene
from simlink.encounters.truth import EncounterTruth, states
from simlink.scenarios.camera import SEES, Camera, Sees, lens_of
from simlink.scenarios.formation import Leader
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
    counts, for the truth says how both fly. `drag` (1/s) is the leader's; `manoeuvre` is as of `Scene`."""

    family: str
    seed: int
    leader_class: LeaderClass
    drag: float
    scenario: Scenario
    truth: EncounterTruth
    manoeuvre: float | None = None
    size_prior: float = NOMINAL_SIZE  # m: what the leader's maker says of its wingspan

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
    for what, value, known in (("family", family, FAMILIES), ("sees", sees, SEES), ("mount", mount, MOUNTS)):
        if value not in known:
            raise ValueError(f"{what}: no {value!r}; known: {', '.join(known)}")
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
    r_FL_n = scene.leader.r - scene.follower.r
    c = scenario.camera
    edge = np.arctan(lens_of(c).image_point(0.5 * c.width_px / c.f_px, 0.0)[0])
    sight = np.unwrap(np.arctan2(r_FL_n[:, 1], r_FL_n[:, 0])) + edge * scene.aim
    truth = EncounterTruth(
        t=t,
        leader=scene.leader,
        euler_L=_leader_attitude(scene, drag, scenario.leader, own_seed),
        follower=scene.follower,
        euler_F=follower_attitude(rng, own_seed, t, scene.follower, sight, scenario.camera.mount_rpy_deg),
        other=scene.other,
        euler_O=None if scene.other is None else _other_attitude(scene.other, scene.wind, drag),
    )
    camera, vehicle = _mounted(scenario.camera, mount, scene.elevation, own_seed), scenario.vehicle
    if feels_wind:
        vehicle = replace(vehicle, wind=draw_wind(stream(own_seed, "encounters.wind"), scene.wind))
    scenario = replace(scenario, camera=replace(camera, sees=sees, **scene.camera), vehicle=vehicle)
    return Encounter(family, seed, scene.leader_class, drag, scenario, truth, scene.manoeuvre)


def _leader_attitude(scene: Scene, drag: float, wobbles: Leader, own_seed: int) -> Array:
    """The leader's Euler angles (N, 3): those of its flight, and their wobble."""
    processes = {"bank": wobbles.bank_wobble_deg, "nose": wobbles.heading_wobble_deg}
    bank_error, nose_error = (
        wobble(own_seed, f"encounters.{name}", process, len(scene.nose), np.pi / 180)
        for name, process in processes.items()
    )
    nose = scene.nose + nose_error
    if scene.leader_class == "fixed_wing":
        euler = fixed_wing_attitude(scene.leader, nose)
    else:
        euler = multirotor_attitude(scene.leader, nose, scene.wind, drag, scene.sail)
    euler[:, 0] += bank_error
    return euler


def _other_attitude(motion: Motion, wind: Array, drag: float) -> Array:
    """The Euler angles (N, 3) of another multirotor, its nose on its course."""
    return multirotor_attitude(motion, np.unwrap(np.arctan2(motion.v[:, 1], motion.v[:, 0])), wind, drag)


def _mounted(camera: Camera, mount: Mount, elevation: float, own_seed: int) -> Camera:
    """The camera on its mount, which looks `elevation` (rad) above the horizon. A gimbal sweeps about where the
    fixed camera would look, but level."""
    roll, up, aside = camera.mount_rpy_deg
    raised = float(np.degrees(elevation))
    if mount == "fixed":
        return replace(camera, mount_rpy_deg=(roll, up + raised, aside))
    gimbal = draw_gimbal(stream(own_seed, "encounters.gimbal"))
    return replace(camera, gimbal=gimbal, mount_rpy_deg=(0.0, raised, aside))


def _seed_of(family: str, seed: int) -> int:
    """A seed of the streams, another for each family and seed, whatever other families there are."""
    return seed << 32 | crc32(family.encode())
