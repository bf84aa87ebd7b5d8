"""What the leader's filters assume of how a leader flies and of noise, and how `process_noise` overrides it.

Plain numbers: reading a configuration imports neither NumPy nor Numba. The functions that make matrices of these
settings stand in `wing_line_noise`.
"""

import math
from collections.abc import Mapping
from typing import Any, Final, NamedTuple

PARTICLES: Final = 900  # of the cloud of noses
SECTION: Final = "estimator.leader.process_noise"
RENAMED: Final = {
    "position_walk": "position_random_walk",
    "velocity_walk": "velocity_random_walk",
    "size_walk": "size_random_walk",
    "a_lat_walk": "a_lat_random_walk",
    "a_long_walk": "a_long_random_walk",
    "nose_walk": "nose_random_walk",
    "keep": "steady",
    "keep_time": "steady_time",
    "keeps_for": "steady_for",
    "push": "accelerating",
    "push_time": "accelerating_time",
    "pushes_for": "accelerating_for",
}


class NoseModel(NamedTuple):
    """What the cloud of noses assumes: how a leader of unknown nose flies, and our own errors.

    Values are standard deviations, unless they are named otherwise. A `_random_walk` is a process noise density:
    the state's variance grows by its square each second. A state with a `_time` is a Gauss-Markov process with
    that correlation time. A `_for` is a mean duration. Speeds, accelerations and banks are those of a leader at
    the largest possible range, and proportionally less for nearer ones.

    The reasons: a copter leaned by 0.12 / s of its airspeed at 6 m/s and 0.22 / s at 12 m/s
    (../shared/data/formation-copter), and others differ; winds of 3 m/s along an axis are a gentle breeze.
    The nose wobbles by 2 degrees in the reference flight of Oh & Johnson. Errors of our velocity last some
    seconds (a receiver's noise, filtered) to a minute (multipath): 20 s. `temper` is below 1 because errors of
    images and of flight are correlated from one image to the next. It, `stretch`, `bank`, the turning and the
    doubt were chosen on simulated encounters: no measurement of real leaders stands behind them."""

    size: float  # m, the value itself
    size_sigma: float  # m
    misalignment: tuple[float, float, float]  # rad, of our attitude, in n
    misalignment_time: float  # s
    own_velocity: float  # m/s, of our velocity
    own_velocity_time: float = 20.0  # s
    crab: float = 0.0  # rad, of the nose about the course, of a fixed wing; 0: the nose may point anywhere
    heading: float = math.radians(5.0)  # rad, of the nose about our own course, of one that flies along with us
    on_course: float = 0.3  # the prior probability that it does, if we fly
    follows: float = 0.7  # the probability that a leader that flies fast has its nose about its course
    nose_about_course: float = math.radians(5.0)  # rad, of such a nose
    air: tuple[float, float] = (0.0, 0.0)  # m/s, velocity to north and east of the air that a course is through
    air_sigma: float = 0.0  # m/s, on each axis
    particles: int = PARTICLES
    speed: float = 8.0  # m/s, relative to us, at first
    acceleration: float = 1.5  # m/s^2, at first
    acceleration_time: float = 4.0  # s
    velocity_random_walk: float = 0.03  # m/s / sqrt(s)
    acceleration_random_walk: tuple[float, float] = (0.6, 3.0)  # m/s^2 / sqrt(s): steady, accelerating
    accelerating: float = 0.25  # the probability that a leader accelerates at first
    steady_for: float = 10.0  # s
    accelerates_for: float = 3.0  # s
    hovering: float = 0.0  # the probability that a multirotor hovers at first
    flies_for: float = math.inf  # s, of a slow one until it hovers
    hovers_for: float = 30.0  # s
    hover_speed: float = 0.2  # m/s, of one that hovers, about its place
    hover_time: float = 1.5  # s
    hover_acceleration: float = 0.16  # m/s^2
    hover_acceleration_time: float = 0.05  # s
    intensity: tuple[float, float, float] = (0.0, 0.0, 0.0)  # of the logarithm: manoeuvres, bank, wobble
    intensity_time: float = 200.0  # s, over which a leader changes them
    fewest: int = 1_000_000  # particles: as many as the noses and ranges in question need, but so many at least
    turning: float = 0.15  # the probability that it turns its nose at first, beside the turn of its course
    still_for: float = 30.0  # s
    turns_for: float = 4.0  # s
    nose_rate: float = 0.2  # rad/s, of a nose that is turned
    nose_random_walk: float = math.radians(0.7)  # rad / sqrt(s)
    bank: float = math.radians(5.0)  # rad, about the bank of its thrust
    bank_time: float = 1.0  # s
    stretch: float = 0.02  # of the apparent length: a tip that is misplaced
    nose_wobble: float = math.radians(2.0)  # rad: it stretches a wing the more, the less is seen of it
    stretch_time: float = 3.0  # s, of both
    drag: float = 0.16  # 1/s, the value itself: deceleration by the air, per m/s of airspeed
    drag_sigma: float = 0.06  # 1/s
    wind: float = 3.0  # m/s, along each axis
    lean_random_walk: float = 0.05  # m/s^2 / sqrt(s)
    temper: float = 0.3  # the share of a logarithm of a likelihood ratio that is believed
    doubted_after: float = 10.0  # s, the mean time after which a particle takes another nose
    resample: float = 0.35  # of the particles: with fewer effective ones they are drawn anew
    gate: float = 25.0  # NIS above which no Gaussian expected an image


