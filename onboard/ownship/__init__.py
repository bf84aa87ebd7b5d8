"""Our own vehicle: its pose and motion over the last seconds (`ownship`), where its gimbals point (`gimbals`), and
whether reports of them contradict each other (`contradictions`)."""

from onboard.ownship.gimbals import head_attitude
from onboard.ownship.limits import is_usable
from onboard.ownship.ownship import NavSample, Ownship, Pose, Step

__all__ = ["NavSample", "Ownship", "Pose", "Step", "head_attitude", "is_usable"]
