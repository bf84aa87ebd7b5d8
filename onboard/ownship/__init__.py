"""Our own vehicle: its pose and motion over the last seconds (`ownship`), where its gimbals point (`gimbals`), and
whether reports of them contradict each other (`contradictions`), how noisy they are (`scatter`), and which
source is used (`source`)."""

from onboard.ownship.gimbals import head_attitude
from onboard.ownship.histories import NavSample, Step
from onboard.ownship.limits import is_usable
from onboard.ownship.ownship import Ownship, Pose
from onboard.ownship.source import StatedMotion

__all__ = ["NavSample", "Ownship", "Pose", "StatedMotion", "Step", "head_attitude", "is_usable"]
