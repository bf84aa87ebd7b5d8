"""A cloud of noses: what is known of a leader whose nose may point anywhere (`particles`)."""

import math
from collections.abc import Iterable
from typing import Any, Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.models.apparent_wing import LEAST_VISIBLE, N

ARRAYS: Final = 9  # of the fields, the first: each has one row a particle


class Bias(NamedTuple):
    """An error of measurements that lasts: its standard deviation, and its correlation time, s."""

    name: str
    sigma: float
    time: float = math.inf


class Cloud(NamedTuple):
    """K particles: noses (K,) in rad from north, not wrapped; rates (K,) at which they are turned, rad/s, 0 for
    those that are not; the regime of each leader (K,), STEADY, ACCELERATING or HOVERING, means (K, W) and
    covariances (K, W, W) of `models.apparent_wing`, with the `biases` behind the first N; the logarithms of each
    leader's intensities (K, 3), by which it manoeuvres, banks and wobbles more than others; whether the nose is
    tied to the course (K,), TIED, FREE or UNDECIDED; each leader's drag (K,), 1/s; the mean of the error of its
    bank lately (K,), rad; logarithms of the weights (K,); the number of random draws so far; the share of the
    wing's length that the edge-on aircraft shows in what images show; whether points have distinguished the nose
    from the tail; by what share they make the length that shows the nose wrong, as a bias; whether the ranges are
    metric, by poses, and not those of a leader of some size; the seconds since the last image that corrected it;
    so many images' evidence of a new track that is not used yet; and the named points of the last image that
    fitted no nose."""

    noses: Array
    rates: Array
    regimes: Array
    means: Array
    covariances: Array
    intensities: Array
    tied: Array
    drags: Array
    rolled: Array
    log_weights: Array
    draws: int
    edge_on: float = LEAST_VISIBLE
    sided: bool = False
    misplaced: float = 0.0
    metric: bool = False
    unseen: float = 0.0
    fresh: float = 0.0
    misfits: tuple[str, ...] = ()
    biases: tuple[Bias, ...] = ()

    def column(self, name: str) -> int:
        """Of a bias in the state."""
        return N + [bias.name for bias in self.biases].index(name)

    def with_biases(self, *biases: Bias) -> "Cloud":
        """With those of them that it has not yet. Nothing is known of a new one but its standard deviation."""
        known = {bias.name for bias in self.biases}
        new = tuple(bias for bias in biases if bias.name not in known)
        if not new:
            return self
        wider = ((0, 0), (0, len(new)))
        means, P = np.pad(self.means, wider), np.pad(self.covariances, (*wider, wider[1]))
        at = np.arange(len(new)) + self.means.shape[1]
        P[:, at, at] = np.square([bias.sigma for bias in new])
        return self._replace(means=means, covariances=P, biases=(*self.biases, *new))


def named(arrays: Iterable[Array]) -> dict[str, Any]:
    """The arrays of a cloud, in their order, by their names."""
    return dict(zip(Cloud._fields, arrays, strict=False))
