"""Errors of a camera's stamps, mount and focal length, from the motion of a target's direction.

A wrong mount turns with us, so a target seems to move each time that we pitch, roll or turn. With late stamps it
seems to move by our turn within the delay, and with a wrong focal length by too much or too little. The target's
own path is unknown: within a window it is a straight line and the double integral of white noise, whose strength,
and that of the images' noise, are those of the greatest restricted likelihood (Patterson and Thompson, 1971). So
a target that swerves, or a noisy detector, has little weight. Windows are linearised about the errors that fit all
of them, and added up; by how much they disagree adds to the uncertainty.

What a focal length does follows from where the target is expected in the image, not from where it was seen: noise
is in the second, and a camera that follows its target shows it in the middle, wherever the target goes.
"""

import math
from collections.abc import Generator, Sequence
from typing import Final, NamedTuple, TypeVar

import numpy as np

from onboard.arrays import Array
from onboard.geometry.camera import Camera
from onboard.geometry.rotations import matrix_from_euler

DELAY, MOUNT, FOCAL = 0, slice(1, 4), 4  # places in a vector of errors; a mount's are about the camera's axes
MIN_TILT_RMS: Final = 0.01  # rad, RMS: by our displacement alone, one error passes for another
KINDS: Final = {"delay": (0,), "mount": (1, 2, 3), "focal": (4,)}
ERROR_COUNT: Final = 5
# s, rad, and the logarithm of the focal length: what a configuration may be off by
FIRST_SIGMA: Final = np.array([0.3, 0.4, 0.4, 0.4, 0.5])
DISTANCE_SIGMA: Final = 0.2  # of a target's distance, by how much our own displacement counts, in each window
STEP: Final = 1e-4  # of the differences by which derivatives are taken
LONGEST_DELAY_S: Final = 0.45
LARGEST: Final = np.array([LONGEST_DELAY_S, 0.9, 0.9, 0.9, 1.4])
GRID: Final = np.array([0.04, 0.04, 0.04, 0.04, 0.1])  # of the errors about which windows are linearised
ITERATIONS: Final = 10
OUTLIER_RATIO: Final = 6.0  # times what a fifth of images are off the median of their neighbours
ACCELERATION_DENSITIES: Final = 10.0 ** np.arange(-2.0, 6.0, 1.5)  # white acceleration, (sigmas of an image)^2/s^3
# A target that moves as we do accelerates as we lean, as if the mount were wrong. The correlation of the two paths
# is 0.7 to 0.95 in formations, and up to 0.45 with a target on a path of its own.
MAX_PATH_CORRELATION: Final = 0.5
SIGMAS: Final = 5.0
# By which the logarithm of the likelihood of one is larger than another's. By leaders that 62 logs recorded, and a
# sound camera, a delay had up to 26 in 680 searches, and a focal length was off by 2.7 times its sigma (RMS)
CERTAIN: Final = {"delay": 35.0, "mount": 25.0}
FOCAL_SPREAD: Final = 2.7
# A smaller error costs less than what else is uncertain: rad about each axis, logarithm of the focal length
LEAST_MOUNT, LEAST_FOCAL = math.radians(5.0), math.log(1.25)
ZERO_ERROR: Final = np.zeros(ERROR_COUNT)
# Where a search for errors of one kind may begin: delays, mounts about one axis
STARTS: Final = np.array(
    [
        *(s * np.eye(ERROR_COUNT)[DELAY] for s in np.linspace(-0.4, 0.4, 9)),
        *(s * np.eye(ERROR_COUNT)[axis] for axis in KINDS["mount"] for s in (-0.52, -0.24, 0.24, 0.52)),
    ]
)


T = TypeVar("T")
Steps = Generator[None, None, T]  # of some milliseconds each, for who must not wait


