"""The flights of the study: scenarios of simlink, the filters' prior knowledge, and the methods."""

from typing import Final, NamedTuple

import numpy as np

from simlink.scenarios.scenario import Scenario, load_scenario, rotate_slot
from studies.relative_motion.formation import ASSUMED_SIZE_M, Lateness, Method, Setting
from studies.relative_motion.methods import AS_PRINTED, HONEST, PAPER_MENDED, R_ALONE, TUNED
from studies.relative_motion.shipped import DEFAULT, DELAY, ON_WING, Shipped

AnyMethod = Method | Shipped
COMPARED: Final[tuple[AnyMethod, ...]] = (PAPER_MENDED, HONEST, DEFAULT)
SHOWN: Final[tuple[AnyMethod, ...]] = (PAPER_MENDED, TUNED, HONEST, DEFAULT)  # in figures of one flight


class Variant(NamedTuple):
    """`angle_deg`: the slot turned about the leader, the camera turned back.

    `size_factor`: of the assumed size. `multirotor`: the filter knows that the leader is one.
    """

    name: str
    scenario: str
    label: str
    methods: tuple[AnyMethod, ...] = COMPARED
    angle_deg: float = 0.0
    size_factor: float = 1.0
    late: Lateness = Lateness()
    multirotor: bool = False


VARIANTS: Final = (
    Variant("a", "formation", "reference formation", (PAPER_MENDED, TUNED, HONEST, DEFAULT, R_ALONE)),
    Variant("b", "formation-s-turn", "S-turn, a_lat 8 sin(2πt/20 s) ft/s²"),
    Variant("c", "formation-speed-change", "speed ± 10 ft/s at 20–26 and 40–46 s"),
    Variant("d", "formation-drop-out", "no image at 30–35 s", (AS_PRINTED, PAPER_MENDED, TUNED, HONEST, DEFAULT)),
    Variant("e", "formation-wrong-blobs", "2 % wrong blobs", (PAPER_MENDED, TUNED, HONEST, DEFAULT)),
    Variant("f1.3", "formation", "size prior × 1.3", size_factor=1.3),
    Variant("f0.7", "formation", "size prior × 0.7", size_factor=0.7),
    Variant("g", "formation", "stamps 80 ms late, unknown", (*COMPARED, DELAY), late=Lateness(stamp=4)),
    Variant("g-known", "formation", "images 80 ms late, stamps right", late=Lateness(delivery=4)),
    Variant("h", "formation-nav-error", "our own state in error"),
    Variant("i", "formation-out-of-view", "leader leaves the view, passes behind"),
    Variant("k30", "formation", "seen from 30° aside", angle_deg=30.0),
    Variant("k45", "formation", "seen from 45° aside", angle_deg=45.0),
    Variant("k60", "formation", "seen from 60° aside", angle_deg=60.0),
    Variant("hover", "formation-hover", "multirotor stops, hovers, yaws", (*COMPARED, ON_WING), multirotor=True),
)
BY_NAME: Final = {variant.name: variant for variant in VARIANTS}
LABELS: Final = {method.name: method.label for variant in VARIANTS for method in variant.methods}


def scenario_of(variant: Variant) -> Scenario:
    """The scenario that is flown."""
    scenario = load_scenario(variant.scenario)
    return rotate_slot(scenario, variant.angle_deg) if variant.angle_deg else scenario


def course_deg(seed: int) -> float:
    """The initial course of a seed's flight, deg."""
    return float(np.random.default_rng([seed, 7]).uniform(0.0, 360.0))


def setting_of(variant: Variant, scenario: Scenario) -> Setting:
    """Return the filters' prior knowledge: camera, size with 2 %, own errors, and leader class."""
    size = ASSUMED_SIZE_M * variant.size_factor
    return Setting(
        scenario.camera, size, 0.02 * size, "multirotor" if variant.multirotor else "fixed_wing", scenario.nav
    )
