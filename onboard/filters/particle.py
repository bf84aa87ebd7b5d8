"""Particle filter (Gordon, Salmond & Smith 1993): weighted samples of the state.

    state = start(mean, covariance, particles=2000, seed=1)
    state = predict(state, process, Q)
    found = update(state, y, measure, R, angular)     # found.belief: a Cloud again; found.log_evidence
    found = run("particle", model, Belief(mean, covariance), ys)   # smooth_particles(found)

It neither linearises nor assumes a Gaussian, so it follows several hypotheses at once. If a measurement is much
sharper than the prediction, only a few particles would count, and the next cloud would be copies of them. So a
measurement is applied in parts, each of which leaves half of the particles counting (progressive correction:
Oudjane & Musso 2000), and each resampling (systematic: Kitagawa 1996) spreads the copies by a kernel that keeps
the cloud's mean and covariance (Musso, Oudjane & Le Gland 2001; shrunk as by Liu & West 2001).

No particle is near a measurement beyond the cloud, such as an outlier. If a regression explains the measurement,
as of a line, the cloud is moved and shrunk as a whole, as the members of an ensemble Kalman filter are
(`ensemble`), and gets the mean and covariance of a Kalman filter. Otherwise, as for a range from the cloud's
middle, the particles walk towards it, part by part (Del Moral, Doucet & Jasra 2006), as if the cloud had been a
Gaussian: beyond it nothing else is known. A measurement is beyond the cloud if its NIS is above what one of N
particles would have by chance, and for a line also its squared distance from the nearest particle in units of R.

Limits: the kernel is as wide as a third of the whole cloud, so modes that are sharp and far apart are smeared; use
`bandwidth` 0.1, or 0 for the plain bootstrap filter, which needs noise in every state. More than some six states
need too many particles. 500 of them follow a measurement that is 1000 times as sharp as the cloud, if it is within
two deviations of the mean. R must be positive definite.

Random numbers are a function of the seed and of how often they were drawn: the same run gives the same bits.
"""

from typing import Any, Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.filters.angles import beside
from onboard.filters.belief import Belief, Indices, Method, Rows, Update, images_of, mask
from onboard.filters.belief import start as checked
from onboard.filters.errors import FilterError, NotPositiveDefiniteError, require_plain
from onboard.filters.gating import chi_square_threshold

DEFAULT_PARTICLES: Final = 1000
MIN_EFFECTIVE_FRACTION: Final = 0.5  # of the particles, after a part of a measurement
MAX_PART_COUNT: Final = 100  # The last part of a measurement is the whole rest.
BISECTION_STEPS: Final = 60  # in the search of a part's share
RESAMPLING_FRACTION: Final = 0.7  # Fewer effective particles are resampled.
MAX_REGRESSION_ERROR: Final = 0.1  # of a linear measurement, squared, in units of R
MAX_NONLINEAR_FRACTION: Final = 0.01  # of the variance of the particles' measurements, of a linear one
WALK_STEPS: Final = (2.0, 0.6, 0.2)  # in standard deviations of the cloud, over the root of n
NEGATIVE_EIGENVALUE_TOLERANCE: Final = 1e-9  # relative to the largest


class Cloud(NamedTuple):
    """The state of a particle filter.

    Attributes
    ----------
    particles : (..., N, n)
        Sampled states.
    log_weights : (..., N)
        Logarithms of their weights, which sum to one.
    seed
        Seed of the random numbers.
    draws
        Number of earlier draws.
    bandwidth
        Width of the resampling kernel, in units of the best one for a Gaussian.
    """

    particles: Array
    log_weights: Array
    seed: int
    draws: int
    bandwidth: float


