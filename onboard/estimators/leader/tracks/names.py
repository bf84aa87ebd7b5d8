"""Which track goes by which name: a detector's ids may change, and targets without an id are numbered."""

from collections.abc import Mapping
from typing import Final

from onboard.estimators.leader.image.prepare import Image
from onboard.estimators.leader.tracks.track import Track
from onboard.messages import Lifecycle
from onboard.ownship import Ownship

UNNAMED: Final = "unnamed/"  # before the numbers of targets without an id


def may_lead(track: Track) -> bool:
    """Whether a target without an id is tracked, so that it may be the leader."""
    return track.target.startswith(UNNAMED) and track.state is Lifecycle.TRACKING


def swap_names(one: Track, other: Track) -> None:
    """Let two targets change their names. Each name's counts go on: its state has changed, as after a reset."""
    one.target, other.target = other.target, one.target
    one.sequence, other.sequence = other.sequence, one.sequence
    one.life.resets, other.life.resets = other.life.resets + 1, one.life.resets + 1


def awaits_name(track: Track, t_ns: int) -> bool:
    """Whether an image of that time is the second one at least of a target that is not followed yet."""
    return not track.is_followed and bool(track.held) and track.held[0].message.t_ns < t_ns


def continued(by: Track, image: Image, near: Mapping[float, Track], ownship: Ownship) -> Track | None:
    """The track that goes on under the id of `by`, of those `near` the image, by their distance: its own id has
    not come since the first image of `by`, and the image fits its prediction."""
    since_ns = by.held[0].message.t_ns
    gone = {
        offset: t for offset, t in near.items() if t is not by and (t.repeats.newest_ns or since_ns) < since_ns
    }
    nearest = gone[min(gone)] if gone else None
    return nearest if nearest is not None and not nearest.expects(image, ownship).beyond else None
