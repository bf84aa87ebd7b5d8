"""Smoothing of a particle filter's run by whole paths, drawn backwards.

    found = run("particle", model, start, ys)
    paths = smooth_particles(found, 500, seed=1)     # (T, ..., 500, n), all of equal weight
    paths.mean(axis=-2)                              # the smoothed mean (T, ..., n)

A path ends at a particle of the last cloud. Going back, it takes a particle of each cloud with a probability
proportional to its weight times the density of the process's transition to the path's next state (Godsill, Doucet
& West 2004). That density needs noise in every state: Q must be positive definite. The work is proportional to
particles times paths.
"""

from typing import Any

import numpy as np

from onboard.arrays import Array
from onboard.filters.angles import beside
from onboard.filters.belief import FilterError, NotPositiveDefiniteError, images_of
from onboard.filters.particle import Cloud
from onboard.filters.runs import Run

DEFAULT_PATH_COUNT = 500


def smooth_particles(found: Run, paths: int = DEFAULT_PATH_COUNT, seed: int = 0) -> Array:
    """Return paths through the whole record of a particle filter's run.

    Parameters
    ----------
    found
        A run of the filter "particle".
    paths
        Number of paths.
    seed
        Seed of the random numbers.

    Returns
    -------
    Array
        Paths (T, ..., paths, n), all of equal weight.

    Raises
    ------
    FilterError
        For a run of another filter.
    NotPositiveDefiniteError
        If Q is not positive definite.
    """
    if not isinstance(found.states[0], Cloud):
        raise FilterError(f"smooth_particles: {found.method.name} has no particles; `smooth` smooths it")
    if paths < 1:
        raise FilterError(f"paths: must be at least 1, not {paths}")
    rng, steps = np.random.Generator(np.random.Philox(key=[seed, 0])), len(found.ts)
    last = found.states[-1]
    lead, n = last.particles.shape[:-2], last.particles.shape[-1]
    drawn = [_chosen(last.particles, _repeated(last.log_weights, paths), rng)]
    for k in range(steps - 2, -1, -1):
        cloud, later = found.states[k], drawn[-1]
        if found.ts[k + 1] == found.ts[k]:  # nothing moves where a time repeats
            drawn.append(later)
            continue
        model = found.at(k + 1)
        moved = images_of(model.process, cloud.particles, None)
        off = later[..., :, None, :] - moved[..., None, :, :]  # (..., paths, N, n)
        off = beside(off, np.zeros_like(off), model.angular_states)
        white = np.linalg.solve(_factor(model.Q), off.reshape(*lead, -1, n).swapaxes(-1, -2))
        fit = -0.5 * np.sum(white * white, axis=-2).reshape(off.shape[:-1])
        drawn.append(_chosen(cloud.particles, cloud.log_weights[..., None, :] + fit, rng))
    return np.stack(drawn[::-1])


def _repeated(log_weights: Array, paths: int) -> Array:
    return np.repeat(log_weights[..., None, :], paths, axis=-2)


def _chosen(particles: Array, log_weights: Array, rng: np.random.Generator) -> Array:
    """Return one of the particles (..., N, n) for each row of weights (..., paths, N)."""
    weights = np.exp(log_weights - log_weights.max(axis=-1, keepdims=True)).cumsum(axis=-1)
    at = rng.random(weights.shape[:-1])[..., None] * weights[..., -1:]
    index: Any = np.sum(weights < at, axis=-1)
    return np.take_along_axis(particles, index[..., None], axis=-2)


def _factor(Q: Array) -> Array:
    try:
        return np.asarray(np.linalg.cholesky(Q))
    except np.linalg.LinAlgError as error:
        raise NotPositiveDefiniteError("Q: must be positive definite to smooth particles") from error