def start(
    mean: Array, covariance: Array, particles: int = DEFAULT_PARTICLES, seed: int = 0, bandwidth: float = 1.0
) -> Cloud:
    """Return a cloud with exactly this mean and covariance.

    Parameters
    ----------
    mean : (..., n)
        Mean.
    covariance : (..., n, n)
        Covariance.
    particles
        Number of particles N.
    seed
        Seed of the random numbers.
    bandwidth
        Width of the resampling kernel, in units of the best one for a Gaussian.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    NotPositiveDefiniteError
        If a covariance is not positive definite, or not finite.
    """
    checked(mean, covariance)
    n = mean.shape[-1]
    if particles <= n or not 0 <= bandwidth <= 2:
        raise FilterError(f"particles {particles}, bandwidth {bandwidth}: must be above {n}, and from 0 to 2")
    z = _rng(seed, 0).standard_normal((*mean.shape[:-1], particles, n))
    z -= z.mean(axis=-2, keepdims=True)
    z = _t(np.linalg.solve(np.linalg.cholesky(_t(z) @ z / particles), _t(z)))
    cloud = mean[..., None, :] + z @ _t(_root("covariance", covariance))
    return Cloud(cloud, np.full(cloud.shape[:-1], -np.log(particles)), seed, 1, bandwidth)


def predict(state: Cloud, process: Rows, Q: Array, angular_states: Indices = ()) -> Cloud:
    """Time update.

    Parameters
    ----------
    process, Q, angular_states
        As in `unscented.predict`.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    NotPositiveDefiniteError
        If a covariance is not positive definite, or not finite.
    """
    n = state.particles.shape[-1]
    _require("Q", Q, (n, n))
    mask(angular_states, n)
    moved = images_of(process, state.particles, None)
    if not np.isfinite(moved).all():
        raise FilterError("process: gave states that are not finite")
    noise = _rng(state.seed, state.draws).standard_normal(moved.shape) @ _t(_root("Q", Q))
    noise -= _mean(noise, state.log_weights)[..., None, :]
    particles = beside(moved, moved[..., :1, :], angular_states) + noise
    return state._replace(particles=particles, draws=state.draws + 1)


def update(
    state: Cloud, y: Array, measure: Rows, R: Array, angular: Indices = (), angular_states: Indices = ()
) -> Update:
    """Measurement update.

    Innovation, its covariance and NIS are of the cloud's mean and covariance; `log_evidence` is the cloud's own.

    Parameters
    ----------
    y, measure, R, angular, angular_states
        As in `unscented.update`; R must be positive definite.

    Raises
    ------
    FilterError
        If an argument cannot be used; the message says which one and why.
    NotPositiveDefiniteError
        If a covariance is not positive definite, or not finite.
    """
    lead, (count, n) = state.particles.shape[:-2], state.particles.shape[-2:]
    _require("y", y, ())
    m = y.shape[-1] if y.ndim else 0
    _require("R", R, (m, m))
    if y.shape[:-1] != lead or y.ndim < 1:
        raise FilterError(f"y: must be {(*lead, 'm')} for particles {state.particles.shape}, not {y.shape}")
    mask(angular, m)
    x = beside(state.particles, state.particles[..., :1, :], angular_states).reshape(-1, count, n).astype(float)
    log_w, rows = state.log_weights.reshape(-1, count).astype(float), y.reshape(-1, m).astype(float)
    noise = np.broadcast_to(R, (*lead, m, m)).reshape(-1, m, m).astype(float)
    root = _factor(noise)
    rng, bandwidth, parts = _rng(state.seed, state.draws, stream=1), state.bandwidth, 0
    seen = Measured(measure, rows, angular, root)
    off = seen.off(x)
    innovation, spread = _moments(off, log_w)
    S = spread + noise
    nis = np.sum(innovation * np.linalg.solve(S, innovation[..., None])[..., 0], axis=-1)
    is_outlier, is_beyond = _beyond(off, root, nis)
    is_line = is_outlier.copy()
    if is_outlier.any():
        moved = _moved(x, log_w, off, S, root)
        is_line &= _is_explained((x, moved), log_w, (off, seen.off(moved)), root)
        x = np.where((is_beyond & is_line)[:, None, None], moved, x)
    left = np.where(is_beyond & is_line, 0.0, 1.0)
    evidence = np.where(left == 0.0, -0.5 * (nis + np.linalg.slogdet(2 * np.pi * S)[1]), 0.0)
    prior, walks = _moments(x, log_w), is_outlier & ~is_line
    while (open_ := np.flatnonzero(left > 0)).size:
        # Of all members: the function may depend on the order of the rows.
        off = off if parts == 0 else seen.off(x)
        fit, parts = _log_density(off[open_], root[open_]), parts + 1
        share = _share(log_w[open_], fit, left[open_]) if parts < MAX_PART_COUNT else left[open_]
        joint = log_w[open_] + share[:, None] * fit
        gained = np.logaddexp.reduce(joint, axis=-1)
        log_w[open_], evidence[open_] = joint - gained[:, None], evidence[open_] + gained
        left[open_] = np.where(share < left[open_], left[open_] - share, 0.0)
        for b in open_:
            if left[b] > 0 or walks[b] or effective(log_w[b]) < RESAMPLING_FRACTION * count:
                x[b], log_w[b] = _resampled(x[b], log_w[b], rng, 0.0 if walks[b] else bandwidth), -np.log(count)
        _walk(x, open_[walks[open_]], prior, 1.0 - left, seen, rng)
    after = Cloud(x.reshape(*lead, count, n), log_w.reshape(*lead, count), *state[2:])
    shown = innovation.reshape(y.shape)
    covariance = S.reshape(*lead, m, m)
    each: Any = nis.reshape(lead) if lead else float(nis[0])
    after = after._replace(draws=state.draws + 1)
    return Update(after, shown, covariance, y - shown, each, log_evidence=evidence.reshape(lead))


