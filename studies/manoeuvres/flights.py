"""A leader leaves a hover and does one manoeuvre; a follower flies behind it on setpoints.

Each flight begins behind a leader at rest, engages after 10 s, and sees it leave after 25 s. Positions, speeds and
times are rounded from flights of real autopilots; none was chosen by its result here.
"""

import math
from collections.abc import Sequence
from typing import Final, Literal, NamedTuple

import numpy as np
from msgspec.structs import replace

from simlink.scenarios.profiles import Interval, Pulse
from simlink.scenarios.scenario import Scenario, load_scenario
from studies.closed_loop.flight import Flight, fly

Autopilot = Literal["ardupilot", "px4"]

SLOT: Final = (-30.0, 0.0, 2.0)  # m: behind, at 30 m
SPEEDS: Final[dict[Autopilot, float]] = {"ardupilot": 8.0, "px4": 5.0}  # m/s
ACCELERATION: Final = 1.5  # m/s^2, mean of a raised cosine
LEAVES, BEGINS = 25.0, 45.0  # s: the hover, and what it does
TURN_START_TIME_S: Final = 40.0  # of the circle in which it is blind or killed
SCORE_START_TIME_S: Final = 15.0  # 5 s after the mode is entered
ENDLESS_DURATION_S: Final = 1000.0
END_WINDOW_S: Final = 5.0
SLOT_DISTANCE_RATIOS: Final = (0.5, 1.5)  # of the slot's distance
MAX_SIDE_ANGLE_RAD: Final = math.radians(60.0)  # from the leader's side
NARROW_TURN_SPEED_M_S: Final = 3.0  # 12 m wide at 0.5 rad/s
SOUTH_HEADING_DEG: Final = 180.0


class Change(NamedTuple):
    """A change of speed from `start` (s) on, by a `part` of it, with ACCELERATION times `hard`, for `hold` s."""

    start: float
    part: float
    hard: float = 1.0
    hold: float = ENDLESS_DURATION_S

    def of(self, speed: float) -> Pulse:
        """The change of a leader of a speed, m/s."""
        change = self.part * speed
        rise = abs(change) / (self.hard * ACCELERATION)
        return Pulse(start=self.start, end=self.start + 2.0 * rise + self.hold, change=change, hold=self.hold)


class Turn(NamedTuple):
    """A circle at a `rate` (rad/s) from `start` on, for `hold` s, at a `speed` (m/s; None: the leader's)."""

    rate: float
    start: float = BEGINS
    hold: float = ENDLESS_DURATION_S
    speed: float | None = None

    def of(self, speed: float) -> Pulse:
        """The lateral acceleration of a leader of a speed, m/s."""
        change = self.rate * (speed if self.speed is None else self.speed)
        return Pulse(start=self.start, end=self.start + 2.0 + self.hold, change=change, hold=self.hold)


def turn_by(angle_deg: float, rate: float, start: float, speed: float | None = None) -> Turn:
    """A turn by an angle, which takes a second longer than at its rate alone."""
    angle = math.radians(angle_deg)
    return Turn(math.copysign(rate, angle), start, abs(angle) / rate - 1.0, speed)


class Manoeuvre(NamedTuple):
    """The manoeuvre of a leader after it has left the hover, and interruptions of camera and daemon."""

    name: str
    duration: float  # s, of the flight
    turns: tuple[Turn, ...] = ()
    changes: tuple[Change, ...] = ()
    slows: bool = False  # to NARROW_TURN_SPEED_M_S from BEGINS on
    flies_back: float = math.inf  # s, when it turns its nose in a hover and flies at us at that speed
    course_deg: float = SOUTH_HEADING_DEG  # on which it leaves; we begin behind it
    backs_up: bool = False
    blind: tuple[Interval, ...] = ()  # s, of the camera
    killed: tuple[float, float] = (math.inf, math.inf)  # s, from and to, of the daemon


class Result(NamedTuple):
    """The results of one flight."""

    least: float  # percent of the slot's distance
    greatest: float  # percent of the slot's distance
    off: float  # percent of the slot's distance, the median from the slot
    farthest_off: float  # percent of the slot's distance, the greatest from the slot
    seen: float  # percent of images with the leader inside
    valid: float  # percent of the time with a valid estimate
    aside: float  # degrees between the follower and its side of the leader, over the last seconds
    followed: bool  # whether it is followed, seen, near its slot and on its side over the last seconds
    advised: int = 0  # kinds of advice about the set-up, which is right


