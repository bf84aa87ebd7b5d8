"""What a track does with an image, as values: `track` decides in one function, and then does it."""

import math
from typing import NamedTuple

from onboard.estimators.kit.history import History
from onboard.estimators.leader.hypotheses.belief import Comparison, Prediction
from onboard.estimators.leader.image.prepare import Image
from onboard.estimators.leader.tracks.fusing import TrackState
from onboard.filters.belief import Update
from onboard.messages import Verdict
from onboard.messages.causes import Reason
from onboard.ownship import Ownship

TrackHistory = History[TrackState, Ownship]
Predicted = tuple[TrackState, Prediction]  # a track at the time of an image, and its filter's hypotheses


class Candidate(NamedTuple):
    """An image that may be of a track: the track's state before it, and the image beside what the track expects,
    None where it expects nothing; whether it `fits`, so that it passes the gate."""

    image: Image
    state: TrackState | None = None
    compared: Comparison | None = None
    fits: bool = False

    @property
    def nis(self) -> float:
        """By what the track expects; 0 where it expects nothing."""
        return 0.0 if self.compared is None else self.compared.nis

    @property
    def cost(self) -> float:
        """See `Comparison.cost`; infinite where the track expects nothing."""
        return math.inf if self.compared is None else self.compared.cost


class Fuse(NamedTuple):
    """The image has passed the gate."""

    update: Update


class Late(NamedTuple):
    """So has this one, which is older than another one that was fused."""

    update: Update


class Reject(NamedTuple):
    """The image is not used, with as much as was known of it."""

    verdict: Verdict
    image: Image | None = None
    update: Update | None = None


class Begin(NamedTuple):
    """The image is to start a track, with others that agree; from what was known `before`, which it `fits`."""

    before: TrackHistory | None = None
    fits: bool = True


class Restart(NamedTuple):
    """No image has passed the gate for too long: the track ends, and this image is to start another."""

    why: Reason
    update: Update


class End(NamedTuple):
    """The track ends."""

    why: Reason
    verdict: Verdict


Decision = Fuse | Late | Reject | Begin | Restart | End