def belief(state: Cloud) -> Belief:
    """Return mean (..., n) and covariance (..., n, n) of a cloud."""
    mean, covariance = _moments(state.particles.astype(float), state.log_weights.astype(float))
    return Belief(mean, covariance)


def effective(log_weights: Array) -> Array:
    """Return the effective number of particles (...,), from logarithms of weights (..., N).

    The weights may have any sum. It is their squared sum over the sum of their squares.
    """
    weights = np.exp(log_weights - log_weights.max(axis=-1, keepdims=True))
    return np.asarray(np.sum(weights, axis=-1) ** 2 / np.sum(weights * weights, axis=-1))


class Measured(NamedTuple):
    """A measurement of a batch of clouds.

    Attributes
    ----------
    measure
        Measurement function.
    y : (B, m)
        Measured values.
    angular
        Components of y that are angles.
    root : (B, m, m)
        Factor of the noise covariance.
    """

    measure: Rows
    y: Array
    angular: Indices
    root: Array

    def off(self, x: Array) -> Array:
        """Return y minus the measurements of particles (B, N, n), (B, N, m)."""
        images = images_of(self.measure, x[:], self.y)  # a view: what the function sees is read-only
        if not np.isfinite(images).all() or not np.isfinite(self.y).all():
            raise FilterError("measure or y: not finite")
        off = self.y[:, None, :] - images
        return beside(off, np.zeros_like(off), self.angular)


def _log_density(off: Array, root: Array) -> Array:
    """Return the log-density of differences (B, N, m).

    The factor (B, m, m) is that of their covariance.
    """
    white = np.linalg.solve(root, _t(off))
    constant = np.sum(np.log(np.diagonal(root, axis1=-2, axis2=-1)), axis=-1) + 0.5 * np.log(2 * np.pi) * len(
        root[0]
    )
    return np.asarray(-0.5 * np.sum(white * white, axis=-2) - constant[:, None])


