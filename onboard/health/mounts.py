"""Whether a camera is mounted as configured and has the configured focal length, by how the leader's direction
moves when we lean.

A wrong mount turns with us: the leader then seems to move each time that we pitch, roll or turn. With a wrong
focal length it moves in the image by too much or too little. Within two seconds a real leader's direction is a
parabola of time, once our own displacement is taken off. What remains is compared with what a rotation of the
mount, and another focal length, would make of our own attitude. Windows are added up; by how much they disagree is
the uncertainty. Nothing is corrected: the two would take the blame for every other error.
"""

import math
from collections import deque
from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.geometry.camera import Camera
from onboard.geometry.rotations import euler_from_quaternion, matrix_from_euler, quaternion_from_matrix
from onboard.messages import DOUBT, Estimate, Verdict
from onboard.messages.causes import Cause, Reason
from onboard.ownship.ownship import Ownship
from onboard.units import NS_PER_S

FUSED: Final = (Verdict.FUSED, Verdict.FUSED_LATE)
WINDOW_NS: Final = 2 * NS_PER_S
FEWEST_IMAGES: Final = 20  # in a window
WINDOWS: Final = 60  # that are kept: two minutes
MOST_ENDED: Final = 8  # windows that wait to be judged
FEWEST_WINDOWS: Final = 8
FEWEST_EVEN: Final = 4.0  # ... that show the focal length alike: how little one or two disagree is chance
# A smaller error costs less than what else is uncertain: of the mount about each axis, rad; of the focal length.
LEAST: Final = np.array([*np.radians([5.0, 5.0, 5.0]), 0.25])
SIGMAS: Final = 5.0
FLOOR: Final = 1e-4  # rad, of what moves the direction in step with our lean and no mount does
MOST_NOISE: Final = (
    3e-3  # rad: white noise of the attitude turns what is compared and what it is compared with alike
)
LARGEST: Final = math.radians(60.0)  # beyond it nothing is small
HUBER: Final = 3.0
FOCAL: Final = 3  # the place of the focal length, after the three axes
AXES: Final = (("clockwise", "anticlockwise"), ("higher", "lower"), ("to the right", "to the left"))  # by the sign


class Sight(NamedTuple):
    """One image: its time, R_nc (3, 3), the unit vector (3,) to the leader in c, our position (3,) in n and the
    leader's distance, m."""

    t_ns: int
    R_nc: Array
    u_c: Array
    r_F_n: Array
    distance: float


class Window(NamedTuple):
    """What one camera saw in a window that has ended, with the arrival of the first image after it."""

    source: str
    sights: list[Sight]
    t_recv_ns: int


class Mounts:
    """The cameras of a flight. `add(source, reason, t_recv_ns)` takes what is found. `see` only collects, as an
    estimate waits behind it; `judge` computes, for milliseconds after each window."""

    def __init__(self, camera: Camera, add: Callable[[str, Reason, int], None]) -> None:
        self._camera, self._add = camera, add
        self._windows: dict[str, deque[tuple[Array, Array]]] = {}
        self._sights: dict[str, list[Sight]] = {}
        self._ended: list[Window] = []

    def see(self, estimate: Estimate, ownship: Ownship) -> None:
        """Take an estimate. It counts if it is valid, of the leader, and follows from an image that was fused."""
        report = estimate.measurement
        if not (estimate.valid and estimate.is_primary and estimate.name == "leader"):
            return
        if report is None or report.verdict not in FUSED or not report.points or estimate.mean is None:
            return
        camera, pose = self._camera.named(report.source), ownship.pose_at(report.t_ns)
        if pose is None or camera.gimbal is not None or not all(map(math.isfinite, pose.r_OF_n.tolist())):
            return
        if max(pose.attitude_noise.tolist()) > MOST_NOISE:
            return
        sights = self._sights.setdefault(report.source, [])
        if sights and not 0 <= report.t_ns - sights[0].t_ns < WINDOW_NS:
            self._ended.append(Window(report.source, sights, report.t_recv_ns))
            sights = self._sights[report.source] = []
            if len(self._ended) >= MOST_ENDED:  # nobody asks
                self.judge()
        u, v = map(sum, zip(*report.points, strict=True))
        ray, r = np.array([1.0, u / len(report.points), v / len(report.points)]), np.array(estimate.mean[:3])
        u_c, distance = ray / math.sqrt(ray @ ray), math.sqrt(r @ r)
        sights.append(Sight(report.t_ns, pose.R_nb @ camera.R_bc, u_c, pose.r_OF_n, distance))

    def judge(self) -> None:
        """Find what the windows that have ended since the last time show."""
        ended, self._ended = self._ended, []
        for source, sights, t_recv_ns in ended:
            if len(sights) < FEWEST_IMAGES:
                continue
            windows = self._windows.setdefault(source, deque(maxlen=WINDOWS))
            windows.append(equations(sights))
            found = errors(tuple(windows))
            if found is not None:
                self._add(f"camera {source}", _why(self._camera.named(source), *found), t_recv_ns)