# What `belief` assumes beyond that: a multirotor may hover, by 0.2 m/s about its place, as recorded and simulated
# copters do; some leaders manoeuvre twice as hard as others, and images show which. With images at 30 Hz in place
# of 7, a smaller share of each is believed. Chosen on encounters with seeds 1 to 6.
HYPOTHESES: Final[dict[str, Any]] = {
    "hovering": 0.4,
    "flies_for": 20.0,
    "intensity": (0.8, 0.5, 0.5),
    "temper": 0.2,
    "fewest": 80,
}


class ManoeuvreModel(NamedTuple):
    """How the wing-line filter assumes that a leader flies.

    Values are standard deviations, unless they are named otherwise. A `_random_walk` is a process noise density:
    the state's variance grows by its square each second. A state with a `_time` is a Gauss-Markov process with
    that correlation time. A `_for` is the mean duration of a mode.

    The leader is in one of several modes (an interacting multiple model): its speed is steady, or it is
    accelerating along its track. A multirotor may also hover, and turn its nose to either side meanwhile. A
    turning nose and a leader that flies away both shorten the wing in the image; only the wing's middle
    (`Extras.middle`) distinguishes them. Without the middle there are no hovering modes.
    """

    position_random_walk: float = 0.001  # m / sqrt(s)
    velocity_random_walk: float = 0.003  # m/s / sqrt(s)
    size_random_walk: float = 1e-5  # fraction of the size / sqrt(s)
    a_lat_random_walk: float = 0.28  # m/s^2 / sqrt(s)
    a_long_random_walk: float = 0.03  # m/s^2 / sqrt(s)
    steady: float = 0.005  # m/s^2, of a_along while the speed is steady
    steady_time: float = 0.5  # s
    accelerating: float = 1.0  # m/s^2, of a_along while the leader accelerates
    accelerating_time: float = 2.0  # s
    steady_for: float = 120.0  # s
    accelerating_for: float = 3.0  # s
    flies_for: float = 20.0  # s, until it hovers
    hovers_for: float = 10.0  # s; 0: it cannot hover
    hover: float = 0.02  # m/s, of the velocity while it hovers; the error of our own velocity adds to it
    hover_time: float = 1.0  # s
    straight_for: float = 20.0  # s, until a hovering leader turns its nose
    turns_for: float = 3.0  # s
    nose_rate: float = 0.3  # rad/s, the rate itself, to either side
    nose_random_walk: float = 0.3  # rad / sqrt(s), of the heading while the nose turns
    heading: float = math.radians(2.0)  # rad, of the nose about the course
    heading_time: float = 3.0  # s
    bank: float = math.radians(1.0)  # rad, of the bank about that of a coordinated turn
    bank_time: float = 1.0  # s
    hover_speed: float = 1.0  # m/s, the speed itself: below it a course means little
    initial_velocity: float = 3.7  # m/s
    initial_acceleration: float = 3.0  # m/s^2
    initial_heading: float = math.radians(20.0)  # rad, about our own course
    gate_probability: float = 0.999


FIXED_WING: Final = ManoeuvreModel(hovers_for=0.0)

# Changes its speed as freely as its course, stops, and may point its nose anywhere while it hovers.
MULTIROTOR: Final = ManoeuvreModel(
    velocity_random_walk=0.3,
    a_long_random_walk=0.3,
    steady=0.1,
    accelerating=1.5,
    steady_for=10.0,
    heading=math.radians(1.0),
    bank=math.radians(5.0),
    initial_heading=math.radians(10.0),
)

MANOEUVRE_MODELS: Final = {"fixed_wing": FIXED_WING, "multirotor": MULTIROTOR}


def settings_for(leader_class: str, overrides: Mapping[str, float]) -> ManoeuvreModel:
    """The settings for a leader of class "fixed_wing" or "multirotor", with single ones overridden.

    Raises ValueError, which names the key: a name that is no setting, or a value out of range.
    """
    settings = MANOEUVRE_MODELS[leader_class]
    known = settings._fields
    for name, value in overrides.items():
        key = f"{SECTION}.{name}"
        if RENAMED.get(name) in known:
            raise ValueError(f"{key} is now called {SECTION}.{RENAMED[name]}")
        if name not in known:
            raise ValueError(f"unknown key {key}; known: {', '.join(known)}")
        if not 0 < value < math.inf:
            raise ValueError(f"{key} must be positive and finite, not {value}")
        if name == "gate_probability" and not value < 1:
            raise ValueError(f"{key} must be below 1, not {value}")
    return settings._replace(**overrides)
