"""The particle filter (Gordon, Salmond & Smith 1993): a cloud of states, weighed by what is measured.

    state = start(mean, covariance, particles=2000, seed=1)
    state = predict(state, process, Q)
    found = update(state, y, measure, R, angular)     # found.belief: a Cloud again; found.log_evidence
    found = run("particle", model, Belief(mean, covariance), ys)   # smooth_particles(found)

It has no line and no Gaussian, so it follows several hypotheses at once. Where a measurement is much sharper than
the prediction only a few particles would count, and the next cloud would be copies of them. So a measurement is
taken in parts, each of which leaves half of the particles counting (progressive correction: Oudjane & Musso 2000),
and each resampling (systematic: Kitagawa 1996) spreads the copies by a kernel that keeps the cloud's mean and
covariance (Musso, Oudjane & Le Gland 2001; shrunk as by Liu & West 2001).

Of a measurement beyond the cloud, as an outlier is, no particle says anything: the nearest only seem to. Where
its regression explains it, as of a line, the cloud is moved and shrunk as a whole, as the members of an ensemble
Kalman filter are (`ensemble`), and has the mean and covariance of a Kalman filter. Where it does not, as a range
from the cloud's middle, the particles walk towards it, part by part (Del Moral, Doucet & Jasra 2006), as if the
cloud had been a Gaussian: beyond it nothing else is known. A measurement is beyond where its NIS is above what one
of N particles would have by chance, and for a line its squared distance from the nearest one in units of R, too.

Where it is wrong: the kernel is as wide as a third of the whole cloud. Modes that are sharp and far apart are
smeared; take `bandwidth` 0.1, or 0 for the plain bootstrap filter, which needs noise in every state. Beyond some
six states it needs more particles than there is time for. 500 of them follow a measurement that is 1000 times as
sharp as the cloud, if it is within two deviations of the mean. R must be positive definite.

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

PARTICLES: Final = 1000
COUNTING: Final = 0.5  # of the particles, after a part of a measurement
MOST_PARTS: Final = 100  # of a measurement; the last one is all that is left
HALVINGS: Final = 60  # of what is left of a measurement, in search of a part's share
RESAMPLED: Final = 0.7  # below this share of counting particles
EXPLAINED: Final = 0.1  # squared, in units of R: by so much a measurement may be off its regression
CURVED: Final = 0.01  # of what particles measure differently: so much of it may be no line
STEPS: Final = (2.0, 0.6, 0.2)  # of a walk, over the root of n, in deviations of the cloud
TOLERANCE: Final = 1e-9  # of a negative eigenvalue, relative to the largest


class Cloud(NamedTuple):
    """Particles (..., N, n), the logarithms of their weights (..., N), which sum to one; the seed, how often
    random numbers were drawn, and the kernel's width in units of the best one for a Gaussian."""

    particles: Array
    log_weights: Array
    seed: int
    draws: int
    bandwidth: float


def start(
    mean: Array, covariance: Array, particles: int = PARTICLES, seed: int = 0, bandwidth: float = 1.0
) -> Cloud:
    """A cloud of mean (..., n) and covariance (..., n, n), exactly.

    Raises FilterError, NotPositiveDefiniteError.
    """
    checked(mean, covariance)
    n = mean.shape[-1]
    if particles <= n or not 0 <= bandwidth <= 2:
        raise FilterError(f"particles {particles}, bandwidth {bandwidth}: must be above {n}, and from 0 to 2")
    z = _rng(seed, 0).standard_normal((*mean.shape[:-1], particles, n))
    z -= z.mean(axis=-2, keepdims=True)
    z = _t(np.linalg.solve(np.linalg.cholesky(_t(z) @ z / particles), _t(z)))
    cloud = (mean[..., None, :] + z @ _t(_root("covariance", covariance))).astype(mean.dtype)
    return Cloud(cloud, np.full(cloud.shape[:-1], -np.log(particles), mean.dtype), seed, 1, bandwidth)


def predict(state: Cloud, process: Rows, Q: Array, angular_states: Indices = ()) -> Cloud:
    """Time update; `process` maps rows (k, n) -> (k, n), Q (..., n, n); `angular_states` as in `angles`.

    Raises FilterError, NotPositiveDefiniteError.
    """
    n = state.particles.shape[-1]
    _require("Q", Q, (n, n), state.particles.dtype)
    mask(angular_states, n)
    moved = images_of(process, state.particles, None)
    if not np.isfinite(moved).all():
        raise FilterError("process: gave states that are not finite")
    noise = _rng(state.seed, state.draws).standard_normal(moved.shape) @ _t(_root("Q", Q))
    noise -= _mean(noise, state.log_weights)[..., None, :]
    particles = (beside(moved, moved[..., :1, :], angular_states) + noise).astype(moved.dtype)
    return state._replace(particles=particles, draws=state.draws + 1)


