"""What the wing-line filter assumes of how leaders fly: settings for two kinds of aircraft."""

import math
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.models import leader_flight as flight
from onboard.models.leader_flight import A_ALONG, BANK_ERROR, HEADING, Habits
from onboard.models.relative_motion import A_LAT, A_LONG, SIZE, R, V


class Manner(NamedTuple):
    """Standard deviations. Walks are per square root of a second; what has a time dies out in it.

    The leader is in one of several modes (an interacting multiple model): it keeps its speed, for `keeps_for`
    seconds on average, or it changes it (`push`), for `pushes_for`. A multirotor may also hover, and while it does
    turn its nose to either side. That is told from flying away only by the wing's middle (`Extras.middle`),
    without which a wing that grows shorter is further away: these modes are then left out.
    """

    position_walk: float = 0.001  # m
    velocity_walk: float = 0.003  # m/s
    size_walk: float = 1e-5  # fraction of the size
    a_lat_walk: float = 0.28  # m/s^2
    a_long_walk: float = 0.03  # m/s^2
    keep: float = 0.005  # m/s^2, of a_along while it keeps its speed
    keep_time: float = 0.5  # s
    push: float = 1.0  # m/s^2, of a_along while it changes it
    push_time: float = 2.0  # s
    keeps_for: float = 120.0  # s
    pushes_for: float = 3.0  # s
    flies_for: float = 20.0  # s, until it hovers
    hovers_for: float = 10.0  # s; 0: it cannot hover
    hover: float = 0.02  # m/s, of what hovers; and our own velocity's error, as which it looks
    hover_time: float = 1.0  # s
    straight_for: float = 20.0  # s, until one that hovers turns its nose
    turns_for: float = 3.0  # s
    nose_rate: float = 0.3  # rad/s, of a nose that turns to either side
    nose_walk: float = 0.3  # rad, of its heading
    heading: float = np.radians(2.0)  # rad, of the nose about the course
    heading_time: float = 3.0  # s
    bank: float = np.radians(1.0)  # rad, of the bank about that of a coordinated turn
    bank_time: float = 1.0  # s
    hover_speed: float = 1.0  # m/s, below which a course means little
    initial_velocity: float = 3.7  # m/s
    initial_acceleration: float = 3.0  # m/s^2
    initial_heading: float = np.radians(20.0)  # rad, about our own course
    gate_probability: float = 0.999


FIXED_WING: Final = Manner(hovers_for=0.0)

# Changes its speed as freely as its course, stops, and may point its nose where it likes while it hovers.
MULTIROTOR: Final = Manner(
    velocity_walk=0.3,
    a_long_walk=0.3,
    keep=0.1,
    push=1.5,
    keeps_for=10.0,
    heading=np.radians(1.0),
    bank=np.radians(5.0),
    initial_heading=np.radians(10.0),
)

MANNERS: Final = {"fixed_wing": FIXED_WING, "multirotor": MULTIROTOR}


class Extras(NamedTuple):
    """What else is estimated, and how uncertain it is at first (0: not estimated): the camera's delay (s), and
    the error of our own attitude together with the mount's (rad, about the camera's axes). How wrong our own
    velocity may be (m/s), which is not estimated. Whether the wing's `middle` is measured (`wing_line`)."""

    delay: float = 0.0
    bias: tuple[float, float, float] = (0.0, 0.0, 0.0)
    bias_time: float = 60.0  # s in which the attitude's error changes
    own_velocity: float = 0.0
    middle: bool = False

    @property
    def states(self) -> int:
        """How many states there are."""
        return flight.BASE + (self.delay > 0) + 3 * self.biased

    @property
    def biased(self) -> bool:
        """Whether the attitude's error is estimated."""
        return min(self.bias) > 0


STILL_WALK: Final = 0.01  # m/s^2 per square root of a second, of the accelerations of what hovers
NEARBY: Final = 0.05  # of an exponential's argument, for which eight terms of its series do
DELAY_WALK: Final = 0.001  # s per square root of a second: clocks and exposures drift


def hovers(manner: Manner, extras: Extras) -> bool:
    """Whether the leader may hover, and it could be seen that its nose turns."""
    return manner.hovers_for > 0 and extras.middle


def habits(manner: Manner, extras: Extras) -> tuple[Habits, ...]:
    """Of a leader that keeps its speed, of one that changes it; of one that hovers, its nose still, turning right
    and turning left."""
    keeping = Habits(manner.hover_speed, manner.keep_time, manner.heading_time, manner.bank_time, extras.bias_time)
    pushing = keeping._replace(along_time=manner.push_time)
    if not hovers(manner, extras):
        return keeping, pushing
    still = keeping._replace(hover_time=manner.hover_time)
    right, left = (still._replace(nose_rate=rate) for rate in (manner.nose_rate, -manner.nose_rate))
    return keeping, pushing, still, right, left


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
    if not hovers(manner, extras):
        return keeping, pushing
    still = keeping.copy()
    for at in range(V.start, V.stop):
        still[at, at] = _kept(float(np.hypot(manner.hover, extras.own_velocity)), manner.hover_time, dt)
    still[A_LAT, A_LAT] = still[A_LONG, A_LONG] = STILL_WALK**2 * dt
    turning = still.copy()
    turning[HEADING, HEADING] += manner.nose_walk**2 * dt
    return keeping, pushing, still, turning, turning


def passing(manner: Manner, extras: Extras, dt: float) -> Array:
    """Probabilities (r, r) of passing from one mode (row) to another within `dt` seconds. What hovers flies on as
    often with a change of speed as without; to turn its nose it must hover."""
    push, keep = 1.0 / manner.keeps_for, 1.0 / manner.pushes_for
    rates = np.array([[0.0, push], [keep, 0.0]])
    if hovers(manner, extras):
        stop, go = 1.0 / manner.flies_for, 1.0 / manner.hovers_for
        turn, end = 0.5 / manner.straight_for, 1.0 / manner.turns_for
        rates = np.array(
            [
                [0.0, push, stop, 0.0, 0.0],
                [keep, 0.0, stop, 0.0, 0.0],
                [0.5 * go, 0.5 * go, 0.0, turn, turn],
                [0.0, go, end, 0.0, 0.0],
                [0.0, go, end, 0.0, 0.0],
            ]
        )
    return _exponential((rates - np.diag(rates.sum(axis=1))) * dt)


def _exponential(x: Array) -> Array:
    """exp(x) of a small matrix (r, r), by its series and squaring. Time steps come in all lengths, so this is done
    in flight, and SciPy's takes longer than the filter's step."""
    halvings = max(0, math.ceil(math.log2(max(float(np.abs(x).max()), 1e-9) / NEARBY)))
    x = x / 2.0**halvings
    one = np.eye(len(x))
    result = one
    for k in range(8, 0, -1):  # the ninth term is below 1e-15
        result = one + x @ result / k
    for _ in range(halvings):
        result = result @ result
    return result


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
