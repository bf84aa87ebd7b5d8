"""What the wing-line filter assumes of how leaders fly: settings for two kinds of aircraft."""

from typing import Final, NamedTuple

import numpy as np

from onboard.geometry.rotations import Array
from onboard.models import leader_flight as flight
from onboard.models.leader_flight import A_ALONG, BANK_ERROR, HEADING, Habits
from onboard.models.relative_motion import A_LAT, A_LONG, SIZE, R, V


class Manner(NamedTuple):
    """Standard deviations. Walks are per square root of a second; what has a time dies out in it.

    The leader is in one of several modes: it keeps its speed, it changes it (`push`), or, if it can, it turns its
    nose aside. It stays in them for `keeps_for`, `pushes_for` and `turns_for` seconds on average (an interacting
    multiple model).
    """

    position_walk: float = 0.001  # m
    velocity_walk: float = 0.01  # m/s
    size_walk: float = 1e-5  # fraction of the size
    a_lat_walk: float = 0.28  # m/s^2
    a_long_walk: float = 0.03  # m/s^2
    keep: float = 0.005  # m/s^2, of a_along while it keeps its speed
    keep_time: float = 0.5  # s
    push: float = 1.0  # m/s^2, of a_along while it changes it
    push_time: float = 2.0  # s
    keeps_for: float = 120.0  # s
    pushes_for: float = 3.0  # s
    nose_walk: float = 0.0  # rad, of the heading while it turns its nose aside; 0: it never does
    turns_for: float = 3.0  # s
    heading: float = np.radians(2.0)  # rad, of the nose about the course
    heading_time: float = 3.0  # s
    bank: float = np.radians(1.5)  # rad, of the bank about that of a coordinated turn
    bank_time: float = 1.0  # s
    hover_speed: float = 1.0  # m/s, below which a course means little
    initial_velocity: float = 3.7  # m/s
    initial_acceleration: float = 3.0  # m/s^2
    initial_heading: float = np.radians(20.0)  # rad, about our own course
    gate_probability: float = 0.999


FIXED_WING: Final = Manner()

# Changes its speed as freely as its course, stops, and may point its nose where it likes.
MULTIROTOR: Final = Manner(
    velocity_walk=0.3,
    a_long_walk=0.3,
    keep=0.1,
    push=2.5,
    keeps_for=10.0,
    heading=np.radians(1.0),
    bank=np.radians(5.0),
    initial_heading=np.radians(10.0),
)

MANNERS: Final = {"fixed_wing": FIXED_WING, "multirotor": MULTIROTOR}


class Extras(NamedTuple):
    """What else is estimated, and how uncertain it is at first (0: not estimated): the camera's delay (s), and
    the error of our own attitude together with the mount's (rad, about the camera's axes)."""

    delay: float = 0.0
    bias: tuple[float, float, float] = (0.0, 0.0, 0.0)
    bias_time: float = 60.0  # s in which the attitude's error changes

    @property
    def states(self) -> int:
        """How many states there are."""
        return flight.BASE + (self.delay > 0) + 3 * self.biased

    @property
    def biased(self) -> bool:
        """Whether the attitude's error is estimated."""
        return min(self.bias) > 0


DELAY_WALK: Final = 0.001  # s per square root of a second: clocks and exposures drift


def habits(manner: Manner, extras: Extras) -> tuple[Habits, ...]:
    """Of a leader that keeps its speed, of one that changes it, and of one that turns its nose."""
    keeping = Habits(manner.hover_speed, manner.keep_time, manner.heading_time, manner.bank_time, extras.bias_time)
    pushing = keeping._replace(along_time=manner.push_time)
    return (keeping, pushing, keeping) if manner.nose_walk else (keeping, pushing)


def process_noise(manner: Manner, extras: Extras, size: float, dt: float) -> tuple[Array, ...]:
    """Q (n, n) of a step of `dt` seconds, in each mode."""
    q = np.zeros(extras.states)
    q[R], q[V] = manner.position_walk**2 * dt, manner.velocity_walk**2 * dt
    q[SIZE] = (manner.size_walk * size) ** 2 * dt
    q[A_LAT], q[A_LONG] = manner.a_lat_walk**2 * dt, manner.a_long_walk**2 * dt
    q[HEADING] = _kept(manner.heading, manner.heading_time, dt)
    q[BANK_ERROR] = _kept(manner.bank, manner.bank_time, dt)
    if extras.delay > 0:
        q[flight.BASE] = DELAY_WALK**2 * dt
    if extras.biased:
        q[-3:] = [_kept(sigma, extras.bias_time, dt) for sigma in extras.bias]
    keeping, pushing = np.diag(q), np.diag(q)
    keeping[A_ALONG, A_ALONG] = _kept(manner.keep, manner.keep_time, dt)
    pushing[A_ALONG, A_ALONG] = _kept(manner.push, manner.push_time, dt)
    if not manner.nose_walk:
        return keeping, pushing
    turning = keeping.copy()
    turning[HEADING, HEADING] += manner.nose_walk**2 * dt
    return keeping, pushing, turning


def passing(manner: Manner, dt: float) -> Array:
    """Probabilities (r, r) of passing from one mode (row) to another within `dt` seconds."""
    times = (manner.keeps_for, manner.pushes_for, manner.turns_for)[: 3 if manner.nose_walk else 2]
    leave = [-float(np.expm1(-dt / time)) for time in times]
    passing = np.diag([1.0 - p for p in leave])
    passing[0, 1:] = leave[0] / (len(times) - 1)
    passing[1:, 0] = leave[1:]  # a manoeuvre ends before another begins
    return passing


def _kept(sigma: float, time: float, dt: float) -> float:
    """Variance that a Gauss-Markov process gains in `dt` seconds."""
    return -(sigma**2) * float(np.expm1(-2.0 * dt / time))


def overridden(manner: Manner, overrides: dict[str, float]) -> Manner:
    """A manner with single settings replaced.

    Raises ValueError for a name that is none of them, or a value that cannot be.
    """
    for name, value in overrides.items():
        if name not in Manner._fields:
            raise ValueError(f"unknown key process_noise.{name}; known: {', '.join(Manner._fields)}")
        if not value > 0:
            raise ValueError(f"process_noise.{name} must be positive, not {value}")
        if name == "gate_probability" and not value < 1:
            raise ValueError(f"process_noise.{name} must be below 1, not {value}")
        manner = manner._replace(**{name: value})
    return manner