def update(
    state: Cloud, y: Array, measure: Rows, R: Array, angular: Indices = (), angular_states: Indices = ()
) -> Update:
    """Measurement update; arguments as in `unscented.update`, R (m, m) positive definite. Innovation, its
    covariance and NIS are of the cloud's mean and covariance; `log_evidence` is the cloud's own.

    Raises FilterError, NotPositiveDefiniteError.
    """
    lead, (count, n), dtype = state.particles.shape[:-2], state.particles.shape[-2:], state.particles.dtype
    _require("y", y, (), dtype)
    m = y.shape[-1] if y.ndim else 0
    _require("R", R, (m, m), dtype)
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
        # of all members: a function may know which rows are whose
        off = off if parts == 0 else seen.off(x)
        fit, parts = _log_density(off[open_], root[open_]), parts + 1
        share = _share(log_w[open_], fit, left[open_]) if parts < MOST_PARTS else left[open_]
        joint = log_w[open_] + share[:, None] * fit
        gained = np.logaddexp.reduce(joint, axis=-1)
        log_w[open_], evidence[open_] = joint - gained[:, None], evidence[open_] + gained
        left[open_] = np.where(share < left[open_], left[open_] - share, 0.0)
        for b in open_:
            if left[b] > 0 or walks[b] or effective(log_w[b]) < RESAMPLED * count:
                x[b], log_w[b] = _resampled(x[b], log_w[b], rng, 0.0 if walks[b] else bandwidth), -np.log(count)
        _walk(x, open_[walks[open_]], prior, 1.0 - left, seen, rng)
    after = Cloud(x.reshape(*lead, count, n).astype(dtype), log_w.reshape(*lead, count).astype(dtype), *state[2:])
    shown = innovation.reshape(y.shape).astype(dtype)
    covariance = S.reshape(*lead, m, m).astype(dtype)
    each: Any = nis.reshape(lead).astype(dtype) if lead else float(nis[0])
    after = after._replace(draws=state.draws + 1)
    return Update(after, shown, covariance, y - shown, each, log_evidence=evidence.reshape(lead))


def belief(state: Cloud) -> Belief:
    """Mean (..., n) and covariance (..., n, n) of a cloud."""
    mean, covariance = _moments(state.particles.astype(float), state.log_weights.astype(float))
    return Belief(mean.astype(state.particles.dtype), covariance.astype(state.particles.dtype))


def effective(log_weights: Array) -> Array:
    """How many particles count (...,), by weights (..., N) of any sum: its square over the sum of squares."""
    weights = np.exp(log_weights - log_weights.max(axis=-1, keepdims=True))
    return np.asarray(np.sum(weights, axis=-1) ** 2 / np.sum(weights * weights, axis=-1))


class Measured(NamedTuple):
    """y (B, m), what it measures, which components are angles, and the factor (B, m, m) of its noise."""

    measure: Rows
    y: Array
    angular: Indices
    root: Array

    def off(self, x: Array) -> Array:
        """What y is off the measurements of particles (B, N, n): (B, N, m)."""
        images = images_of(self.measure, x[:], self.y)  # a view: what the function sees is read-only
        if not np.isfinite(images).all() or not np.isfinite(self.y).all():
            raise FilterError("measure or y: not finite")
        off = self.y[:, None, :] - images
        return beside(off, np.zeros_like(off), self.angular)


def _log_density(off: Array, root: Array) -> Array:
    """Of differences (B, N, m), by the factor (B, m, m) of their covariance."""
    white = np.linalg.solve(root, _t(off))
    constant = np.sum(np.log(np.diagonal(root, axis1=-2, axis2=-1)), axis=-1) + 0.5 * np.log(2 * np.pi) * len(
        root[0]
    )
    return np.asarray(-0.5 * np.sum(white * white, axis=-2) - constant[:, None])


def _share(log_w: Array, fit: Array, left: Array) -> Array:
    """How much (B,) of what is left of a measurement leaves enough particles counting."""
    low, high = np.zeros_like(left), left.copy()
    for k in range(HALVINGS):
        at = high if k == 0 else 0.5 * (low + high)
        enough = effective(log_w + at[:, None] * fit) >= COUNTING * log_w.shape[-1]
        low, high = np.where(enough, at, low), np.where(enough, high, at)
        if (high - low <= 0.01 * low).all():
            break
    return np.where(low > 0.99 * left, left, np.maximum(low, left * 0.5**HALVINGS))


def _beyond(off: Array, root: Array, nis: Array) -> tuple[Any, Any]:
    """Which of a batch (B,) is measured where the cloud as a whole is not, by its NIS (B,); and which of these
    where no particle is, by what the particles are off (B, N, m) and the factor of R."""
    count, m = off.shape[-2:]
    if not m:
        return np.zeros(len(off), bool), np.zeros(len(off), bool)
    farthest = chi_square_threshold(1 - 1 / count, m)
    is_outlier = nis > farthest
    return is_outlier, is_outlier & (_squares(off, root).min(axis=-1) > farthest)


def _squares(off: Array, root: Array) -> Array:
    """Squared differences (B, N) of (B, N, m), by the factor of their covariance."""
    return np.asarray(np.sum(np.linalg.solve(root, _t(off)) ** 2, axis=-2))