class Poses:
    """Our own motion: times (n,) s, positions (n, 3) m in local NED, attitudes q_nb (n, 4)."""

    def __init__(self, t: Array, r_OF_n: Array, q_nb: Array) -> None:
        signs = np.cumprod(np.where(np.sum(q_nb[1:] * q_nb[:-1], axis=1) < 0, -1.0, 1.0))
        self.is_defined = bool(np.isfinite(r_OF_n).all())  # the autopilot may know its attitude alone, for a while
        self.t, self._columns = t, (*r_OF_n.T, *np.vstack([q_nb[:1], q_nb[1:] * signs[:, None]]).T)

    def at(self, t: Array) -> tuple[Array, Array]:
        """Positions (k, 3) and rotations R_nb (k, 3, 3) at times (k,)."""
        pose = np.array([np.interp(t, self.t, column) for column in self._columns])
        w, x, y, z = pose[3:] / np.linalg.norm(pose[3:], axis=0)
        rows = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
        return pose[:3].T, np.moveaxis(np.array(rows), 2, 0)


class Sights(NamedTuple):
    """Images of a target by one camera."""

    t: Array  # (k,) s
    points: Array  # (k, 2) image points
    distance: Array  # (k,) m; a common factor may be wrong (DISTANCE_SIGMA)


class Normal(NamedTuple):
    """A window, linearised: its information (5, 5) about errors, the gradient (5,) of the negative logarithm of
    their likelihood, and the logarithm itself; residuals (k, 3) of directions in n, rad, as large as noise is, and
    the images' R_nc (k, 3, 3)."""

    information: Array
    gradient: Array
    likelihood: float
    residuals: Array
    R_nc: Array


