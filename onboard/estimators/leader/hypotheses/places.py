"""The places where a leader may be: the modes of particles along its line of sight.

A mean with its covariance cannot say "at 12 m or at 25 m". Where the range is open, the modes can.
"""

import math
from collections.abc import Callable
from typing import Any, Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.compiled import INT, MAKING, VECTOR, kernel
from onboard.estimators.leader import assumptions as given

SMOOTHING_WEIGHTS: Final = np.exp(-0.5 * (np.arange(-8, 9) / given.DENSITY_SMOOTHING_WIDTH) ** 2)


class Place(NamedTuple):
    """A mode: its share of the probability, and mean (6,) and covariance (6, 6) of r_FL_n in m and v_L in m/s."""

    weight: float
    mean: Array
    covariance: Array

    def after(self, dt: float, moved: Array) -> "Place":
        """`dt` seconds later, at constant velocity; we have moved by `moved` (3,) m, in n."""
        if dt <= 0.0:
            return self
        F = np.eye(6)
        F[:3, 3:] = dt * np.eye(3)
        mean = F @ self.mean
        mean[:3] -= moved
        return Place(self.weight, mean, F @ self.covariance @ F.T)

    def relative_to(self, v_F_n: Array) -> "Place":
        """With the velocity relative to ours (3,), in n."""
        mean = self.mean.copy()
        mean[3:] -= v_F_n
        return self._replace(mean=mean)


class OpenQuestion(NamedTuple):
    """An ambiguity that the images leave."""

    reason: str = ""  # for a person; "" if nothing is open
    places: tuple[Place, ...] = ()  # where the leader may be, if the range is open
    is_misfit: bool = False  # the images of the last seconds fit no hypothesis


def places(w: Array, means: Array, covariances: Array, ours: Callable[[Array], Array]) -> tuple[Place, ...]:
    """The modes, nearest first, of particles with weights w (K,), means (K, 6) and covariances (K, 6, 6).
    `ours` gives the covariance (6, 6) of errors that all particles share, of a leader at r_FL_n (3,)."""
    log_range = np.log(np.linalg.norm(means[:, :3], axis=1))
    found = []
    for part in _split_by_valleys(log_range, w):
        weight = float(w[part].sum())
        share = w[part] / weight
        mean = share @ means[part]
        off = means[part] - mean
        spread = (off * share[:, None]).T @ off + np.tensordot(share, covariances[part], 1)
        found.append(Place(weight, mean, spread + ours(mean[:3])))
    return tuple(found)


def _split_by_valleys(x: Array, w: Array) -> list[Array]:
    """Masks (K,) of the groups of numbers x (K,) with weights w (K,) that valleys of their density keep apart."""
    first, last = math.floor(x.min() / given.LOG_RANGE_BIN_WIDTH), math.floor(x.max() / given.LOG_RANGE_BIN_WIDTH)
    bins = np.clip(np.floor(x / given.LOG_RANGE_BIN_WIDTH).astype(int) - first, 0, last - first)
    density = np.convolve(np.bincount(bins, w, last - first + 1), SMOOTHING_WEIGHTS)[8:-8]
    groups = _merge_small_groups(_split(density, 0, len(density)), np.bincount(bins, w))
    return [(bins >= a) & (bins < b) for a, b in groups]


def _split(density: Array, begin: int, end: int) -> list[tuple[int, int]]:
    """The ranges of bins, from `begin` to `end`, between which there are valleys."""
    at = _valley(density, begin, end)
    return [(begin, end)] if at < 0 else _split(density, begin, at) + _split(density, at, end)


@kernel((VECTOR, INT, INT), **MAKING)
def _valley(density, begin, end):
    """Return the deepest valley of a density from `begin` to `end`; -1 if it has one peak."""
    best, at, left = given.MAX_VALLEY_RATIO, -1, 0.0
    right = np.empty(end - begin)  # the highest from each bin on
    highest = 0.0
    for i in range(end - begin - 1, -1, -1):
        highest = right[i] = max(highest, density[begin + i])
    for i in range(end - begin - 1):
        left = max(left, density[begin + i])
        share = density[begin + i] / max(min(left, right[i]), 1e-300)
        if i > 0 and share < best:
            best, at = share, begin + i
    return at


def _merge_small_groups(groups: list[tuple[int, int]], weight: Any) -> list[tuple[int, int]]:
    """The groups of bins without those of little weight, which join a neighbour."""
    kept: list[tuple[int, int]] = []
    for begin, end in groups:
        small = weight[begin:end].sum() < given.MIN_PLACE_WEIGHT
        if kept and (small or weight[kept[-1][0] : kept[-1][1]].sum() < given.MIN_PLACE_WEIGHT):
            kept[-1] = kept[-1][0], end
        else:
            kept.append((begin, end))
    return kept
