"""Particles: what is known of a leader whose heading may point anywhere.

One image leaves the heading open, and with it the range. Each particle supposes a heading, and whether the leader
turns it or changes its speed; given those, the rest is nearly linear (`motion`). New particles have
headings over half a circle: a wing looks the same from the front and from behind. A particle loses weight only by
evidence.

Smoothness is no evidence. A near leader that flies calmly and a far one that flies twice as boldly look alike, and
how boldly a leader flies is not known. So all noise is proportional to the range that a particle's heading
implies, and no heading fits smooth motion better than another. Evidence is our own known motion, and a line of
sight that turns while the heading does not.

Random numbers are a fixed function of the count of steps, so the same images give the same particles.
"""

import math
from typing import Any, Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.compiled import FILLING, MAKING, ROWS, VECTOR, kernel
from onboard.estimators.leader import assumptions as given
from onboard.estimators.leader.assumptions import LeaderModel
from onboard.estimators.leader.hypotheses.draws import uniform
from onboard.estimators.leader.hypotheses.motion import HEADINGS, NUMBER, RX, RY, RZ, VX, VY, VZ, N

ARRAY_COUNT: Final = 9  # of the fields, the first: each has one row a particle


class Bias(NamedTuple):
    """An error of measurements that lasts.

    Its standard deviation, and its correlation time, s."""

    name: str
    sigma: float
    time: float = math.inf


class Particles(NamedTuple):
    """K weighted hypotheses about one leader, and what its images so far have in common."""

    headings: Array  # (K,) rad from north, not wrapped
    rates: Array  # (K,) rad/s, at which headings are turned; 0: they are not
    regimes: Array  # (K,) STEADY, ACCELERATING or HOVERING
    means: Array  # (K, W) of `motion`, with the `biases` behind the first N
    covariances: Array  # (K, W, W)
    intensities: Array  # (K, 3) logarithms of how much more than others a leader manoeuvres, banks and wobbles
    course_locked: Array  # (K,) COURSE_LOCKED, FREE or UNDECIDED: whether the heading is locked to the course
    drags: Array  # (K,) 1/s
    mean_bank_error: Array  # (K,) rad, lately
    log_weights: Array  # (K,)
    draws: int  # random numbers so far
    edge_on_visibility: float = given.MIN_VISIBLE_FRACTION  # of the wing's length, that the edge-on aircraft shows
    heading_observed: bool = False  # points have distinguished the nose from the tail
    keypoint_bias: float = 0.0  # of the length that shows the nose, one standard deviation
    metric: bool = False  # ranges are those of poses, and not of a leader of some size
    unseen: float = 0.0  # s, since the last image that corrected them
    startup_evidence: float = 0.0  # images whose evidence of a new track is not used yet
    misfits: tuple[str, ...] = ()  # named points of the last image that fitted no heading
    mean_nis: float = 1.0  # mean NIS per component of the last seconds, by the particles' own uncertainties
    biases: tuple[Bias, ...] = ()

    def column(self, name: str) -> int:
        """Return the column of a bias in the state."""
        return N + [bias.name for bias in self.biases].index(name)

    def with_biases(self, *biases: Bias) -> "Particles":
        """With those of them that it has not yet.

        Nothing is known of a new one but its standard deviation."""
        known = {bias.name for bias in self.biases}
        new = tuple(bias for bias in biases if bias.name not in known)
        if not new:
            return self
        wider = ((0, 0), (0, len(new)))
        means, P = np.pad(self.means, wider), np.pad(self.covariances, (*wider, wider[1]))
        at = np.arange(len(new)) + self.means.shape[1]
        P[:, at, at] = np.square([bias.sigma for bias in new])
        return self._replace(means=means, covariances=P, biases=(*self.biases, *new))


def weighted(particles: Particles, log_l: Array) -> Particles:
    """The particles with each particle's weight times a likelihood, of which these are the logarithms (K,)."""
    log_weights = particles.log_weights + log_l
    normalise(log_weights)
    return particles._replace(log_weights=log_weights)


@kernel(**FILLING)
def largest(numbers):
    """Return the largest of numbers (K,)."""
    found = -np.inf
    for number in numbers:
        found = max(found, number)
    return found