IN_A_CIRCLE: Final = (Turn(0.125, TURN_START_TIME_S),)
CIRCLE_DURATION_S: Final = 2.0 * math.pi / 0.22
EIGHT: Final = tuple(
    Turn(rate, BEGINS + k * CIRCLE_DURATION_S, CIRCLE_DURATION_S - 1.0)
    for k, rate in enumerate((0.22, -0.22, 0.22))
)
ZIGZAG: Final = tuple(
    turn_by(angle, 0.35, BEGINS + 8.0 * k) for k, angle in enumerate((30.0, -60.0, 60.0, -60.0, 60.0))
)
MANOEUVRES: Final = (
    Manoeuvre("flies straight on", 90.0),
    Manoeuvre("circle at 0.125 rad/s", 90.0, (Turn(0.125),)),
    Manoeuvre("circle at 0.2 rad/s", 90.0, (Turn(0.2),)),
    Manoeuvre("stops", 75.0, changes=(Change(BEGINS, -1.0),)),
    Manoeuvre(
        "stops out of a circle at 0.2 rad/s",
        75.0,
        (Turn(0.2, TURN_START_TIME_S, 10.0),),
        (Change(51.0, -1.0, 2.0),),
    ),
    Manoeuvre("zigzag by 60 degrees every 8 s, then stops", 115.0, ZIGZAG, (Change(BEGINS + 40.0, -1.0),)),
    Manoeuvre("eight at 0.22 rad/s, reversed twice", 135.0, EIGHT),
    Manoeuvre(
        "turns round 12 m wide, at 3 m/s", 110.0, (turn_by(180.0, 0.5, 55.0, NARROW_TURN_SPEED_M_S),), slows=True
    ),
    Manoeuvre("stops, turns its nose, flies at us", 110.0, changes=(Change(BEGINS, -1.0),), flies_back=60.0),
    Manoeuvre("turns back and flies past us", 110.0, changes=(Change(BEGINS, -2.0, hold=6.0),)),
    Manoeuvre("backs up at 4 m/s out of the hover", 60.0, backs_up=True),
    Manoeuvre("blind for 3 s, straight", 90.0, blind=(Interval(start=45.0, end=48.0),)),
    Manoeuvre("blind for 3 s, in a circle", 90.0, IN_A_CIRCLE, blind=(Interval(start=50.0, end=53.0),)),
    Manoeuvre("blind for 15 s, straight", 140.0, blind=(Interval(start=45.0, end=60.0),)),
    Manoeuvre("blind for 15 s, in a circle", 120.0, IN_A_CIRCLE, blind=(Interval(start=50.0, end=65.0),)),
    Manoeuvre("daemon killed for 2 s, in a circle", 90.0, IN_A_CIRCLE, killed=(50.0, 52.0)),
    Manoeuvre("daemon killed for 7 s, in a circle", 100.0, (Turn(0.17, TURN_START_TIME_S),), killed=(50.0, 57.0)),
    *(
        Manoeuvre(f"begun {side} of a leader at rest", 70.0, course_deg=course)
        for side, course in (("east", 270.0), ("south", 0.0), ("west", 90.0))
    ),
)


def scenario_of(autopilot: Autopilot, manoeuvre: Manoeuvre) -> Scenario:
    """The scenario of a flight."""
    base, v = load_scenario("guided-hover"), SPEEDS[autopilot]
    assert base.follow is not None  # noqa: S101 - it follows
    changes: tuple[Change, ...] = (Change(LEAVES, 1.0), *manoeuvre.changes)
    nose: tuple[Pulse, ...] = ()
    if manoeuvre.slows:
        changes = (*changes, Change(BEGINS, NARROW_TURN_SPEED_M_S / v - 1.0))
    if math.isfinite(back := manoeuvre.flies_back):
        changes = (*changes, Change(back, -NARROW_TURN_SPEED_M_S / v))
        nose = (
            Pulse(start=back - 5.0, end=back + ENDLESS_DURATION_S, change=180.0, hold=ENDLESS_DURATION_S - 3.0),
        )
    speeds = tuple(c.of(v) for c in changes)
    if manoeuvre.backs_up:
        speeds = (Pulse(start=LEAVES, end=LEAVES + 16.0, change=-4.0, hold=12.0),)
    turns = tuple(t.of(v) for t in manoeuvre.turns)
    return replace(
        base,
        duration=manoeuvre.duration,
        repeat=manoeuvre.duration + END_WINDOW_S,
        vehicle=replace(base.vehicle, autopilot=autopilot),
        leader=replace(
            base.leader,
            speed_pulses=speeds,
            a_lat_pulses=turns,
            climb_pulses=(),
            yaw_pulses_deg=nose,
            course_deg=manoeuvre.course_deg,
        ),
        camera=replace(base.camera, blackouts=manoeuvre.blind),
        follower=replace(base.follower, slot=SLOT),
        follow=replace(base.follow, offset=SLOT),
    )


def flown(autopilot: Autopilot, manoeuvre: Manoeuvre, seed: int, settings: Sequence[str] = ()) -> Result:
    """One flight and its result."""
    return judged(fly(scenario_of(autopilot, manoeuvre), seed, manoeuvre.duration, settings, manoeuvre.killed))


def judged(flight: Flight) -> Result:
    """The result of a flight."""
    of_slot, off = (a / float(np.linalg.norm(SLOT)) for a in (flight.distance, flight.slot_error))
    counts, last = flight.t >= SCORE_START_TIME_S, flight.t > flight.t[-1] - END_WINDOW_S
    low, high = SLOT_DISTANCE_RATIOS
    followed = (
        (flight.following > 0)
        & (flight.valid > 0)
        & (flight.in_view > 0)
        & (of_slot > low)
        & (of_slot < high)
        & (flight.aside < MAX_SIDE_ANGLE_RAD)
    )
    return Result(
        least=100.0 * float(of_slot[counts].min()),
        greatest=100.0 * float(of_slot[counts].max()),
        off=100.0 * float(np.median(off[counts])),
        farthest_off=100.0 * float(off[counts].max()),
        seen=100.0 * float(flight.in_view[counts].mean()),
        valid=100.0 * float(flight.valid[counts].mean()),
        aside=math.degrees(float(np.median(flight.aside[last]))),
        followed=bool(followed[last].mean() > 0.9),
        advised=len(flight.advice),
    )
