"""What a detection without all three points measures.

- Both wingtips without the center: the wing as ever. The center is near the wing's middle, but not on it, unless
  `center_on_wing` says so: its direction is that of the middle, with noise in proportion to the wing.
- The center, one wingtip, or a box: a direction alone. A wingtip is half a wing off the center, and the middle of
  a box may be a tenth of the box off. Such an offset lasts, so images do not average it out, and it counts
  `LASTING` times.

A direction alone starts no track: it says nothing of the range.
"""

import math
from typing import Any, Final, NamedTuple

import numpy as np

from onboard.estimators.leader.filter import LeaderFilter, Measurement
from onboard.filters.belief import Update
from onboard.messages import ImagePoint, TargetDetection, TargetImage, TargetPoints, Vec3

UNKNOWN: Final = 100.0  # rad: the noise of what is not measured. A minute of images with it says nothing
LASTING: Final = 4.0  # noise that lasts counts as often: a filter averages some sixteen images
OFF_WING: Final = 0.1  # of the wing: the center from the wing's middle, where nothing is known of it
ON_WING: Final = 0.02  # the same with `center_on_wing`, which allows 1 %; the nearer half of a wing looks longer
OFF_BOX: Final = 0.1  # of the box's side: the center from the box's middle
FAKE: Final = 1e-3  # focal lengths: half the wing of an image that shows none; its noise is UNKNOWN


class Seen(NamedTuple):
    """Center, left and right point with their sigmas, in focal lengths; how far off the center may lastingly be;
    and whether the center and the wing were seen, or stand for what was not."""

    points: tuple[ImagePoint, ImagePoint, ImagePoint]
    sigmas: Vec3
    offset: float = 0.0
    has_center: bool = True
    has_wing: bool = True


def seen(message: TargetImage, camera_sigma: float, *, center_on_wing: bool, half_wing: float) -> Seen:
    """What a message shows. `camera_sigma`: of a point without its own; `half_wing`: half the wing as it appears
    at most, where one wingtip is all that is seen. All in focal lengths."""
    if isinstance(message, TargetPoints):
        return Seen((message.center, message.left, message.right), message.sigma or (camera_sigma,) * 3)
    if not isinstance(message, TargetDetection):
        raise TypeError(f"{type(message).__name__} is not an image of a target")
    features = {f.name: f for f in message.features}
    if "center" not in features and "left" in features and "right" in features:
        left, right = features["left"], features["right"]
        (a, b), (c, d) = left.point, right.point
        sigma = 0.5 * math.hypot(left.sigma, right.sigma)
        off = ON_WING if center_on_wing else OFF_WING
        points = ((a + c) / 2, (b + d) / 2), left.point, right.point
        return Seen(points, (sigma, left.sigma, right.sigma), off * math.dist(*points[1:]), has_center=False)
    one = features.get("center", message.features[0])
    offset = {"center": 0.0, "box": 2.0 * OFF_BOX * (message.half_width or 0.0)}.get(one.name, half_wing)
    u, v = one.point
    return Seen((one.point, (u - FAKE, v), (u + FAKE, v)), (one.sigma,) * 3, offset, has_wing=False)


def measure(filter_: LeaderFilter, saw: Seen) -> Measurement:
    """The filter's measurement of it: what was not seen has noise without bound."""
    measured = filter_.measure(np.array(saw.points), np.array(saw.sigmas))
    if saw.has_center and saw.has_wing:
        return measured
    y, R = measured.y.copy(), measured.R.copy()
    R[[0, 1], [0, 1]] += (LASTING * saw.offset) ** 2
    first = 4 if saw.has_wing else 2  # the wing's middle was taken for the center: it is not measured twice
    for i in range(first, len(y)):
        y[i], R[i, :], R[:, i] = 0.0, 0.0, 0.0
        R[i, i] = UNKNOWN**2
    if saw.has_wing:
        return measured._replace(y=y, R=R)
    return measured._replace(y=y, R=R, span_sigma=math.inf)


def refused(measurement: Measurement, state: Any) -> Update:
    """The update by a direction that the filter could not use, because it would have had to start again with
    it."""
    m = len(measurement.y)
    return Update(state, np.zeros(m), np.eye(m), measurement.y, math.inf)
