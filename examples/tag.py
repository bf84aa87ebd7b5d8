"""A detector for an AprilTag of the family 36h11; it needs OpenCV and `onboard`.

python examples/tag.py --connect tcp/127.0.0.1:7447

The tag stands across the aircraft's forward axis. Its middle is the center; the middles of its sides are `left`
and `right`, so that the tag's side is the wingspan (`size_prior_m`).
"""

import sys

import cv2
import numpy as np
import numpy.typing as npt
from live import run_detector

SIGMA_PX = 0.3

Point = tuple[float, float, float]

_parameters = cv2.aruco.DetectorParameters()
_parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
_detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11), _parameters)


def find(picture: npt.NDArray[np.uint8]) -> dict[str, Point] | None:
    """Return center and both sides of the first tag, each (u, v, sigma) in pixels, or None.

    The upper left corner of the picture is (0, 0).
    """
    corners, numbers, _ = _detector.detectMarkers(picture)
    if numbers is None or len(corners) == 0:
        return None
    upper_left, upper_right, lower_right, lower_left = corners[0].reshape(4, 2) + 0.5
    # the diagonals meet in the middle, also where the tag is seen at an angle
    a, b = lower_right - upper_left, lower_left - upper_right
    t = np.linalg.solve(np.column_stack([a, -b]), upper_right - upper_left)[0]
    center = upper_left + t * a
    points = {"center": center, "left": (upper_left + lower_left) / 2, "right": (upper_right + lower_right) / 2}
    return {name: (float(u), float(v), SIGMA_PX) for name, (u, v) in points.items()}


if __name__ == "__main__":
    sys.exit(run_detector(find, __doc__))
