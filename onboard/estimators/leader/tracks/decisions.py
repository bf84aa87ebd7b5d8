"""What a track does with an image, as values: `track` decides in one function, and then does it."""

from typing import NamedTuple

from onboard.estimators.kit.history import History
from onboard.estimators.leader.image.prepare import Image
from onboard.estimators.leader.tracks.fusing import TrackState
from onboard.filters.belief import Update
from onboard.messages import Verdict
from onboard.messages.causes import Reason
from onboard.ownship import Ownship

TrackHistory = History[TrackState, Ownship]


class FuseImage(NamedTuple):
    """The image has passed the gate."""

    update: Update


class FuseLate(NamedTuple):
    """So has this one, which is older than another one that was fused."""

    update: Update


class RejectImage(NamedTuple):
    """The image is not used, with as much as was known of it."""

    verdict: Verdict
    image: Image | None = None
    update: Update | None = None


class BeginTrack(NamedTuple):
    """The image is to start a track, with others that agree; from what was known `before`, which it `fits`."""

    before: TrackHistory | None = None
    fits: bool = True


class RestartTrack(NamedTuple):
    """No image has passed the gate for too long: the track ends, and this image is to start another."""

    why: Reason
    update: Update


class EndTrack(NamedTuple):
    """The track ends."""

    why: Reason
    verdict: Verdict


Decision = FuseImage | FuseLate | RejectImage | BeginTrack | RestartTrack | EndTrack
