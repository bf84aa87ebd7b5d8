"""Our own vehicle: its motion, gimbals, contradictions, noise and source."""

from onboard.ownship.gimbals import head_attitude
from onboard.ownship.histories import NavSample, Step
from onboard.ownship.limits import is_usable
from onboard.ownship.ownship import Ownship, Pose
from onboard.ownship.source import StatedMotion

__all__ = ["NavSample", "Ownship", "Pose", "StatedMotion", "Step", "head_attitude", "is_usable"]
