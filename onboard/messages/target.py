"""Classes of targets: what aircraft a detector's class means."""

import math
from typing import Final, Literal

import msgspec

from onboard.messages.base import Positive, Record, Vec3

WING_POINTS: Final = ("center", "left", "right")  # of every class: its middle and its wingtips
FARTHEST: Final = 3.0  # times the wingspan: no point of an aircraft is farther from its center
MOST_POINTS: Final = 32


class TargetClass(Record, frozen=True, kw_only=True):
    """`[target.CLASS]`: a class of aircraft, by the name that the detector gives it. Every class has the points
    `center`, `left` and `right`, which are its middle and its wingtips; `points_m` has further ones.

    Raises ValueError for a point that cannot be one.
    """

    size_prior_m: Positive  # the wingspan
    size_prior_sigma_m: Positive | None = None  # None: 2 % of the wingspan
    leader_class: Literal["fixed_wing", "multirotor"] = "multirotor"  # how freely it changes its speed
    named_wingtips: bool = False  # the detector tells the left wingtip from the right one, seen from anywhere
    points_m: dict[str, Vec3] = msgspec.field(default_factory=dict)  # body FRD, from the center, at that wingspan
    wings: bool = True  # boxes bound a wing, too; false: the points alone

    def __post_init__(self) -> None:
        check_points(self.points_m, self.size_prior_m)
        check_wings(self.points_m, wings=self.wings)


def check_wings(points_m: dict[str, Vec3], *, wings: bool) -> None:
    """Raise ValueError for a class without wings whose points do not show how large it is."""
    every = list(points_m.values())
    extents = [max(x) - min(x) for x in list(zip(*every, strict=True))[:2]]
    if not wings and not (extents and min(extents) > 0.0):
        raise ValueError("wings = false: points_m must say how long and how wide it is")


def check_points(points_m: dict[str, Vec3], size_m: float) -> None:
    """Raise ValueError for points of a class that cannot be used."""
    if len(points_m) > MOST_POINTS:
        raise ValueError(f"points_m: {MOST_POINTS} points at most, not {len(points_m)}")
    for name, point in points_m.items():
        if name in WING_POINTS:
            raise ValueError(f"points_m.{name}: every class has it, half the wingspan from the center")
        if name in ("", "box"):
            raise ValueError(f"points_m.{name}: no point can be called so")
        if not math.hypot(*point) <= FARTHEST * size_m:
            raise ValueError(f"points_m.{name}: farther than {FARTHEST:g} times the wingspan from the center")