def _share(log_w: Array, fit: Array, left: Array) -> Array:
    """Return the share (B,) of a measurement's rest that leaves enough particles counting."""
    low, high = np.zeros_like(left), left.copy()
    for k in range(BISECTION_STEPS):
        at = high if k == 0 else 0.5 * (low + high)
        enough = effective(log_w + at[:, None] * fit) >= MIN_EFFECTIVE_FRACTION * log_w.shape[-1]
        low, high = np.where(enough, at, low), np.where(enough, high, at)
        if (high - low <= 0.01 * low).all():
            break
    return np.where(low > 0.99 * left, left, np.maximum(low, left * 0.5**BISECTION_STEPS))


def _beyond(off: Array, root: Array, nis: Array) -> tuple[Any, Any]:
    """Return which of a batch is measured beyond the cloud, and which beyond all particles.

    Both are (B,). The first is by its NIS (B,), the second by the particles' differences `off` (B, N, m) and the
    factor of R.
    """
    count, m = off.shape[-2:]
    if not m:
        return np.zeros(len(off), bool), np.zeros(len(off), bool)
    farthest = chi_square_threshold(1 - 1 / count, m)
    is_outlier = nis > farthest
    return is_outlier, is_outlier & (_squares(off, root).min(axis=-1) > farthest)


def _squares(off: Array, root: Array) -> Array:
    """Return squared differences (B, N) of (B, N, m), by the factor of their covariance."""
    return np.asarray(np.sum(np.linalg.solve(root, _t(off)) ** 2, axis=-2))


def _is_explained(x: tuple[Array, Array], log_w: Array, off: tuple[Array, Array], root: Array) -> Any:
    """Return which of a batch (B,) has a measurement that is practically linear.

    Over particles `x[0]` with these weights the measurement is nearly its regression, and also where they were
    moved to, `x[1]`, within a fraction of R. `off`: differences of y from both.
    """
    mean, middle = (_mean(rows, log_w)[..., None, :] for rows in (x[0], off[0]))
    weighted = np.exp(log_w)[..., None] * (x[0] - mean)
    slope = np.linalg.pinv(_t(weighted) @ (x[0] - mean), hermitian=True) @ (_t(weighted) @ (off[0] - middle))

    def squares(off: Array, x: Array) -> Array:
        return np.asarray(np.sum(np.exp(log_w) * _squares(off - middle - (x - mean) @ slope, root), axis=-1))

    is_line = squares(off[0], x[0]) <= MAX_NONLINEAR_FRACTION * squares(off[0], np.zeros_like(x[0]) + mean)
    return is_line & (squares(off[1], x[1]) < MAX_REGRESSION_ERROR * root.shape[-1])


def _walk(
    x: Array, walking: Any, prior: tuple[Array, Array], shares: Array, seen: Measured, rng: np.random.Generator
) -> None:
    """Move the particles of `walking` members in place by Metropolis steps (1953).

    They keep the distribution of a Gaussian `prior`, its mean and covariance, after this share of the measurement.
    """
    if not len(walking):
        return
    count, n = x.shape[1:]
    information = np.linalg.pinv(prior[1], hermitian=True)

    def log_density(rows: Array, off: Array) -> Array:
        X = rows - prior[0][:, None, :]
        return np.asarray(
            -0.5 * (np.sum(X @ information * X, axis=-1) + shares[:, None] * _squares(off, seen.root))
        )

    now = log_density(x, seen.off(x))
    for length in WALK_STEPS:
        tried = x.copy()
        for b in walking:
            spread = _moments(x[b], np.full(count, -np.log(count)))[1]
            tried[b] += length / np.sqrt(n) * rng.standard_normal((count, n)) @ _t(_root("covariance", spread))
        then = log_density(tried, seen.off(tried))
        for b in walking:
            is_taken = np.log(rng.random(count)) < then[b] - now[b]
            x[b], now[b] = np.where(is_taken[:, None], tried[b], x[b]), np.where(is_taken, then[b], now[b])


