"""The flights of the study of encounters: simlink's random encounters through the daemon's pipeline as it ships,
with nothing configured but the leader's size and class, and where the camera is mounted."""

from collections.abc import Callable, Iterable, Sequence
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.config import load_config
from onboard.filters.gating import normalised_squared
from onboard.messages import Datagram, Estimate, Message, Vec3
from onboard.pipeline import Pipeline
from simlink.encounters.conditions import NOMINAL_SIZE
from simlink.encounters.departures import NONE, Departure
from simlink.encounters.encounter import BOOT_NS, Encounter, Mount, make_encounter
from simlink.encounters.encounter import SECONDS as WHOLE
from simlink.encounters.families import FAMILIES
from simlink.encounters.truth import EncounterTruth, at
from simlink.scenarios.camera import Sees
from simlink.scenarios.formation import NAMED_POINTS

SECONDS: Final = WHOLE
SETTLE: Final = 5.0  # s before estimates count
FINDS: Final = {
    "points": ", five points",
    "box": ", box alone",
    "rotor_box": ", box around a quadrotor",
    "pose": ", pose alone",
    "wing_pose": ", pose as well",
}
WINGED: Final = ("estimator.leader.aircraft=fixed-wing",)  # whatever its class: what simlink's plain boxes bound
ON_WING: Final = ("estimator.leader.center_on_wing=true",)


class Case(NamedTuple):
    """A family, flown with settings beyond size and class, with a detector that `sees` more or less of it, with
    the camera on a `mount`, and with a `departure` from what the estimator assumes."""

    family: str
    settings: tuple[str, ...] = ()
    sees: Sees = "wing"
    feels_wind: bool = False  # our autopilot estimates it
    mount: Mount = "fixed"
    departure: Departure = NONE

    @property
    def name(self) -> str:
        """What the report calls it."""
        known = ", center on wing" if self.settings == ON_WING else ", wind estimated" if self.feels_wind else ""
        moves = ", on a gimbal" if self.mount == "gimbal" else ""
        return self.family.replace("_", " ") + known + FINDS.get(self.sees, "") + moves


# As the simulator's points are for a wing of the nominal size, but that each true one is misplaced a little.
FIVE_POINTS: Final = (
    *(
        f"estimator.leader.points_m.{name}={[NOMINAL_SIZE * x for x in point]}"
        for name, point in NAMED_POINTS.items()
    ),
    "estimator.leader.named_wingtips=true",
)
DEFAULTS: Final = tuple(Case(family) for family in FAMILIES)
WITH_CENTER: Final = (Case("hover", ON_WING), Case("circling", ON_WING))
IN_WIND: Final = (Case("crab", feels_wind=True),)
POINTS: Final = tuple(Case(family, FIVE_POINTS, "points") for family in ("hover", "sideways", "wander"))
POSES: Final = tuple(Case(family, sees="pose") for family in ("behind", "hover", "wander"))
BOXES: Final = tuple(Case(family, WINGED, "box") for family in ("behind", "crossing", "wander"))
ROTORS: Final = tuple(Case(family, sees="rotor_box") for family in ("hover", "wander"))
GIMBALS: Final = (
    Case("behind", mount="gimbal"),
    *(Case(family, FIVE_POINTS, "points", mount="gimbal") for family in ("hover", "wander")),
)
CASES: Final = (*DEFAULTS, *WITH_CENTER, *IN_WIND, *POINTS, *BOXES, *ROTORS, *POSES, *GIMBALS)


class Flight(NamedTuple):
    """Every estimate of one flight from SETTLE s on (n,): its time (s), the true range, and what was estimated,
    NaN where it was not valid: range and its standard deviation (m), and the position's NEES."""

    t: Array
    distance: Array
    range_: Array
    sigma: Array
    nees: Array


