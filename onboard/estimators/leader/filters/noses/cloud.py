"""A cloud of noses: what is known of a leader whose nose may point anywhere (`particles`)."""

from typing import NamedTuple

from onboard.arrays import Array
from onboard.models.apparent_wing import LEAST_VISIBLE


class Cloud(NamedTuple):
    """K particles: noses (K,) in rad from north, not wrapped; rates (K,) at which they are turned, rad/s, 0 for
    those that are not; whether each leader accelerates (K,), 0 or 1; means (K, N) and covariances (K, N, N) of
    `models.apparent_wing`; logarithms of the weights (K,); the number of random draws so far; the share of the
    wing's length that the edge-on aircraft shows in what started the cloud; by how much of the size that
    lastingly misleads: a box does, points do not, and poses do of the range; whether points have distinguished
    the nose from the tail; how far off, as a share, they lastingly make the length that shows the nose;
    whether the ranges are metric, by poses, and not those of a leader of the configured size; and the named points
    of the last image that fitted no nose."""

    noses: Array
    rates: Array
    accelerates: Array
    means: Array
    covariances: Array
    log_weights: Array
    draws: int
    edge_on: float = LEAST_VISIBLE
    lasting: float = 0.0
    sided: bool = False
    misplaced: float = 0.0
    metric: bool = False
    misfits: tuple[str, ...] = ()
