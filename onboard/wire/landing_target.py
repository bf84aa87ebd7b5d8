"""Image points from MAVLink's LANDING_TARGET, one message a point."""

import math
from collections import Counter
from typing import Any, Final

from onboard.messages import ImagePoint, TargetPoints
from onboard.wire.mavlink_records import read_header

PENDING_IMAGES: Final = 8  # images whose three points have not all come yet


class PointAssembler:
    """Three LANDING_TARGETs of one sender and one time_usec -> TargetPoints. What gives no image is counted in
    `rejected`.

    target_num 0, 1, 2 are the center, left and right point of the leader; 3k, 3k+1, 3k+2 those of a further
    target k. The angles are those of the image axes: angle_x = atan(Y_c/X_c), angle_y = atan(Z_c/X_c).
    """

    def __init__(self, rejected: Counter[str]) -> None:
        self._rejected = rejected
        self._pending: dict[tuple[int, int, int, int], dict[int, ImagePoint]] = {}

    def add(self, frame: Any, t_recv_ns: int) -> TargetPoints | None:
        """Add one point. The image's points once it has all three, else None."""
        number, label = divmod(frame.target_num, 3)
        key = (frame.get_srcSystem(), frame.get_srcComponent(), frame.time_usec, number)
        points = self._pending.setdefault(key, {})
        points[label] = (_tangent(frame.angle_x), _tangent(frame.angle_y))
        if len(points) < 3:
            while len(self._pending) > PENDING_IMAGES:
                self._pending.pop(next(iter(self._pending)))
                self._rejected["incomplete_points"] += 1
            return None
        del self._pending[key]
        return TargetPoints(
            **read_header(frame, t_recv_ns),
            camera="landing_target",
            target="leader" if number == 0 else f"target/{number}",
            center=points[0],
            left=points[1],
            right=points[2],
        )


def _tangent(angle: float) -> float:
    """tan, or NaN at and beyond a right angle, where there is no image point."""
    return math.tan(angle) if abs(angle) < math.pi / 2 else math.nan