def fly(case: Case, seed: int, settings: Sequence[str] = ()) -> Flight:
    """One encounter through a pipeline of its own; `settings` are overrides on top of the case's."""
    encounter = make_encounter(
        case.family,
        seed,
        SECONDS,
        case.sees,
        mount=case.mount,
        feels_wind=case.feels_wind,
        departure=case.departure,
    )
    off = mount_off(case.departure.mount_off_deg, seed)
    config = load_config(None, (*known(encounter, off), *case.settings, *settings))
    return judged(estimated(Pipeline(config), encounter.datagrams()), encounter.truth)


def mount_off(degrees: float, seed: int) -> Vec3:
    """By how much the camera is configured wrongly, in degrees: about one axis to one side, others by seed."""
    wrong = [0.0, 0.0, 0.0]
    wrong[seed % 3] = degrees if seed % 2 else -degrees
    return wrong[0], wrong[1], wrong[2]


def known(encounter: Encounter, off: Vec3 = (0.0, 0.0, 0.0)) -> tuple[str, ...]:
    """Settings: what is known of this encounter's leader, and of the mount of its follower's camera, whose angles
    are `off` by so much, degrees."""
    camera = encounter.scenario.camera
    gimbal = () if camera.gimbal is None else (f"camera.gimbal={camera.gimbal.component}",)
    return (
        f"estimator.leader.size_prior_m={NOMINAL_SIZE}",
        f"estimator.leader.leader_class={encounter.leader_class}",
        *gimbal,
        f"camera.mount_rpy_deg={[a + b for a, b in zip(camera.mount_rpy_deg, off, strict=True)]}",
        f"camera.mount_offset_m={list(camera.mount_offset)}",
    )


def received(encounter: Encounter, settings: Sequence[str] = ()) -> list[Message]:
    """What our vehicle's computer reads of an encounter, in order."""
    pipeline = Pipeline(load_config(None, (*known(encounter), *settings)))
    return [message for datagram in encounter.datagrams() for message in pipeline.decode(datagram)]


def estimated(
    pipeline: Pipeline,
    datagrams: Iterable[Datagram],
    change: Callable[[list[Message]], list[Message]] = lambda messages: messages,
) -> Array:
    """The leader's estimates (n, 13), in order: time of the encounter (s), r_FL_n (3), its covariance (9), NaN
    where not valid. `change`: what becomes of the messages of one datagram."""
    outputs = (output for datagram in datagrams for output in pipeline.advance(change(pipeline.decode(datagram))))
    rows = [
        ((output.t_ns - BOOT_NS) * 1e-9, *_position(output))
        for output in outputs
        if isinstance(output, Estimate) and output.name == "leader" and output.is_primary
    ]
    return np.array(rows, dtype=float).reshape(-1, 13)


def judged(estimates: Array, truth: EncounterTruth) -> Flight:
    """Estimates (n, 13), as of `estimated`, beside the truth at their times."""
    later = estimates[(estimates[:, 0] >= SETTLE) & (estimates[:, 0] <= truth.t[-1])]
    t, mean, P = later[:, 0], later[:, 1:4], later[:, 4:].reshape(-1, 3, 3)
    r_FL_n = at(truth.t, truth.r_FL_n, t)
    range_ = np.linalg.norm(mean, axis=1)
    direction = mean / range_[:, None]
    nees, valid = np.full(len(t), np.nan), np.isfinite(range_)
    nees[valid] = normalised_squared(mean[valid] - r_FL_n[valid], P[valid])
    return Flight(
        t=t,
        distance=np.linalg.norm(r_FL_n, axis=1),
        range_=range_,
        sigma=np.sqrt(np.einsum("ni,nij,nj->n", direction, P, direction)),
        nees=nees,
    )


def _position(estimate: Estimate) -> tuple[float, ...]:
    """Mean (3) and covariance (9) of the position; NaN if it is not valid."""
    if not estimate.valid or estimate.mean is None or estimate.covariance is None:
        return (float("nan"),) * 12
    return *estimate.mean[:3], *(x for row in estimate.covariance[:3] for x in row[:3])