@kernel((HEADINGS, NUMBER), **MAKING)
def evidence(log_l, believed):
    """The logarithms of likelihoods (K,) as far as they are `believed`, from 0 to 1."""
    return believed * np.maximum(log_l, largest(log_l) - given.MAX_LOG_LIKELIHOOD_RATIO)


@kernel((HEADINGS,), **FILLING)
def normalise(log_weights):
    """Make the sum of weights 1, of which these are the logarithms (K,), in place."""
    most, total = largest(log_weights), 0.0
    for k in range(log_weights.shape[0]):
        total += np.exp(log_weights[k] - most)
    most += np.log(total)
    for k in range(log_weights.shape[0]):
        log_weights[k] -= most


def fitting(settings: LeaderModel, particles: Particles) -> Particles:
    """The particles with as many particles as there should be, drawn anew where few have the weight."""
    w = np.exp(particles.log_weights)
    count = enough(settings, particles, w)
    is_apt = len(w) / given.COUNT_CHANGE_FACTOR < count < len(w) * given.COUNT_CHANGE_FACTOR
    if 1.0 / float(np.add.reduce(w * w)) > settings.resample * len(w) and is_apt:
        return particles
    return resampled(particles, count)


def enough(settings: LeaderModel, particles: Particles, w: Array) -> int:
    """Return how many particles there should be.

    It is in proportion to the different headings and ranges that have weight, as in KLD-sampling (Fox, 2003).
    Where points show the heading, the right headings are few degrees wide: what follows a heading that turns must
    be dense there."""
    turn, fewest = (math.tau, settings.fewest_sided) if particles.heading_observed else (math.pi, settings.fewest)
    sizes = given.HEADING_BIN, given.RANGE_BIN, given.MIN_BIN_WEIGHT
    bins = int(occupied(particles.headings, particles.means, w, turn, *sizes))
    return min(max(given.PARTICLES_PER_BIN * bins, fewest), settings.particles)


def resampled(particles: Particles, k: int) -> Particles:
    """k particles, drawn by their weights, which become alike: systematic resampling."""
    at = (np.arange(k) + uniform(particles.draws, 1)[0]) / k
    chosen = np.minimum(np.searchsorted(np.cumsum(np.exp(particles.log_weights)), at), len(particles.headings) - 1)
    arrays: dict[str, Any] = {name: getattr(particles, name)[chosen] for name in Particles._fields[:ARRAY_COUNT]}
    log_weights = np.full(k, -math.log(k))
    return particles._replace(**arrays, log_weights=log_weights, draws=particles.draws + 1)


@kernel((VECTOR, VECTOR, ROWS, VECTOR, NUMBER), **FILLING)
def seen_together(w, nis, means, v_F, gate):
    """Return the mean NIS of an image, and the rate at which the view changes.

    Of particles with weights w (K,), means (K, W) and these NIS (K,) of an image: the mean NIS, each `gate` at
    most, and how fast the view of the leader changes, 1/s, as we fly at v_F (3,) m/s."""
    off, x, y, z = 0.0, 0.0, 0.0, 0.0
    for k in range(w.shape[0]):
        off += w[k] * min(nis[k], gate)
        r = means[k]
        share = w[k] / np.sqrt(r[RX] * r[RX] + r[RY] * r[RY] + r[RZ] * r[RZ])
        x += share * (r[VX] - v_F[0])
        y += share * (r[VY] - v_F[1])
        z += share * (r[VZ] - v_F[2])
    return off, np.sqrt(x * x + y * y + z * z)


@kernel((VECTOR, ROWS, VECTOR, NUMBER, NUMBER, NUMBER, NUMBER), **MAKING)
def occupied(headings, means, w, turn, heading_bin, range_bin, least):
    """Count the bins of headings and ranges that have weight.

    Bins of headings (K,), which repeat after `turn`, and of logarithms of the means' ranges (K, W) have at least
    so much of the weights w (K,)."""
    size, nothing, last = 1, np.int64(-(1 << 62)), 1e15  # what is no number is in the last bin
    while size < 2 * w.shape[0]:  # so much room that few keys meet
        size *= 2
    keys, weights = np.full(size, nothing), np.zeros(size)
    for k in range(w.shape[0]):
        x = means[k]
        log_range = 0.5 * np.log(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])
        bin_ = np.floor(headings[k] % turn / heading_bin) + 1000.0 * np.floor(log_range / range_bin)
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
