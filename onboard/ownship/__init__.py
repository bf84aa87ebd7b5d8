"""Our own vehicle: its pose and motion over the last seconds (`ownship`), and whether they can be true
(`contradictions`)."""

from onboard.ownship.limits import is_usable
from onboard.ownship.ownship import NavSample, Ownship, Pose, Step

__all__ = ["NavSample", "Ownship", "Pose", "Step", "is_usable"]
