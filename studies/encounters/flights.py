"""The flights of the study of encounters, through the daemon's default pipeline.

Only the leader's size and class and the camera's mount are configured.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.config import load_config
from onboard.filters.gating import chi_square_threshold, normalised_squared
from onboard.messages import Datagram, Estimate, Message, Vec3
from onboard.models.relative_motion import A_LAT, A_LONG
from onboard.pipeline import Pipeline
from simlink.encounters.conditions import NOMINAL_SIZE
from simlink.encounters.departures import NO_DEPARTURE, Departure
from simlink.encounters.encounter import BOOT_NS, Encounter, Mount, make_encounter
from simlink.encounters.encounter import DURATION_S as ENCOUNTER_DURATION_S
from simlink.encounters.families import FAMILIES
from simlink.encounters.truth import EncounterTruth, at
from simlink.scenarios.camera import Sees
from simlink.scenarios.formation import NAMED_POINTS
from simlink.world.truth import path_accelerations
from studies.encounters import recorded

DURATION_S: Final = ENCOUNTER_DURATION_S
SETTLING_TIME_S: Final = 5.0  # before estimates count
MANOEUVRE_TIME_S: Final = 8.0  # from the beginning of a manoeuvre
NO_VALUES: Final[Array] = np.empty(0)
MIN_COURSE_SPEED_M_S: Final = 2.0  # over ground: a_lat and a_long of a slower leader have no direction
MIN_STRAY_NEES: Final = chi_square_threshold(0.9973, 3)  # of the leader, where another aircraft has a smaller one
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
    """A family flown with settings, a detector, a mount and a departure."""

    family: str
    settings: tuple[str, ...] = ()  # beyond size and class
    sees: Sees = "wing"  # how much of the leader the detector does
    mount: Mount = "fixed"  # of the camera
    departure: Departure = NO_DEPARTURE  # from what the estimator assumes
    log: str = ""  # a file with a recorded flight, which the leader flies; `family` is then a geometry

    @property
    def name(self) -> str:
        """The name in the report."""
        if self.log:
            return f"{Path(self.log).name}, {self.family}"
        known = ", center on wing" if self.settings == ON_WING else ""
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
CLASSES: Final = (
    f"target.drone={{size_prior_m = {NOMINAL_SIZE}}}",
    'target.airplane={size_prior_m = 12.0, leader_class = "fixed_wing"}',
)
# Families about a detector fly with it: boxes that may be cut or have no ids, classes that are configured.
_OF_DETECTORS: Final[Mapping[str, Case]] = {
    "cut": Case("cut", sees="rotor_box"),
    "class_flickers": Case("class_flickers", CLASSES),
    "two_cross": Case("two_cross", sees="rotor_box"),
}
DEFAULTS: Final = tuple(_OF_DETECTORS.get(family, Case(family)) for family in FAMILIES)
WITH_CENTER: Final = (Case("hover", ON_WING), Case("circling", ON_WING))
POINTS: Final = tuple(Case(family, FIVE_POINTS, "points") for family in ("hover", "sideways", "wander"))
POSES: Final = tuple(Case(family, sees="pose") for family in ("behind", "hover", "wander"))
BOXES: Final = tuple(Case(family, WINGED, "box") for family in ("behind", "crossing", "wander"))
ROTORS: Final = tuple(Case(family, sees="rotor_box") for family in ("hover", "wander"))
GIMBALS: Final = (
    Case("behind", mount="gimbal"),
    *(Case(family, FIVE_POINTS, "points", mount="gimbal") for family in ("hover", "wander")),
)
CASES: Final = (*DEFAULTS, *WITH_CENTER, *POINTS, *BOXES, *ROTORS, *POSES, *GIMBALS)


class Flight(NamedTuple):
    """Every estimate of one flight from SETTLING_TIME_S on, each field (n,) if not stated otherwise.

    Estimates are NaN when they are not valid.
    """

    t: Array  # s
    distance: Array  # m, the true range
    range_: Array  # m
    sigma: Array  # m, of the range
    nees: Array  # of the position
    velocity_nees: Array = NO_VALUES
    manoeuvre: float = math.nan  # s, when the leader begins the one manoeuvre of its family; NaN: it has none
    strays: Array | bool = False  # (n,): the published leader fits another aircraft better, and not the leader
    acceleration_nees: Array = NO_VALUES  # of a_lat and a_long; NaN also where the leader has no course

    @property
    def after(self) -> "Flight":
        """The estimates of the MANOEUVRE_TIME_S from its manoeuvre on."""
        since = self.t - self.manoeuvre
        during = (since >= 0.0) & (since <= MANOEUVRE_TIME_S)
        t, distance, range_, sigma, nees, velocity_nees = (x[during] for x in self[:6])
        strays = np.broadcast_to(self.strays, during.shape)[during]
        across = self.acceleration_nees[during] if len(self.acceleration_nees) else NO_VALUES
        return Flight(t, distance, range_, sigma, nees, velocity_nees, self.manoeuvre, strays, across)


NOT_FLOWN: Final = Flight(NO_VALUES, NO_VALUES, NO_VALUES, NO_VALUES, NO_VALUES)


def fly(case: Case, seed: int, settings: Sequence[str] = ()) -> Flight:
    """Fly one encounter through its own pipeline; `settings` override the case's.

    It is NOT_FLOWN if a recorded flight allows none.
    """
    encounter = encounter_of(case, seed)
    if encounter is None:
        return NOT_FLOWN
    off = mount_off(case.departure.mount_off_deg, seed)
    config = load_config(None, (*known(encounter, off), *case.settings, *settings))
    return judged(estimated(Pipeline(config), encounter.datagrams()), encounter.truth, encounter.manoeuvre)


def encounter_of(case: Case, seed: int) -> Encounter | None:
    """The encounter `seed` of a case; None, where a recorded flight allows none."""
    if case.log:
        return recorded.encounter(Path(case.log), case.family, seed)
    return make_encounter(
        case.family,
        seed,
        DURATION_S,
        case.sees,
        mount=case.mount,
        departure=case.departure,
    )


def mount_off(degrees: float, seed: int) -> Vec3:
    """Return the error of the configured mount in degrees: about one axis, with the sign and axis by seed."""
    wrong = [0.0, 0.0, 0.0]
    wrong[seed % 3] = degrees if seed % 2 else -degrees
    return wrong[0], wrong[1], wrong[2]


def known(encounter: Encounter, off: Vec3 = (0.0, 0.0, 0.0)) -> tuple[str, ...]:
    """Return the known settings of an encounter: leader, lens, and mount.

    `off` is the error of the mount's angles in degrees.
    """
    camera = encounter.scenario.camera
    gimbal = () if camera.gimbal is None else (f"camera.gimbal={camera.gimbal.component}",)
    return (
        f"estimator.leader.size_prior_m={encounter.size_prior}",
        f"estimator.leader.leader_class={encounter.leader_class}",
        *gimbal,
        f"camera.f_px={camera.f_px}",
        f"camera.distortion_model={camera.distortion_model}",
        f"camera.distortion={list(camera.distortion)}",
        f"camera.mount_rpy_deg={[a + b for a, b in zip(camera.mount_rpy_deg, off, strict=True)]}",
        f"camera.mount_offset_m={list(camera.mount_offset)}",
    )


def received(encounter: Encounter, settings: Sequence[str] = ()) -> list[Message]:
    """Return the messages that our computer receives, in order."""
    pipeline = Pipeline(load_config(None, (*known(encounter), *settings)))
    return [message for datagram in encounter.datagrams() for message in pipeline.decode(datagram)]


def estimated(
    pipeline: Pipeline,
    datagrams: Iterable[Datagram],
    change: Callable[[list[Message]], list[Message]] = lambda messages: messages,
) -> Array:
    """Return the leader's estimates (n, 49), in order; NaN where not valid.

    The columns are the time of the encounter (s), r_FL_n and v_FL_n (6), their covariance (36), a_lat and a_long
    (2), and their covariance (4). `change` modifies the messages of one datagram.
    """
    outputs = (output for datagram in datagrams for output in pipeline.advance(change(pipeline.decode(datagram))))
    rows = [
        ((output.t_ns - BOOT_NS) * 1e-9, *_motion(output))
        for output in outputs
        if isinstance(output, Estimate) and output.name == "leader" and output.is_primary
    ]
    return np.array(rows, dtype=float).reshape(-1, 49)


def judged(estimates: Array, truth: EncounterTruth, manoeuvre: float | None = None) -> Flight:
    """Compare estimates (n, 49), as in `estimated`, with the truth at their times.

    With their first 43 columns the accelerations are not compared.
    """
    later = estimates[(estimates[:, 0] >= SETTLING_TIME_S) & (estimates[:, 0] <= truth.t[-1])]
    t, mean, P = later[:, 0], later[:, 1:7], later[:, 7:43].reshape(-1, 6, 6)
    r_FL_n, v_FL_n = (at(truth.t, values, t) for values in (truth.r_FL_n, truth.v_FL_n))
    range_ = np.linalg.norm(mean[:, :3], axis=1)
    direction = mean[:, :3] / range_[:, None]
    off = mean - np.hstack([r_FL_n, v_FL_n])
    nees, strays = _nees(off[:, :3], P[:, :3, :3]), np.zeros(len(t), dtype=bool)
    if truth.other is not None:
        of_other = _nees(mean[:, :3] - at(truth.t, truth.other.r - truth.follower.r, t), P[:, :3, :3])
        strays = (nees > MIN_STRAY_NEES) & (of_other < nees)
    return Flight(
        t=t,
        distance=np.linalg.norm(r_FL_n, axis=1),
        range_=range_,
        sigma=np.sqrt(np.einsum("ni,nij,nj->n", direction, P[:, :3, :3], direction)),
        nees=nees,
        velocity_nees=_nees(off[:, 3:], P[:, 3:, 3:]),
        manoeuvre=math.nan if manoeuvre is None else manoeuvre,
        strays=strays,
        acceleration_nees=_across(later, truth) if later.shape[1] > 43 else NO_VALUES,
    )


def _across(estimates: Array, truth: EncounterTruth) -> Array:
    """Return the NEES (n,) of a_lat and a_long, NaN if invalid or if the leader has no course."""
    t, v, a = estimates[:, 0], truth.leader.v, truth.leader.a
    true = np.array([path_accelerations(*pair) for pair in zip(v.tolist(), a.tolist(), strict=True)])
    found = _nees(estimates[:, 43:45] - at(truth.t, true, t), estimates[:, 45:49].reshape(-1, 2, 2))
    found[np.interp(t, truth.t, np.hypot(v[:, 0], v[:, 1])) < MIN_COURSE_SPEED_M_S] = np.nan
    return found


def _nees(off: Array, P: Array) -> Array:
    """Return the NEES of errors (n, k) with covariances (n, k, k); NaN where they are (n,)."""
    found, valid = np.full(len(off), np.nan), np.isfinite(off).all(axis=1)
    found[valid] = normalised_squared(off[valid], P[valid])
    return found


def _motion(estimate: Estimate) -> tuple[float, ...]:
    """Return mean (6), covariance (36), and those (2), (4) of a_lat and a_long; NaN if invalid."""
    if not estimate.valid or estimate.mean is None or estimate.covariance is None:
        return (float("nan"),) * 48
    first, across = slice(0, 6), slice(A_LAT, A_LONG + 1)
    return tuple(
        number
        for part in (first, across)
        for number in (*estimate.mean[part], *(x for row in estimate.covariance[part] for x in row[part]))
    )