class Window:
    """Some seconds of sights, with our own poses from LONGEST_DELAY_S before them to as long after. `likelihoods`:
    logarithms, of STARTS. `lean`: the variance of our own attitude, rad^2."""

    def __init__(self, sights: Sights, poses: Poses, camera: Camera) -> None:
        self._sights, self._poses, self._camera = sights, poses, camera
        self._posed: tuple[float, tuple[Array, Array]] | None = None
        paths, _, r_C = self._positions(ZERO_ERROR, sights.points)
        near = np.lib.stride_tricks.sliding_window_view(np.pad(paths - r_C, ((2, 2), (0, 0)), "edge"), 5, axis=0)
        off = np.linalg.norm(paths - r_C - np.median(near, axis=-1), axis=1)
        inside = off <= OUTLIER_RATIO * np.percentile(off, 80)
        if not inside.all():
            self._sights, self._posed = Sights(*(array[inside] for array in sights)), None
        self._basis, self._swerve = _basis(self._sights.t)
        self._normals: dict[bytes, Normal] = {}
        R_nb = self._pose(0.0)[1]
        self.lean = 0.5 * float(np.sum(np.var(R_nb, axis=0)))
        self.likelihoods = np.array([self.likelihood(start) for start in STARTS])

    @property
    def t(self) -> Array:
        """Times (k,) of the images that count, s."""
        return self._sights.t

    def is_known(self, about: Array) -> bool:
        """Whether the window was linearised about these errors before."""
        return about.tobytes() in self._normals

    def normal(self, about: Array) -> Normal:
        """The window linearised about these errors, which are kept: few are asked for."""
        key = about.tobytes()
        if key not in self._normals:
            self._normals[key] = self._linearised(about)
        return self._normals[key]

    def likelihood(self, errors: Array) -> float:
        """The logarithm of the likelihood of errors, of noise that is in the image."""
        paths, _, r_C = self._positions(errors, self._sights.points)
        shown = self._project([r_C, paths], _transverse_axes(paths - r_C))
        return self._fit_acceleration(shown)[0] - 2.0 * len(shown) * float(errors[FOCAL])

    def paths_product(self) -> Array:
        """Return the products (2, 2) of our own path and the target's, over the variance of the noise."""
        paths, _, r_C = self._positions(ZERO_ERROR, self._sights.points)
        shown = self._project([r_C, paths], _transverse_axes(paths - r_C))
        _, weights, variance, _ = self._fit_acceleration(shown)
        return _normal_of(shown, weights) / variance

    def _linearised(self, errors: Array) -> Normal:
        """The normal equations about these errors."""
        points = self._sights.points
        paths, R_nc, r_C = self._positions(errors, points)
        E = _transverse_axes(paths - r_C)
        # What was seen says nothing of a focal length, at first: noise is in it.
        for size in (FOCAL, ERROR_COUNT, ERROR_COUNT):
            start = self._positions(errors, points)[0]
            moved = [
                (self._positions(errors + STEP * e, points)[0] - start) / STEP for e in np.eye(ERROR_COUNT)[:size]
            ]
            shown = self._project([r_C, *moved, paths], E)
            _, weights, variance, here = self._fit_acceleration(shown)
            rest = shown[:, :, -1] - shown[:, :, :-1] @ here
            # what no straight line, no swerve and no error explains
            residuals = self._basis.T @ (rest * weights[:, None]) @ E
            s_n = paths - r_C - residuals
            u_c = np.einsum("kji,kj->ki", R_nc, s_n)
            points = math.exp(errors[FOCAL]) * u_c[:, 1:] / np.maximum(u_c[:, :1], 0.1)
        N = _normal_of(shown, weights)
        # our displacement's share is this window's own
        N[0, 0] += variance / DISTANCE_SIGMA**2
        N = (N - np.outer(N[0], N[0]) / N[0, 0])[1:, 1:] / variance
        information, gradient = N[:-1, :-1], N[:-1, -1].copy()
        # noise that is left in the expected points moves with that of the seen ones
        gradient[FOCAL] += 2.0 * float(np.sum(weights * (1.0 - weights)))
        free = float(np.sum(weights)) - 0.5 * ERROR_COUNT  # the path, and the errors here, have taken their part
        residuals *= math.sqrt(len(points) / max(free, 1.0))
        return Normal(information, gradient, self.likelihood(errors), residuals, R_nc)

    def _pose(self, delay: float) -> tuple[Array, Array]:
        """Our own poses at the images' times, if they are so much older."""
        if self._posed is None or self._posed[0] != delay:
            self._posed = delay, self._poses.at(self._sights.t - delay)
        return self._posed[1]

    def _positions(self, errors: Array, points: Array) -> tuple[Array, Array, Array]:
        """Return the target's positions (k, 3) in n that a camera with these errors shows.

        Also its attitudes R_nc and its positions. The unit is the mean distance."""
        sights, camera = self._sights, self._camera
        r, R_nb = self._pose(float(errors[DELAY]))
        mean = float(sights.distance.mean())
        R_nc, r_C = R_nb @ (camera.R_bc @ matrix_from_euler(*errors[1:4])), (r + R_nb @ camera.r_FC_b) / mean
        u_c = np.column_stack([np.ones(len(points)), points / math.exp(errors[FOCAL])])
        u_c *= (sights.distance / mean / np.linalg.norm(u_c, axis=1))[:, None]
        return r_C + np.einsum("kij,kj->ki", R_nc, u_c), R_nc, r_C

    def _project(self, arrays: list[Array], E: Array) -> Array:
        """Arrays (k, 3) in n across a direction, beside a straight line: (k - 2, 2, number of arrays)."""
        return np.stack([self._basis @ (array @ E.T) for array in arrays], axis=2)

    def _fit_acceleration(self, shown: Array) -> tuple[float, Array, float, Array]:
        """Fit the last of `shown` by the others.

        Returns the logarithm of the restricted likelihood, the weights (k - 2,) of the likeliest acceleration
        density, the variance of the images' noise, and the coefficients."""
        found: list[tuple[float, Array, float, Array]] = []
        size = shown.shape[2] - 1
        count = 2 * len(shown) - size
        ridge = 1e-6 * np.eye(size)
        for swerve in ACCELERATION_DENSITIES:
            weights = 1.0 / (1.0 + swerve * self._swerve)
            N = _normal_of(shown, weights)
            here = np.asarray(np.linalg.solve(N[:-1, :-1] + ridge, N[:-1, -1]), float)
            rest = max(float(N[-1, -1] - N[-1, :-1] @ here), 1e-18)
            likelihood = float(np.sum(np.log(weights))) - 0.5 * count * math.log(rest)
            found.append((likelihood, weights, rest / count, here))
        return max(found, key=lambda one: one[0])


