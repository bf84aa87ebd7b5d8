"""One encounter: its truth and the datagrams that our computer receives.

It depends on family and seed alone.
"""

from collections.abc import Iterator
from typing import Final, Literal, NamedTuple
from zlib import crc32

import numpy as np
from msgspec.structs import replace

from onboard.messages import Datagram
from simlink.encounters.attitudes import fixed_wing_attitude, follower_attitude, multirotor_attitude
from simlink.encounters.conditions import NOMINAL_SIZE, draw_conditions, draw_gimbal
from simlink.encounters.curves import Motion, wobble
from simlink.encounters.departures import NO_DEPARTURE, Departure, depart
from simlink.encounters.families import FAMILIES, LeaderClass, Scene
from simlink.encounters.truth import EncounterTruth, states
from simlink.scenarios.camera import SEES, Camera, Sees, lens_of
from simlink.scenarios.formation import Leader
from simlink.scenarios.scenario import Scenario
from simlink.sensors.arrays import Array
from simlink.simulation import boot_time_ns, datagrams
from simlink.world.constants import DT, step_count
from simlink.world.drawn import draw_scenario
from simlink.world.noise import stream

DURATION_S: Final = 45.0
BOOT_NS: Final = boot_time_ns(Scenario())  # the boot clock at time 0 of the truth
Mount = Literal["fixed", "gimbal"]
MOUNTS: Final[tuple[Mount, ...]] = ("fixed", "gimbal")


class Encounter(NamedTuple):
    """One encounter, with the camera, the autopilot and their errors as drawn in `scenario`.

    Of the scenario's leader only the size counts, since `truth` holds both motions. `drag` (1/s) is the leader's;
    `manoeuvre` is that of `Scene`.
    """

    family: str
    seed: int
    leader_class: LeaderClass
    drag: float
    scenario: Scenario
    truth: EncounterTruth
    manoeuvre: float | None = None
    size_prior: float = NOMINAL_SIZE  # m: what the leader's maker says of its wingspan

    def datagrams(self) -> Iterator[Datagram]:
        """Yield the datagrams that our computer receives, in order."""
        seconds, world = self.truth.t[-1], states(self.truth)
        flown = datagrams(self.scenario, _stream_seed(self.family, self.seed), seconds, world=world)
        return (item for item in flown if isinstance(item, Datagram))


def make_encounter(
    family: str,
    seed: int,
    seconds: float = DURATION_S,
    sees: Sees = "wing",
    *,
    mount: Mount = "fixed",
    departure: Departure = NO_DEPARTURE,
) -> Encounter:
    """Return the encounter `seed` (>= 0) of a family.

    The flight is the same for every detector (`sees`) and `mount`. A `departure` changes only what it names.

    Raises ValueError for a family that is not in FAMILIES, for `sees` not in SEES, and for a `mount` not in
    MOUNTS.
    """
    for what, value, known in (("family", family, FAMILIES), ("sees", sees, SEES), ("mount", mount, MOUNTS)):
        if value not in known:
            raise ValueError(f"unknown {what} {value!r}; choose one of {', '.join(known)}")
    own_seed = _stream_seed(family, seed)
    rng = stream(own_seed, "encounters.geometry")
    conditions = draw_conditions(stream(own_seed, "encounters.conditions"))
    conditions = conditions._replace(scenario=draw_scenario(conditions.scenario, own_seed))
    t: Array = DT * np.arange(step_count(seconds) + 1, dtype=np.float64)
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
    camera = _mount_camera(scenario.camera, mount, scene.elevation, own_seed)
    scenario = replace(scenario, camera=replace(camera, sees=sees, **scene.camera))
    return Encounter(family, seed, scene.leader_class, drag, scenario, truth, scene.manoeuvre)


def _leader_attitude(scene: Scene, drag: float, wobbles: Leader, own_seed: int) -> Array:
    """Return the leader's Euler angles (N, 3) with their random errors."""
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
    """Return the Euler angles (N, 3) of another multirotor, which points along its course."""
    return multirotor_attitude(motion, np.unwrap(np.arctan2(motion.v[:, 1], motion.v[:, 0])), wind, drag)


def _mount_camera(camera: Camera, mount: Mount, elevation: float, own_seed: int) -> Camera:
    """Return the camera on its mount, which points `elevation` (rad) above the horizon.

    A gimbal sweeps about the direction of the fixed camera, without its roll and tilt.
    """
    roll, up, aside = camera.mount_rpy_deg
    raised = float(np.degrees(elevation))
    if mount == "fixed":
        return replace(camera, mount_rpy_deg=(roll, up + raised, aside))
    gimbal = draw_gimbal(stream(own_seed, "encounters.gimbal"))
    return replace(camera, gimbal=gimbal, mount_rpy_deg=(0.0, raised, aside))


def _stream_seed(family: str, seed: int) -> int:
    """Return the seed of an encounter's streams, different for each family and seed."""
    return seed << 32 | crc32(family.encode())
