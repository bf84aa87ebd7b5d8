"""Classes of targets: the aircraft that a detector's class stands for."""

import math
from typing import Final, Literal

import msgspec

from onboard.messages.base import Positive, Record, Vec3

WING_POINTS: Final = ("center", "left", "right")  # every class has its middle and its wingtips
MAX_POINT_DISTANCE_RATIO: Final = 3.0  # Distance of a point from the center over the wingspan.
MAX_POINT_COUNT: Final = 32
Aircraft = Literal["fixed-wing", "quadrotor", "hexarotor", "octorotor"]  # those with usual proportions


class TargetClass(Record, frozen=True, kw_only=True):
    """Configuration `[target.CLASS]`: a class of aircraft, by the detector's name for it.

    Every class has the points `center`, `left` and `right`, which are its middle and its wingtips; `points_m` adds
    further ones. Raises ValueError for an impossible point.
    """

    size_prior_m: Positive  # the wingspan
    size_prior_sigma_m: Positive | None = None  # None: 2 % of the wingspan
    leader_class: Literal["fixed_wing", "multirotor"] = "multirotor"  # sets how quickly its speed may change
    named_wingtips: bool = False  # the detector distinguishes left and right wingtip from any direction
    points_m: dict[str, Vec3] = msgspec.field(default_factory=dict)  # body FRD from the center, at `size_prior_m`
    wings: bool = True  # boxes include the wing; false: only the points
    aircraft: Aircraft | None = None  # boxes bound this type; None: see `outline_of`

    def __post_init__(self) -> None:
        check_points(self.points_m, self.size_prior_m)
        check_bounds(self.points_m, self.aircraft, wings=self.wings)


def check_bounds(points_m: dict[str, Vec3], aircraft: Aircraft | None, *, wings: bool) -> None:
    """Raise ValueError for a class that does not define what its boxes bound."""
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
    """Raise ValueError for unusable points of a class."""
    if len(points_m) > MAX_POINT_COUNT:
        raise ValueError(f"points_m: {MAX_POINT_COUNT} points at most, not {len(points_m)}")
    for name, point in points_m.items():
        if name in WING_POINTS:
            raise ValueError(f"points_m.{name}: every class has it, half the wingspan from the center")
        if name in ("", "box"):
            raise ValueError(f"points_m.{name or repr(name)}: the name is reserved; choose another")
        if not math.hypot(*point) <= MAX_POINT_DISTANCE_RATIO * size_m:
            raise ValueError(
                f"points_m.{name}: farther than {MAX_POINT_DISTANCE_RATIO:g} times the wingspan from the center"
            )