def _transverse_axes(lines: Array) -> Array:
    """Two axes (2, 3) across the mean of lines of sight (k, 3)."""
    return np.asarray(np.linalg.svd(lines.mean(axis=0)[None, :])[2][1:])


def _normal_of(shown: Array, weights: Array) -> Array:
    """The weighted sums of products (p, p) of p columns."""
    rows = (shown * np.sqrt(weights)[:, None, None]).reshape(-1, shown.shape[2])
    return np.asarray(rows.T @ rows)


def _basis(t: Array) -> tuple[Array, Array]:
    """Return orthonormal rows (k - 2, k) that are orthogonal to a straight line over k >= 3 times.

    Also the variance (k - 2,) of the double integral of white noise of density 1 along each."""
    t = t - t[0]
    rest = np.linalg.qr(np.vander(t, 2), mode="complete")[0][:, 2:]
    least, most = np.minimum.outer(t, t), np.maximum.outer(t, t)
    variances, axes = np.linalg.eigh(rest.T @ (least**2 * (3.0 * most - least) / 6.0) @ rest)
    return (rest @ axes).T, np.maximum(variances, 0.0)


class CameraFit(NamedTuple):
    """Errors (5,) of a camera that fit its windows best, their sigmas (5,), and the logarithm of their likelihood.
    A positive delay: images are older than their stamps say. A positive focal length: exp(that) times the
    configured one."""

    errors: Array
    sigma: Array
    likelihood: float


def finished(steps: Steps[T]) -> T:
    """Run all steps, and return their result."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            found: T = end.value
            return found


def path_correlation(windows: Sequence[Window]) -> float:
    """Return the correlation of the target's path with our own, beside straight lines."""
    N = np.sum([window.paths_product() for window in windows], axis=0)
    return float(N[0, 1] / math.sqrt(max(N[0, 0] * N[1, 1], 1e-9)))


def wrong_mount(windows: Sequence[Window]) -> Steps[tuple[Array, Array] | None]:
    """Return the certain error of a camera's mount: angles (3,) about its axes, and their sigmas (3,).

    It is None where nothing is certain, where the target moves with us, and where a delay or a focal length
    explains what was seen, alone or in addition. Neither of these is ever claimed.
    """
    if np.mean([w.lean for w in windows]) < MIN_TILT_RMS**2 or path_correlation(windows) > MAX_PATH_CORRELATION:
        return None
    likelihoods = np.sum([w.likelihoods for w in windows], axis=0)
    fits = {}
    for kind, places in KINDS.items():
        others = np.any(np.delete(STARTS, places, axis=1) != 0.0, axis=1)
        start = STARTS[int(np.argmax(np.where(others, -math.inf, likelihoods)))]
        fits[kind] = yield from fitting(windows, (kind,), ZERO_ERROR if kind == "focal" else start)
    configured = CameraFit(ZERO_ERROR, ZERO_ERROR, sum(w.likelihood(ZERO_ERROR) for w in windows))
    mount = fits.pop("mount")
    if not _is_new_error("mount", mount, configured):
        return None
    for other, alone in fits.items():
        both = yield from fitting(windows, (other,), mount.errors)
        if _is_new_error(other, both, mount):
            return None
        if _is_new_error(other, alone, configured):
            both = yield from fitting(windows, ("mount",), alone.errors)
            if not _is_new_error("mount", both, alone):
                return None
    errors, sigma = mount.errors[MOUNT], mount.sigma[MOUNT]
    return (errors, sigma) if np.any((np.abs(errors) > SIGMAS * sigma) & (np.abs(errors) > LEAST_MOUNT)) else None


