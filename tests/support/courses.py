"""Random courses of a leader for flights of real autopilots; one seed is one plan."""

import math
from collections.abc import Iterator, Sequence
from enum import StrEnum
from typing import Final, NamedTuple

import numpy as np

COMMAND_PERIOD_S: Final = 0.1
MIN_SPEED, MAX_SPEED = 3.0, 8.0  # m/s
ACCELERATION: Final = 1.5  # m/s^2, of the commanded speed
START_DISTANCE_M: Final = 33.0  # a little farther than the slot
MEETING_DISTANCE_M: Final = 65.0
OUTAGE_S: Final = {"killed": 4.0, "blind": 6.0}
MEETING_WIDTH_M: Final = 20.0  # two thirds of the slot's distance, which a first course leaves or not
SIDES: Final = {"N": 0.0, "E": 0.5 * math.pi, "S": math.pi, "W": -0.5 * math.pi}  # of the leader, rad


class Kind(StrEnum):
    """Kinds of courses."""

    STRAIGHT = "straight"
    CORNER = "corner"
    REVERSAL = "reversal"
    SLOW_S = "slow S, stop"
    EIGHT = "eight"
    CLIMB = "climb"
    HEAD_ON = "head-on"
    CIRCLE = "circle"
    KILLED = "daemon killed"
    BLIND = "images gone"


class Leg(NamedTuple):
    """One leg of a course: speed (m/s), turn rate (rad/s), climb (m/s), and an initial turn (rad)."""

    seconds: float
    speed: float
    rate: float = 0.0
    climb: float = 0.0
    turn: float = 0.0


class Command(NamedTuple):
    """The commanded velocity (m/s, NED) and heading (rad) of the leader."""

    v_n: tuple[float, float, float]
    heading: float


class Course(NamedTuple):
    """A course, and how the follower begins: on that side of the leader, at that distance (m)."""

    kind: Kind
    side: str
    heading: float
    speed: float
    legs: tuple[Leg, ...]
    distance_m: float = START_DISTANCE_M
    outage: tuple[float, float] | None = None  # of the daemon or the images, s since the beginning

    @property
    def comes_at_follower(self) -> bool:
        """Whether the leader turns back, or passes close to the follower's start on its first course."""
        off = math.remainder(self.heading - SIDES[self.side], 2.0 * math.pi)
        is_near = math.cos(off) > 0.0 and self.distance_m * abs(math.sin(off)) < MEETING_WIDTH_M
        return self.kind is Kind.REVERSAL or is_near

    def commands(self) -> Iterator[Command]:
        """All commands, one each COMMAND_PERIOD_S."""
        heading, speed = self.heading, 0.0
        for leg in self.legs:
            heading += leg.turn
            for _ in range(round(leg.seconds / COMMAND_PERIOD_S)):
                step = ACCELERATION * COMMAND_PERIOD_S
                speed += min(max(leg.speed - speed, -step), step)
                heading += leg.rate * COMMAND_PERIOD_S
                yield Command((speed * math.cos(heading), speed * math.sin(heading), -leg.climb), heading)

    def __str__(self) -> str:
        return (
            f"{self.kind} at {self.speed:.1f} m/s, course {math.degrees(self.heading) % 360:.0f}, from {self.side}"
        )


def draw_plan(seed: int) -> list[Course]:
    """One course of each kind, in a random order, begun from all sides."""
    rng = np.random.default_rng(seed)
    sides = [*SIDES, *SIDES, *rng.permutation(list(SIDES))[:2].tolist()]
    kinds: Sequence[Kind] = [list(Kind)[i] for i in rng.permutation(len(Kind))]
    return [draw(kind, str(side), rng) for kind, side in zip(kinds, rng.permutation(sides), strict=True)]


def draw(kind: Kind, side: str, rng: np.random.Generator) -> Course:
    """A course of a kind, with the follower on that side of the leader."""
    speed = float(rng.uniform(MIN_SPEED, MAX_SPEED))
    heading = float(rng.uniform(-math.pi, math.pi))
    sign = float(rng.choice([-1.0, 1.0]))
    course = Course(kind, side, heading, speed, _legs(kind, speed, sign))
    match kind:
        case Kind.HEAD_ON:
            return course._replace(heading=SIDES[side], distance_m=MEETING_DISTANCE_M)
        case Kind.KILLED:
            return course._replace(outage=(19.0, 19.0 + OUTAGE_S["killed"]))
        case Kind.BLIND:
            return course._replace(outage=(19.0, 19.0 + OUTAGE_S["blind"]))
    return course


def _legs(kind: Kind, speed: float, sign: float) -> tuple[Leg, ...]:
    """The legs of a course at a speed (m/s); `sign` 1 turns right at first, -1 left."""
    slow, loop_s = 0.5 * speed, 2.0 * math.pi / 0.25
    match kind:
        case Kind.STRAIGHT:
            return (Leg(50.0, speed),)
        case Kind.CORNER:
            return Leg(20.0, speed), Leg(30.0, speed, turn=sign * math.pi / 2)
        case Kind.REVERSAL:
            return Leg(18.0, speed), Leg(speed / ACCELERATION + 1.0, 0.0), Leg(35.0, speed, turn=math.pi)
        case Kind.SLOW_S:
            stop = Leg(slow / ACCELERATION + 8.0, 0.0)
            s = Leg(9.0, slow, 0.15 * sign), Leg(9.0, slow, -0.15 * sign)
            return Leg(8.0, slow), *s, stop, *s, Leg(6.0, slow)
        case Kind.EIGHT:
            return Leg(6.0, speed), Leg(loop_s, speed, 0.25 * sign), Leg(loop_s, speed, -0.25 * sign)
        case Kind.CLIMB:
            return Leg(12.0, speed), Leg(15.0, speed, climb=1.0), Leg(23.0, speed)
        case Kind.HEAD_ON:
            return (Leg(55.0, speed),)
        case Kind.CIRCLE:
            return Leg(10.0, speed), Leg(45.0, speed, 0.2 * sign)
        case Kind.KILLED | Kind.BLIND:
            return Leg(16.0, speed), Leg(12.0, speed, 0.12 * sign), Leg(32.0, speed)