def _moved(x: Array, log_w: Array, off: Array, S: Array, root: Array) -> Array:
    """Return particles (B, N, n) moved to the mean and covariance of a Kalman filter.

    By the regression of the measurement over them: the gain of Andrews (1968) for the deviations, as in
    `ensemble.update`.
    """
    w, mean, error = np.exp(log_w)[..., None], _mean(x, log_w)[..., None, :], _mean(off, log_w)[..., None, :]
    X, Y = x - mean, error - off
    L = np.linalg.cholesky(S)
    scaled = np.linalg.solve(L, _t(Y) @ (w * X))
    mean = mean + np.linalg.solve(L, _t(error)).swapaxes(-1, -2) @ scaled
    return np.asarray(mean + X - Y @ np.linalg.solve(_t(L + root), scaled))


def _resampled(x: Array, log_w: Array, rng: np.random.Generator, bandwidth: float) -> Array:
    """Return particles (N, n) of equal weight, with mean and covariance of the weighted ones."""
    count, n = x.shape
    upto = np.cumsum(np.exp(log_w))
    copies: Array = x[np.searchsorted(upto / upto[-1], (rng.random() + np.arange(count)) / count)]
    h = min(bandwidth * (4 / (n + 2)) ** (1 / (n + 4)) * count ** (-1 / (n + 4)), 1.0)
    if not h:
        return copies
    mean, covariance = _moments(x, log_w)
    noise = rng.standard_normal(x.shape) @ _t(_root("covariance", covariance))
    return np.asarray(mean + np.sqrt(1 - h * h) * (copies - mean) + h * noise)


def _rng(seed: int, draws: int, stream: int = 0) -> np.random.Generator:
    return np.random.Generator(np.random.Philox(key=[seed, draws], counter=[0, 0, 0, stream]))


def _mean(rows: Array, log_w: Array) -> Array:
    return np.asarray(np.sum(np.exp(log_w.astype(float))[..., None] * rows, axis=-2))


def _moments(rows: Array, log_w: Array) -> tuple[Array, Array]:
    """Return mean (..., m) and covariance (..., m, m) of weighted rows (..., N, m)."""
    mean = _mean(rows, log_w)
    off = rows - mean[..., None, :]
    covariance = _t(off) @ (np.exp(log_w)[..., None] * off)
    return mean, np.asarray(0.5 * (covariance + _t(covariance)))


def _require(name: str, array: Array, shape: tuple[int, ...]) -> None:
    require_plain(**{name: array})
    if array.dtype != np.float64 or array.shape[-2:][: len(shape)] != shape:
        raise FilterError(f"{name}: must be {shape or '(..., m)'} of float64, not {array.shape} of {array.dtype}")


def _root(name: str, covariance: Array) -> Array:
    """Return a root A (..., n, n) of a covariance A A^T, which may be singular."""
    P = covariance.astype(float)
    variances = np.diagonal(P, axis1=-2, axis2=-1)
    if not np.isfinite(P).all() or np.any(variances < 0):
        raise NotPositiveDefiniteError(f"{name}: not finite, or not positive semi-definite")
    scale = np.sqrt(np.where(variances > 0, variances, 1.0))
    values, vectors = np.linalg.eigh(P / (scale[..., :, None] * scale[..., None, :]))
    if np.any(values[..., 0] < -NEGATIVE_EIGENVALUE_TOLERANCE * np.abs(values).max(axis=-1)):
        raise NotPositiveDefiniteError(f"{name}: not positive semi-definite")
    return np.asarray(scale[..., :, None] * vectors * np.sqrt(np.maximum(values, 0))[..., None, :])


def _factor(R: Array) -> Array:
    try:
        return np.asarray(np.linalg.cholesky(R))
    except np.linalg.LinAlgError as error:
        raise NotPositiveDefiniteError("R: must be positive definite for a particle filter") from error


def _t(A: Array) -> Array:
    return np.swapaxes(A, -1, -2)


# `run` finds it by its name. It is not in METHODS, because its estimates are right on average over the particles,
# and not to the last digit.
METHOD: Final = Method(
    "particle",
    start,
    predict,
    update,
    belief,
    exempt={"kalman": "it draws its particles: what it estimates is right on average over them"},
)
