"""Where a leader was last seen. A leader that was seen is in front of the camera that saw it, and soon after it is
not far from there: a place mirrored through us has the right range, and no range shows the difference."""

import math
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.estimators.leader.camera_pose import CameraPose
from onboard.messages.causes import Cause, Reason

FARTHEST: Final = math.radians(30.0)  # from the last sight: no place farther off is believed
ASTRAY: Final = Reason(
    Cause.ASTRAY, f"it would be more than {math.degrees(FARTHEST):.0f} degrees from where it was last seen"
)


class Sight(NamedTuple):
    """A direction (3,), a unit vector in n, from a camera at r_FC_n (3,) m."""

    direction_n: Array
    r_FC_n: Array

    def shows(self, r_FL_n: Array) -> bool:
        """Whether a place (3,) m is near this line of sight, and on the right side of us."""
        r = r_FL_n - self.r_FC_n
        return bool(self.direction_n @ r > math.cos(FARTHEST) * np.linalg.norm(r))


def sight(axes: Array, pose: CameraPose) -> Sight:
    """The sight of an image with these measured `axes` (3, 3) in c (see `filters.measurement`)."""
    return Sight(axes[0] @ pose.R_cn, pose.r_FC_n)


class LastSight:
    """The newest sight of one leader."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Forget it: another track begins."""
        self._t_ns = 0
        self._sight: Sight | None = None

    def see(self, t_ns: int, axes: Array, pose: CameraPose) -> None:
        """An image was fused."""
        if t_ns >= self._t_ns:
            self._t_ns, self._sight = t_ns, sight(axes, pose)

    def contradicts(self, r_FL_n: Array) -> bool:
        """Whether a place (3,) m is far from it."""
        return self._sight is not None and not self._sight.shows(r_FL_n)
