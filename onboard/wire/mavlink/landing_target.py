"""Image points from MAVLink's LANDING_TARGET, one message a point."""

import math
from collections import Counter
from typing import Final

from onboard.messages import Exposure, ImagePoint, TargetPoints
from onboard.wire.mavlink.records import Fields, Header, Layout

LANDING_TARGET: Final = Layout("<Q5f2B7f2B", usec=0)
MAX_PENDING_IMAGES: Final = 8  # of one sender, with fewer than three points
MAX_SENDER_COUNT: Final = 512  # that have completed an image, and as many that have not

# system, component, whether it is the leader: further targets never cost its images
Sender = tuple[int, int, bool]
Pending = dict[tuple[int, int], dict[int, ImagePoint]]  # (time_usec, target) -> label -> point


class PointAssembler:
    """Assembler of three LANDING_TARGETs with one sender and one time_usec into an image.

    target_num 0, 1, 2 are the center, left and right point of the leader; 3k, 3k+1, 3k+2 those of a further target
    k. The angles are those of the image axes: angle_x = atan(Y_c/X_c), angle_y = atan(Z_c/X_c). Messages that make
    no image are counted in `rejected`.

    Each sender has its own memory, so a flood costs only the flooder's images. Senders that have completed an
    image are kept apart from those that have not.
    """

    def __init__(self, rejected: Counter[str]) -> None:
        self._rejected = rejected
        self._proven: dict[Sender, Pending] = {}  # have completed an image, the latest last
        self._new: dict[Sender, Pending] = {}

    def __len__(self) -> int:
        """The number of incomplete images."""
        return sum(len(images) for senders in (self._proven, self._new) for images in senders.values())

    def add(self, fields: Fields, header: Header) -> Exposure | None:
        """Add one point. The image's points once it has all three, else None."""
        time_usec, angle_x, angle_y, _, _, _, target_num, *_, position_valid = fields
        if position_valid:
            self._rejected["landing_target_position"] += 1  # of a landing pad, or our own report of the leader
            return None
        number, label = divmod(target_num, 3)
        sender = (header["system"], header["component"], number == 0)
        images = self._images(sender)
        points = images.setdefault((time_usec, number), {})
        points[label] = (_tangent(angle_x), _tangent(angle_y))
        if len(points) < 3:
            while len(images) > MAX_PENDING_IMAGES:
                images.pop(next(iter(images)))
                self._rejected["incomplete_points"] += 1
            return None
        del images[time_usec, number]
        self._prove(sender, images)
        image = TargetPoints(
            **header,
            camera="landing_target",
            target="leader" if number == 0 else f"target/{number}",
            center=points[0],
            left=points[1],
            right=points[2],
        )
        return Exposure.of(image)

    def _images(self, sender: Sender) -> Pending:
        """The images of a sender that wait for points."""
        images = self._proven.get(sender)
        if images is None:
            images = self._new.setdefault(sender, {})
            self._bound(self._new)
        return images

    def _prove(self, sender: Sender, images: Pending) -> None:
        """A sender has completed an image."""
        self._new.pop(sender, None)
        self._proven.pop(sender, None)
        self._proven[sender] = images
        self._bound(self._proven)

    def _bound(self, senders: dict[Sender, Pending]) -> None:
        while len(senders) > MAX_SENDER_COUNT:
            self._rejected["incomplete_points"] += len(senders.pop(next(iter(senders))))


def is_point(payload: bytes) -> bool:
    """Whether a LANDING_TARGET is an image point, by the absence of a position."""
    return not LANDING_TARGET.fields(payload)[-1]


def _tangent(angle: float) -> float:
    """tan, or NaN at and beyond a right angle, where there is no image point."""
    return math.tan(angle) if abs(angle) < math.pi / 2 else math.nan
