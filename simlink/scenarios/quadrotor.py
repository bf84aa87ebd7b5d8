"""The follower as a quadrotor: its body, its rotors, the wind and its faults."""

from typing import Annotated, Literal

import msgspec

from onboard.messages import NotNegative, Positive, Record, Vec3
from simlink.scenarios.profiles import GaussMarkov, Interval, Probability


class QuadrotorFault(Record, frozen=True, kw_only=True):
    """A fault of the quadrotor from the time `at` (s) on."""

    at: NotNegative = 10.0
    motor: Annotated[int, msgspec.Meta(ge=0, le=4)] = 0  # 1 to 4; 0: none
    motor_loss: Probability = 0.0  # share of its thrust that this motor loses
    inputs: Positive = 1.0  # factor on all thrusts
    mass: Positive = 1.0  # factor
    inertia: Positive = 1.0  # factor on the moments of inertia


class Gust(Record, frozen=True, kw_only=True):
    """A gust as an acceleration in n (m/s^2), with horizontal fluctuations about it."""

    when: Interval | None = None
    acceleration: Vec3 = (0.0, 0.0, 0.0)
    wobble: GaussMarkov = GaussMarkov(time=0.5)


class Battery(Record, frozen=True, kw_only=True):
    """A battery whose voltage falls linearly; thrust falls with its square."""

    minutes: NotNegative = 0.0  # of flight from full to empty; 0: it stays full
    full: Positive = 12.6  # V
    empty: Positive = 10.54  # V


class Quadrotor(Record, frozen=True, kw_only=True):
    """A rigid body under four rotors, by default as in Al-Shabi, Gadsden and Wilkerson.

    Each rotor has its position forward and right of the centre (m), and the sense (+1, -1) of its drag torque
    about b's z axis. `mass` is in kg, `thrust_max` of one rotor in N. `path` is a figure eight or the follower's
    slot.
    """

    path: Literal["figure_eight", "slot"] = "figure_eight"
    mass: Positive = 0.468
    inertia: tuple[Positive, Positive, Positive] = (4.856e-3, 4.856e-3, 8.801e-3)  # kg m^2
    rotors: tuple[Vec3, Vec3, Vec3, Vec3] = (
        (0.225, 0.0, 1.0),
        (0.0, 0.225, -1.0),
        (-0.225, 0.0, 1.0),
        (0.0, -0.225, -1.0),
    )
    thrust_max: Positive = 3.0
    torque_per_thrust: Positive = 0.03826  # m
    motor_time: Annotated[float, msgspec.Meta(ge=0.005)] = 0.02  # s, lag of a rotor's speed
    drag: NotNegative = 0.1  # 1/s, along b's x and y
    wind: tuple[float, float] = (0.0, 0.0)  # m/s towards north and east, steady; it acts through `drag`
    turbulence: GaussMarkov = GaussMarkov(sigma=0.1, time=1.0)  # m/s^2 per axis
    gust: Gust = Gust()
    fault: QuadrotorFault = QuadrotorFault()
    battery: Battery = Battery()
