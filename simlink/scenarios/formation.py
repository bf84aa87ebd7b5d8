"""The two aircraft of a formation flight; the defaults are those of Oh & Johnson."""

from collections.abc import Mapping
from typing import Final, Literal

from onboard.messages import NotNegative, Positive, Record, Vec3
from simlink.scenarios.profiles import GaussMarkov, Pulse, Wave
from simlink.scenarios.quadrotor import Quadrotor

# Points of the fuselage that a detector may find: wingspans, body FRD.
NAMED_POINTS: Final[Mapping[str, Vec3]] = {"nose": (0.36, 0.0, 0.0), "tail": (-0.40, 0.0, -0.03)}


class Leader(Record, frozen=True, kw_only=True):
    """The aircraft ahead, a point mass with a size and random errors of bank and heading.

    `a_lat` is positive to the right, `a_long` positive up and normal to the velocity (m/s^2, Oh & Johnson). `size`
    is the nominal distance of the two wing points (m); a run draws size (1 + size_sigma_percent / 100 N(0, 1)).
    `speed` (m/s) is along the nose, so a leader that backs up has a negative one. `height` is above the origin
    (m).
    """

    size: Positive = 2.667
    size_sigma_percent: NotNegative = 2.0
    speed: NotNegative = 21.336
    speed_pulses: tuple[Pulse, ...] = ()
    a_lat: Wave = Wave(mean=2.4384)
    a_long: Wave = Wave()
    a_lat_pulses: tuple[Pulse, ...] = ()  # m/s^2, added to a_lat
    course_deg: float = 0.0
    climb_deg: float = 0.0
    climb_pulses: tuple[Pulse, ...] = ()  # m/s upwards, added to the vertical velocity
    yaw_pulses_deg: tuple[Pulse, ...] = ()  # heading minus course: a multirotor need not point along its course
    height: float = 100.0
    bank_wobble_deg: GaussMarkov = GaussMarkov(sigma=2.0, time=1.0)
    heading_wobble_deg: GaussMarkov = GaussMarkov(sigma=2.0, time=3.0)


class Follower(Record, frozen=True, kw_only=True):
    """Our vehicle, which keeps a slot in the leader's path axes.

    The axes point forward along the course, right and down (m). The slot moves sinusoidally about its place with
    amplitudes `wander` (m) and periods `wander_period` (s).
    """

    slot: Vec3 = (-27.432, 3.048, 1.524)
    wander: Vec3 = (0.9144, 0.9144, 0.3048)
    wander_period: tuple[Positive, Positive, Positive] = (11.0, 7.0, 5.0)
    slot_pulses: tuple[Pulse, ...] = ()  # added to the forward component
    attitude: Literal["coordinated", "hover"] = "coordinated"  # "hover": nose along the leader's course
    position_gain: Positive = 1.0  # 1/s^2
    velocity_gain: Positive = 2.0  # 1/s


class Follow(Record, frozen=True, kw_only=True):
    """Our vehicle flown by its autopilot on setpoints (`simlink.world.setpoint_mode`)."""

    engage: NotNegative = 10.0  # s, the time from which the pilot requests the mode
    offset: Vec3 = (
        -25.0,
        0.0,
        2.0,
    )  # m forward, right, down of the leader: the slot in the daemon's configuration
    timeout: NotNegative = 1.0  # s after which a setpoint expires: GUID_TIMEOUT, COM_OF_LOSS_T
    craft: Quadrotor = Quadrotor()  # the body that tilts