def equations(sights: list[Sight]) -> tuple[Array, Array]:
    """X (2k, 4) and y (2k,) of k images: how a rotation of the mount by 1 rad about each of the camera's axes, and
    a focal length of twice the configured one, move the leader's direction, and how it has moved, both less a
    parabola of time; rad, across the mean direction."""
    R = np.array([s.R_nc for s in sights])
    s_n = np.einsum("kij,kj->ki", R, np.array([s.u_c for s in sights]))
    mean = s_n.mean(axis=0)
    mean /= np.linalg.norm(mean)
    # two axes across the direction
    E = np.linalg.svd(mean[None, :])[2][1:]
    r = np.array([s.r_F_n for s in sights])
    y = (s_n + (r - r.mean(axis=0)) / np.array([s.distance for s in sights])[:, None]) @ E.T
    u_c = np.einsum("kji,j->ki", R, mean)  # by our attitude alone: the points' own noise is in y
    off_axis = np.einsum("kij,kj->ki", R[:, :, 1:], u_c[:, 1:] / u_c[:, :1])
    X = np.dstack([np.cross(s_n[:, :, None], R, axis=1), off_axis])  # s x (R e), for each e
    X = np.einsum("aj,kji->kai", E, X)
    t = np.array([s.t_ns - sights[0].t_ns for s in sights]) / WINDOW_NS
    Q, _ = np.linalg.qr(np.vander(t, 3))
    both = np.concatenate([X, y[:, :, None]], axis=2).reshape(len(sights), -1)
    rest = (both - Q @ (Q.T @ both)).reshape(-1, 5)
    return rest[:, :4], rest[:, 4]


def errors(windows: tuple[tuple[Array, Array], ...]) -> tuple[Array, Array] | None:
    """By all windows (4,): the rotation vector of the mount about the camera's axes, rad, and by what share the
    focal length is longer than configured; and their standard deviations (4,). None where all are small or not
    certain. The focal length counts as configured unless it is certain that it is not: the two are hard to
    distinguish."""
    if len(windows) < FEWEST_WINDOWS:
        return None
    parts = np.array([np.sum(X_w[:, FOCAL] ** 2) for X_w, _ in windows])
    for columns in (FOCAL + 1, FOCAL):
        theta, sigma = _fitted([(X_w[:, :columns], y_w) for X_w, y_w in windows])
        is_certain = (np.abs(theta) > LEAST[:columns]) & (np.abs(theta) > SIGMAS * sigma)
        if np.linalg.norm(theta[:FOCAL]) >= LARGEST:
            continue
        if columns == FOCAL and is_certain.any():
            return np.append(theta, 0.0), np.append(sigma, 0.0)
        if is_certain[FOCAL:].any() and parts.sum() ** 2 > FEWEST_EVEN * np.sum(parts**2):
            return theta, sigma
    return None


def _fitted(windows: list[tuple[Array, Array]]) -> tuple[Array, Array]:
    """The errors (p,) that fit best, outliers aside, and their standard deviations (p,)."""
    X, y = np.vstack([w[0] for w in windows]), np.concatenate([w[1] for w in windows])
    size = X.shape[1]
    theta, weights = np.zeros(size), np.ones(len(y))
    for _ in range(4):
        information = X.T @ (weights[:, None] * X) + 1e-9 * np.eye(size)
        theta = np.linalg.solve(information, X.T @ (weights * y))
        rest = np.abs(y - X @ theta)
        weights = np.minimum(1.0, HUBER * float(np.median(rest)) / np.maximum(rest, 1e-12))
    scatter, at = np.zeros((size, size)), 0
    for X_w, y_w in windows:
        gradient = X_w.T @ (weights[at : at + len(y_w)] * (y_w - X_w @ theta))
        scatter += np.outer(gradient, gradient)
        at += len(y_w)
    inverse = np.linalg.inv(information)
    floor = FLOOR**2 * len(y) / np.diag(information)
    return theta, np.sqrt(np.diag(inverse @ scatter @ inverse) + floor)


def _why(camera: Camera, theta: Array, sigma: Array) -> Reason:
    """The error that is the largest beyond its uncertainty, for its kind."""
    axis = int(np.argmax((np.abs(theta) - SIGMAS * sigma) / LEAST))
    if axis == FOCAL:
        return Reason(
            Cause.FOCAL_LENGTH,
            f"{DOUBT}the leader moves in the image as we lean as if `f_px` were {1.0 + theta[FOCAL]:.2f} times as "
            f"long (sigma {max(sigma[FOCAL], 0.01):.2f}): ranges and directions are wrong by that",
        )
    theta, sigma = theta[:FOCAL], sigma[:FOCAL]
    degrees, doubt = math.degrees(theta[axis]), math.degrees(sigma[axis])
    wrong = f"{abs(degrees):.0f} degrees {AXES[axis][degrees < 0.0]} (sigma {max(doubt, 0.1):.1f})"
    small = np.where(np.abs(theta) > SIGMAS * sigma, theta, 0.0)
    w, x, y, z = quaternion_from_matrix(camera.R_bc @ matrix_from_euler(*small)).tolist()
    fits = [round(math.degrees(angle)) for angle in euler_from_quaternion((w, x, y, z))]
    return Reason(
        Cause.MOUNT,
        f"{DOUBT}the leader moves as we lean, as if the camera looked {wrong} than `mount_rpy_deg` says: {fits} "
        "fits",
    )
