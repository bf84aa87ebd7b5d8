"""A detector that finds the largest dark blob in a picture, and its ends.

It needs OpenCV and `onboard`.

python examples/contour.py --connect tcp/127.0.0.1:7447

The idea is that of Oh and Johnson, who find an aircraft by its contour: the darkest blob relative to its
surroundings is the aircraft, and the ends of its longest axis are the wingtips.
"""

import sys

import cv2
import numpy as np
import numpy.typing as npt
from live import run_detector

KERNEL_SIZE_PX = 31  # dark things thinner than this stand out
DARKNESS_THRESHOLD = 25.0  # grey levels below the surroundings
MIN_AREA_PX = 12  # of a blob
SIGMA_PX = 0.7  # of a wingtip

Point = tuple[float, float, float]
Picture = npt.NDArray[np.float32]


def find(picture: npt.NDArray[np.uint8]) -> dict[str, Point] | None:
    """Return the wingtips, each (u, v, sigma) in pixels, or None.

    The upper left corner of the picture is (0, 0).
    """
    kernel = cv2.getStructuringElement(cv2.MORPH_RECT, (KERNEL_SIZE_PX, KERNEL_SIZE_PX))
    dark = cv2.morphologyEx(picture, cv2.MORPH_BLACKHAT, kernel).astype(np.float32)
    count, labels, statistics, _ = cv2.connectedComponentsWithStats(
        (dark > DARKNESS_THRESHOLD).astype(np.uint8), connectivity=8
    )
    left, top, width, height, area = statistics.T
    edge = (left < 2) | (top < 2) | (left + width > dark.shape[1] - 2) | (top + height > dark.shape[0] - 2)
    area = np.where(edge, 0, area)  # what the edge cuts off has no ends; the background touches all edges
    k = int(np.argmax(area))
    if count < 2 or area[k] < MIN_AREA_PX:
        return None
    x, y = max(int(left[k]) - 3, 0), max(int(top[k]) - 3, 0)
    around = np.s_[y : top[k] + height[k] + 3, x : left[k] + width[k] + 3]
    return wingtips(dark[around], labels[around] == k, x, y)


def wingtips(dark: Picture, blob: npt.NDArray[np.bool_], left: int, top: int) -> dict[str, Point] | None:
    """Return the ends of the blob's longest axis, at half of the wing's darkness."""
    v, u = np.nonzero(blob)
    middle, (spread, axes) = np.array([u.mean(), v.mean()]), np.linalg.eigh(np.cov(u, v))
    axis = axes[:, 1] * (1.0 if axes[0, 1] > 0 else -1.0)  # to the right
    if spread[1] < 2.0 * spread[0]:
        return None  # no wing: it is as high as it is wide
    along = (np.column_stack([u, v]) - middle) @ axis
    places = np.arange(float(along.min()) - 3.0, float(along.max()) + 3.5, 0.5)
    offsets = np.arange(-4.0, 4.5, 0.5)
    profile = np.zeros_like(places)
    for _ in range(2):  # fuselage and fin pull the axis: the wing's own is that of its outer parts
        grid = middle + places[:, None, None] * axis + offsets[:, None] * np.array([-axis[1], axis[0]])
        u_map, v_map = np.moveaxis(grid.astype(np.float32), 2, 0)
        across = cv2.remap(dark, u_map, v_map, cv2.INTER_LINEAR)
        profile = across.sum(axis=1)
        outer = (np.abs(places) > 0.4 * places[-1]) & (profile > 0.5 * np.median(profile))
        if np.count_nonzero(outer) < MIN_AREA_PX:
            return None
        slope, height = np.polyfit(places[outer], (across @ offsets)[outer] / profile[outer], 1)
        middle = middle + height * np.array([-axis[1], axis[0]])
        axis = axis + slope * np.array([-axis[1], axis[0]])
        axis /= np.linalg.norm(axis)
    right, left_ = _end(places, profile), _end(-places[::-1], profile[::-1])
    if right is None or left_ is None:
        return None
    ends = {"left": middle - left_ * axis, "right": middle + right * axis}
    return {name: (left + float(p[0]) + 0.5, top + float(p[1]) + 0.5, SIGMA_PX) for name, p in ends.items()}


def _end(along: npt.NDArray[np.float64], profile: npt.NDArray[np.float32]) -> float | None:
    """Return where the profile falls to half of its value on the outer half of the wing.

    It is searched from the middle outwards.
    """
    half = float(along.max()) / 2
    outer = profile[along > half]
    if len(outer) < 4:
        return None
    level = 0.5 * float(np.percentile(outer, 70))
    inside = np.nonzero(profile > level)[0]
    if len(inside) == 0 or inside[-1] + 1 >= len(profile):
        return None
    k = inside[-1]
    fraction = (profile[k] - level) / max(profile[k] - profile[k + 1], 1e-6)
    return float(along[k] + fraction * (along[k + 1] - along[k]))


if __name__ == "__main__":
    sys.exit(run_detector(find, __doc__))