def _is_new_error(kind: str, one: CameraFit, before: CameraFit) -> bool:
    """Whether a fit shows an error of a kind for certain that was not there before. Likelihoods of different focal
    lengths cannot be compared: a target that we follow moves as we do, as if the focal length were short."""
    if np.any(np.abs(one.errors) >= 0.99 * LARGEST):
        return False  # no small error of a camera
    if kind == "focal":
        return bool(abs(one.errors[FOCAL] - before.errors[FOCAL]) > max(SIGMAS * one.sigma[FOCAL], LEAST_FOCAL))
    return one.likelihood > before.likelihood + CERTAIN[kind]


def fitting(
    windows: Sequence[Window], kinds: tuple[str, ...] = tuple(KINDS), about: Array = ZERO_ERROR
) -> Steps[CameraFit]:
    """The errors of these kinds that fit all windows best, the others as they are at first. Windows are linearised
    about points of GRID, as long as that makes what was seen likelier."""
    places = [place for kind in kinds for place in KINDS[kind]]
    for _ in range(ITERATIONS):
        here = yield from _normals(windows, about)
        off, sigma = _step(here, about, places)
        best = sum(normal.likelihood for normal in here)
        trials = [about + np.round(share * off / GRID) * GRID for share in (1.0, 0.5)]
        if (trials[0] == about).all():
            break
        if FOCAL in places:
            about = trials[0]
            continue
        likelihoods = []
        for trial in trials:
            there = yield from _normals(windows, trial)
            likelihoods.append(sum(normal.likelihood for normal in there))
        if max(likelihoods) <= best:
            break
        about = trials[int(np.argmax(likelihoods))]
    errors = about + np.clip(off, -GRID, GRID)
    likelihood = 0.0
    for w in windows:
        likelihood += w.likelihood(errors)
        yield
    is_better = FOCAL in places or likelihood > best
    return CameraFit(errors, sigma, likelihood) if is_better else CameraFit(about, sigma, best)


def _normals(windows: Sequence[Window], about: Array) -> Steps[list[Normal]]:
    """Windows, linearised."""
    found = []
    for w in windows:
        if not w.is_known(about):
            yield
        found.append(w.normal(about))
    return found


def _step(normals: Sequence[Normal], about: Array, places: list[int]) -> tuple[Array, Array]:
    """The step (5,) to the errors at these places that fit all windows best, and their sigmas (5,). A window that
    disagrees with the others counts less."""
    if not places:
        return ZERO_ERROR, ZERO_ERROR
    information = np.array([normal.information[np.ix_(places, places)] for normal in normals])
    gradients = np.array([normal.gradient[places] for normal in normals])
    prior, weights = FIRST_SIGMA[places] ** -2.0, np.ones(len(normals))
    for _ in range(4):
        inverse = np.linalg.inv(np.diag(prior) + np.einsum("w,wij->ij", weights, information))
        step = -inverse @ (weights @ gradients + prior * about[places])
        rest = gradients + information @ step
        explained = np.linalg.solve(information + np.diag(prior), rest[:, :, None])[:, :, 0]
        off = np.einsum("wi,wi->w", rest, explained)
        weights = np.minimum(1.0, SIGMAS / np.sqrt(np.maximum(off, 1e-9)))
    scatter = np.einsum("w,wi,wj->ij", weights**2, rest, rest)
    whole, sigma = ZERO_ERROR.copy(), ZERO_ERROR.copy()
    whole[places] = np.clip(about[places] + step, -LARGEST[places], LARGEST[places]) - about[places]
    sigma[places] = np.sqrt(np.diag(inverse + inverse @ scatter @ inverse))
    sigma[FOCAL] *= FOCAL_SPREAD
    return whole, sigma
