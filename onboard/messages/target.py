"""Classes of targets: what aircraft a detector's class means."""

import math
from typing import Final, Literal

import msgspec

from onboard.messages.base import Positive, Record, Vec3

WING_POINTS: Final = ("center", "left", "right")  # of every class: its middle and its wingtips
POINT_SPANS: Final = 3.0  # times the wingspan: no point of an aircraft is farther from its center
MOST_POINTS: Final = 32
Aircraft = Literal["fixed-wing", "quadrotor", "hexarotor", "octorotor"]  # what has usual proportions


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
    aircraft: Aircraft | None = None  # what boxes bound, of usual proportions; None: as `outline_of` says

    def __post_init__(self) -> None:
        check_points(self.points_m, self.size_prior_m)
        check_bounds(self.points_m, self.aircraft, wings=self.wings)


def check_bounds(points_m: dict[str, Vec3], aircraft: Aircraft | None, *, wings: bool) -> None:
    """Raise ValueError for a class of which it is not clear what its boxes bound."""
    if not wings and aircraft is not None:
        raise ValueError(
            f'aircraft = "{aircraft}" and wings = false: both say what boxes bound; drop wings for usual'
            " proportions, or aircraft for points_m alone"
        )
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
        if not math.hypot(*point) <= POINT_SPANS * size_m:
            raise ValueError(f"points_m.{name}: farther than {POINT_SPANS:g} times the wingspan from the center")
