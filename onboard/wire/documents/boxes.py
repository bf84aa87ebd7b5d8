"""A detector's box: the noise and image points of its sides, and cuts by the edge."""

from typing import Final

from onboard.geometry.lens import Lens, Located
from onboard.messages import Box, Sides

BOX_NOISE_RATIO: Final = 0.05  # sigma of a side over the larger side, of common detectors
CUT_MARGIN_SIGMAS: Final = 3.0  # from the edge of the image to a side that it may cut
MIN_CUT_MARGIN_PX: Final = 1.0


def larger_px(box: Box) -> float:
    """The larger side of a box."""
    return max(box.width_px, box.height_px)


def noise_px(box: Box, sigma_px: float) -> float:
    """Default sigma of a side, for a detector whose points have `sigma_px`."""
    return max(sigma_px, BOX_NOISE_RATIO * larger_px(box))


def may_be_cut(box: Box, lens: Lens, sigma_px: float) -> bool:
    """Whether the edge of the image may cut a box off.

    Detectors do not draw a cut box up to the edge: it ends inside by as much as any side is off.
    """
    if lens.size_px is None:
        return False
    margin = max(CUT_MARGIN_SIGMAS * max(noise_px(box, sigma_px), box.sigma_px or 0.0), MIN_CUT_MARGIN_PX)
    spans = (box.u_px, box.width_px, lens.size_px[0]), (box.v_px, box.height_px, lens.size_px[1])
    return any(middle - 0.5 * side < margin or middle + 0.5 * side > end - margin for middle, side, end in spans)


def sides(box: Box, lens: Lens) -> Sides | None:
    """Image points of the middles of the left, upper, right and lower side.

    None where the lens model does not describe one of them. A distorted lens stretches width and height unequally.
    """
    u, v, right, down = box.u_px, box.v_px, 0.5 * box.width_px, 0.5 * box.height_px
    places = lens.locate([(u - right, v), (u, v - down), (u + right, v), (u, v + down)])
    found = [place.point for place in places if isinstance(place, Located)]
    return (found[0], found[1], found[2], found[3]) if len(found) == 4 else None
