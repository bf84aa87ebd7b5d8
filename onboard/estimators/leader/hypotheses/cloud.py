"""A cloud of noses: what is known of a leader whose nose may point anywhere.

One image leaves the nose open, and with it the range. Each particle supposes a nose, and whether the leader
turns it or changes its speed; given those, the rest is nearly linear (`motion`). A new cloud has
noses over half a circle: a wing looks the same from the front and from behind. A particle loses weight only by
evidence.

Smoothness is no evidence. A near leader that flies calmly and a far one that flies twice as boldly look alike, and
how boldly a leader flies is not known. So all noise is proportional to the range that a particle's nose
implies, and no nose fits smooth motion better than another. Evidence is our own known motion, and a line of
sight that turns while the nose does not.

Random numbers are a fixed function of the count of steps, so the same images give the same cloud.
"""

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numba import njit, types

from onboard.arrays import Array
from onboard.estimators.leader.assumptions import NoseModel
from onboard.estimators.leader.hypotheses.draws import uniform
from onboard.estimators.leader.hypotheses.motion import LEAST_VISIBLE, NUMBER, N
from onboard.filters.compiled import ROWS, VECTOR

ARRAYS: Final = 9  # of the fields, the first: each has one row a particle
NOSE_BIN: Final = math.radians(6.0)  # rad
RANGE_BIN: Final = 0.05  # of the range's logarithm
LEAST_WEIGHT: Final = 0.002  # of a bin that counts
PER_BIN: Final = 6  # particles
CHANGE: Final = 1.5  # the number of particles changes by this factor at least
MOST_EVIDENCE: Final = 40.0  # of the logarithm of a likelihood ratio, by one measurement


class Bias(NamedTuple):
    """An error of measurements that lasts: its standard deviation, and its correlation time, s."""

    name: str
    sigma: float
    time: float = math.inf


class Cloud(NamedTuple):
    """K particles: noses (K,) in rad from north, not wrapped; rates (K,) at which they are turned, rad/s, 0 for
    those that are not; the regime of each leader (K,), STEADY, ACCELERATING or HOVERING, means (K, W) and
    covariances (K, W, W) of `wing`, with the `biases` behind the first N; the logarithms of each
    leader's intensities (K, 3), by which it manoeuvres, banks and wobbles more than others; whether the nose is
    tied to the course (K,), TIED, FREE or UNDECIDED; each leader's drag (K,), 1/s; the mean of the error of its
    bank lately (K,), rad; logarithms of the weights (K,); the number of random draws so far; the share of the
    wing's length that the edge-on aircraft shows in what images show; whether points have distinguished the nose
    from the tail; by what share they make the length that shows the nose wrong, as a bias; whether the ranges are
    metric, by poses, and not those of a leader of some size; the seconds since the last image that corrected it;
    so many images' evidence of a new track that is not used yet; the named points of the last image that fitted no
    nose; and how much farther from what the particles expected the images of the last seconds were than the
    particles' own uncertainties say: the mean NIS per component."""

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
    surprise: float = 1.0
    biases: tuple[Bias, ...] = ()

    def leans(self, settings: NoseModel) -> bool:
        """Whether leaders lean, and images show it."""
        return settings.drag != 0.0 and self.edge_on <= LEAST_VISIBLE

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


def weighted(cloud: Cloud, log_l: Array) -> Cloud:
    """The cloud with each particle's weight times a likelihood, of which these are the logarithms (K,)."""
    log_weights = cloud.log_weights + log_l
    log_weights -= np.maximum.reduce(log_weights)  # the methods of an array cost as much again
    return cloud._replace(log_weights=log_weights - math.log(np.add.reduce(np.exp(log_weights))))


def evidence(log_l: Array, believed: float = 1.0) -> Array:
    """The logarithms of likelihoods (K,) as far as they are `believed`, from 0 to 1."""
    found: Array = believed * np.maximum(log_l, np.maximum.reduce(log_l) - MOST_EVIDENCE)
    return found


def fitting(settings: NoseModel, cloud: Cloud) -> Cloud:
    """The cloud with as many particles as there should be, drawn anew where few have the weight."""
    w = np.exp(cloud.log_weights)
    count = enough(settings, cloud, w)
    is_apt = len(w) / CHANGE < count < len(w) * CHANGE
    if 1.0 / float(np.add.reduce(w * w)) > settings.resample * len(w) and is_apt:
        return cloud
    return resampled(cloud, count)


def enough(settings: NoseModel, cloud: Cloud, w: Array) -> int:
    """How many particles there should be: in proportion to the number of different noses and ranges that have
    weight, as in KLD-sampling (Fox, 2003). Where points show the nose, the right noses are few degrees wide: what
    follows a nose that turns must be dense there."""
    turn, fewest = (math.tau, settings.fewest_sided) if cloud.sided else (math.pi, settings.fewest)
    sizes = NOSE_BIN, RANGE_BIN, LEAST_WEIGHT
    bins = int(occupied(cloud.noses, cloud.means, w, turn, *sizes))
    return min(max(PER_BIN * bins, fewest), settings.particles)


def resampled(cloud: Cloud, k: int) -> Cloud:
    """k particles, drawn by their weights, which become alike: systematic resampling."""
    at = (np.arange(k) + uniform(cloud.draws, 1)[0]) / k
    chosen = np.minimum(np.searchsorted(np.cumsum(np.exp(cloud.log_weights)), at), len(cloud.noses) - 1)
    arrays: dict[str, Any] = {name: getattr(cloud, name)[chosen] for name in Cloud._fields[:ARRAYS]}
    log_weights = np.full(k, -math.log(k))
    return cloud._replace(**arrays, log_weights=log_weights, draws=cloud.draws + 1)


@njit(
    types.int64(VECTOR, ROWS, VECTOR, NUMBER, NUMBER, NUMBER, NUMBER),
    cache=True,
    error_model="numpy",
)
def occupied(noses, means, w, turn, nose_bin, range_bin, least):
    """How many bins of noses (K,), which repeat after `turn`, and of logarithms of the means' ranges (K, W) have
    at least so much of the weights w (K,)."""
    size, nothing, last = 1, np.int64(-(1 << 62)), 1e15  # what is no number is in the last bin
    while size < 2 * w.shape[0]:  # so much room that few keys meet
        size *= 2
    keys, weights = np.full(size, nothing), np.zeros(size)
    for k in range(w.shape[0]):
        x = means[k]
        log_range = 0.5 * np.log(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])
        bin_ = np.floor(noses[k] % turn / nose_bin) + 1000.0 * np.floor(log_range / range_bin)
        key = np.int64(bin_) if abs(bin_) < last else np.int64(last)
        at = key & (size - 1)
        while keys[at] != key and keys[at] != nothing:
            at = (at + 1) & (size - 1)
        keys[at] = key
        weights[at] += w[k]
    found = 0
    for weight in weights:
        found += 1 if weight > least else 0
    return found