def _is_explained(x: tuple[Array, Array], log_w: Array, off: tuple[Array, Array], root: Array) -> Any:
    """Which of a batch (B,) measures a line, for all that matters: over particles `x[0]` of these weights it is
    nearly its regression, and where they were moved to, `x[1]`, too, but for a part of R. off: of y from both."""
    mean, middle = (_mean(rows, log_w)[..., None, :] for rows in (x[0], off[0]))
    weighted = np.exp(log_w)[..., None] * (x[0] - mean)
    slope = np.linalg.pinv(_t(weighted) @ (x[0] - mean), hermitian=True) @ (_t(weighted) @ (off[0] - middle))

    def squares(off: Array, x: Array) -> Array:
        return np.asarray(np.sum(np.exp(log_w) * _squares(off - middle - (x - mean) @ slope, root), axis=-1))

    is_line = squares(off[0], x[0]) <= CURVED * squares(off[0], np.zeros_like(x[0]) + mean)
    return is_line & (squares(off[1], x[1]) < EXPLAINED * root.shape[-1])


def _walk(
    x: Array, walking: Any, prior: tuple[Array, Array], shares: Array, seen: Measured, rng: np.random.Generator
) -> None:
    """Move the particles of `walking` members in place by steps of Metropolis & al. (1953), which keep the
    distribution of a Gaussian `prior`, its mean and covariance, after this share of the measurement."""
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
    for length in STEPS:
        tried = x.copy()
        for b in walking:
            spread = _moments(x[b], np.full(count, -np.log(count)))[1]
            tried[b] += length / np.sqrt(n) * rng.standard_normal((count, n)) @ _t(_root("covariance", spread))
        then = log_density(tried, seen.off(tried))
        for b in walking:
            is_taken = np.log(rng.random(count)) < then[b] - now[b]
            x[b], now[b] = np.where(is_taken[:, None], tried[b], x[b]), np.where(is_taken, then[b], now[b])


def _moved(x: Array, log_w: Array, off: Array, S: Array, root: Array) -> Array:
    """Particles (B, N, n) of these weights with the mean and covariance of a Kalman filter, by the regression of
    the measurement over them: the gain of Andrews (1968) for the deviations, as in `ensemble.update`."""
    w, mean, error = np.exp(log_w)[..., None], _mean(x, log_w)[..., None, :], _mean(off, log_w)[..., None, :]
    X, Y = x - mean, error - off
    L = np.linalg.cholesky(S)
    scaled = np.linalg.solve(L, _t(Y) @ (w * X))
    mean = mean + np.linalg.solve(L, _t(error)).swapaxes(-1, -2) @ scaled
    return np.asarray(mean + X - Y @ np.linalg.solve(_t(L + root), scaled))


def _resampled(x: Array, log_w: Array, rng: np.random.Generator, bandwidth: float) -> Array:
    """Particles (N, n) of equal weight, with the mean and covariance of those of these weights."""
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
    """Mean (..., m) and covariance (..., m, m) of weighted rows (..., N, m)."""
    mean = _mean(rows, log_w)
    off = rows - mean[..., None, :]
    covariance = _t(off) @ (np.exp(log_w)[..., None] * off)
    return mean, np.asarray(0.5 * (covariance + _t(covariance)))


def _require(name: str, array: Array, shape: tuple[int, ...], dtype: Any) -> None:
    require_plain(**{name: array})
    if array.dtype != dtype or array.shape[-2:][: len(shape)] != shape:
        raise FilterError(f"{name}: must be {shape or '(..., m)'} of {dtype}, not {array.shape} of {array.dtype}")


def _root(name: str, covariance: Array) -> Array:
    """A root A (..., n, n) of a covariance that may be singular, A A^T."""
    P = covariance.astype(float)
    variances = np.diagonal(P, axis1=-2, axis2=-1)
    if not np.isfinite(P).all() or np.any(variances < 0):
        raise NotPositiveDefiniteError(f"{name}: not finite, or not positive semi-definite")
    scale = np.sqrt(np.where(variances > 0, variances, 1.0))
    values, vectors = np.linalg.eigh(P / (scale[..., :, None] * scale[..., None, :]))
    if np.any(values[..., 0] < -TOLERANCE * np.abs(values).max(axis=-1)):
        raise NotPositiveDefiniteError(f"{name}: not positive semi-definite")
    return np.asarray(scale[..., :, None] * vectors * np.sqrt(np.maximum(values, 0))[..., None, :])


def _factor(R: Array) -> Array:
    try:
        return np.asarray(np.linalg.cholesky(R))
    except np.linalg.LinAlgError as error:
        raise NotPositiveDefiniteError("R: must be positive definite for a particle filter") from error


def _t(A: Array) -> Array:
    return np.swapaxes(A, -1, -2)


# `run` has it by its name. It is not among METHODS: what it estimates is right on average over its particles, and
# not to the last digit.
METHOD: Final = Method(
    "particle",
    start,
    predict,
    update,
    belief,
    exempt={"kalman": "it draws its particles: what it estimates is right on average over them"},
)
