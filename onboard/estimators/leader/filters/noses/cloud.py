"""A cloud of noses: what is known of a leader whose nose may point anywhere (`particles`)."""

from collections.abc import Iterable
from typing import Any, Final, NamedTuple

from onboard.arrays import Array
from onboard.models.apparent_wing import LEAST_VISIBLE

ARRAYS: Final = 7  # of the fields, the first: each has one row a particle


class Cloud(NamedTuple):
    """K particles: noses (K,) in rad from north, not wrapped; rates (K,) at which they are turned, rad/s, 0
    for those that are not; the regime of each leader (K,), STEADY, ACCELERATING or HOVERING, means (K, N) and
    covariances (K, N, N) of `models.apparent_wing`; the logarithms of each leader's intensities (K, 3), by
    which it manoeuvres, banks and wobbles more than others; whether the nose is tied to the course (K,),
    TIED, FREE or UNDECIDED; logarithms of the weights (K,); the number of random draws so far; the share of
    the wing's length that the edge-on aircraft shows in what started the cloud; the bias, as a share of the
    size, of what started it: boxes have one, points have none, and that of poses is of the range; whether
    points have distinguished the nose from the tail; by what share they make the length that shows the nose
    wrong, as a bias; whether the ranges are metric, by poses, and not those of a leader of the configured
    size; the seconds
    since the last image that corrected it; and the named points of the last image that fitted no nose."""

    noses: Array
    rates: Array
    regimes: Array
    means: Array
    covariances: Array
    intensities: Array
    tied: Array
    log_weights: Array
    draws: int
    edge_on: float = LEAST_VISIBLE
    lasting: float = 0.0
    sided: bool = False
    misplaced: float = 0.0
    metric: bool = False
    unseen: float = 0.0
    misfits: tuple[str, ...] = ()


def named(arrays: Iterable[Array]) -> dict[str, Any]:
    """The arrays of a cloud, in their order, by their names."""
    return dict(zip(Cloud._fields, arrays, strict=False))
