"""The cells of a nose mixture: one with an uncertain nose is split, those that agree are merged."""

import math
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.estimators.leader.settings import NoseModel
from onboard.models import apparent_wing as model
from onboard.models.apparent_wing import NOSE

SPLIT_WEIGHT: Final = 0.01  # a lighter cell is not split
NARROW: Final = 0.6  # of the nose's deviation: that of each of the three parts of a cell that is split


class Mixture(NamedTuple):
    """K cells with M manoeuvres each: means (K, M, N), covariances (K, M, N, N), probabilities of the manoeuvres
    (K, M), logarithms of the cells' weights (K,); and the `axes` (3, 3) in n of all their directions."""

    means: Array
    covariances: Array
    manoeuvres: Array
    log_weights: Array
    axes: Array


def _cells(mixture: Mixture) -> tuple[Array, Array]:
    """Means (K, N) and covariances (K, N, N) of the cells over their manoeuvres."""
    share = mixture.manoeuvres[:, :, None]
    mean = np.sum(share * mixture.means, 1)
    off = mixture.means - mean[:, None]
    return mean, np.sum(share[..., None] * mixture.covariances, 1) + np.swapaxes(share * off, 1, 2) @ off


def tidy(settings: NoseModel, mixture: Mixture) -> Mixture:
    """The mixture with cells of uncertain nose split, and cells that agree merged."""
    return _merged(settings, _split(settings, mixture))


def _split(settings: NoseModel, mixture: Mixture) -> Mixture:
    """Each cell with an uncertain nose in three, along what its nose is correlated with."""
    variance = _cells(mixture)[1][:, NOSE, NOSE]
    wide = (variance > settings.split**2) & (mixture.log_weights > math.log(SPLIT_WEIGHT))
    if not wide.any():
        return mixture
    means, P, manoeuvres, log_weights, axes = mixture
    along = P[wide][..., NOSE] / np.sqrt(P[wide][..., NOSE, NOSE])[..., None]  # (wide, M, N), for one sigma
    offset = math.sqrt(1.5 * (1.0 - NARROW**2)) * along  # three alike, at -1, 0 and 1 of it: the variance stays
    narrow = P[wide] - (1.0 - NARROW**2) * along[..., :, None] * along[..., None, :]
    parts = [means[wide] + side * offset for side in (-1.0, 0.0, 1.0)]
    third = log_weights[wide] - math.log(3.0)
    return Mixture(
        np.concatenate([means[~wide], *parts]),
        np.concatenate([P[~wide], narrow, narrow, narrow]),
        np.concatenate([manoeuvres[~wide], *[manoeuvres[wide]] * 3]),
        np.concatenate([log_weights[~wide], third, third, third]),
        axes,
    )


def _merged(settings: NoseModel, mixture: Mixture) -> Mixture:
    """The mixture with cells that agree in nose and range as one, and no more cells than there may be."""
    while (count := len(mixture.log_weights)) > 1:
        mean, P = _cells(mixture)
        log_range = 0.5 * np.log(np.sum(model.positions(mean, mixture.axes) ** 2, -1))
        sigma = np.sqrt(P[:, NOSE, NOSE])
        off = mean[:, None, NOSE] - mean[:, NOSE]
        off -= math.pi * np.round(off / math.pi)
        apart = (off / np.maximum(np.minimum.outer(sigma, sigma), settings.same_nose)) ** 2
        apart += ((log_range[:, None] - log_range) / settings.same_range) ** 2
        apart[np.arange(count), np.arange(count)] = math.inf
        a, b = divmod(int(np.argmin(apart)), count)
        if apart[a, b] > 1.0 and count <= settings.most_cells:
            break
        mixture = _merge(
            mixture, min(a, b), max(a, b), round((mean[max(a, b), NOSE] - mean[min(a, b), NOSE]) / math.pi)
        )
    return mixture


def _merge(mixture: Mixture, a: int, b: int, half_turns: int) -> Mixture:
    """Cell b merged into cell a; their noses differ by so many half turns."""
    means, P, manoeuvres, log_weights, axes = mixture
    other = means[b].copy()
    other[:, NOSE] -= half_turns * math.pi
    of_a = math.exp(log_weights[a]) * manoeuvres[a]
    of_b = math.exp(log_weights[b]) * manoeuvres[b]
    both = of_a + of_b
    share_a, share_b = (of_a / both)[:, None], (of_b / both)[:, None]
    mean = share_a * means[a] + share_b * other
    off_a, off_b = means[a] - mean, other - mean
    spread = share_a[..., None] * (P[a] + off_a[:, :, None] * off_a[:, None, :])
    spread += share_b[..., None] * (P[b] + off_b[:, :, None] * off_b[:, None, :])
    kept = np.arange(len(log_weights)) != b
    merged = Mixture(means[kept], P[kept], manoeuvres[kept], log_weights[kept], axes)
    merged.means[a], merged.covariances[a], merged.manoeuvres[a] = mean, spread, both / both.sum()
    merged.log_weights[a] = math.log(both.sum())
    return merged
