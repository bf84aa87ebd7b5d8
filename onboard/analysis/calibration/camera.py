"""A camera's delay, mount and focal length from one flight, by least squares.

We turn, roll and pitch, and look at a leader that flies calmly. Its path is unknown: a spline whose accelerations
are those of a calm leader. A delay, a turned mount or a wrong focal length makes it seem to follow our own motion,
which is known. Levenberg-Marquardt over both, with Huber's weights against outliers; how calmly the leader flies
is chosen by the marginal likelihood. Sigmas are those of the normal equations, enlarged by the residuals'
chi-square where that exceeds its expectation.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from scipy.interpolate import BSpline

from onboard import UserError
from onboard.arrays import Array
from onboard.geometry.camera import Camera
from onboard.geometry.rotations import matrix_from_euler

KNOTS_S: Final = 1.0  # between the knots of the leader's path
CALM: Final = (0.15, 0.05, 0.02, 0.5)  # m/s^2: the leader's acceleration, new every second; the likeliest is taken
SPAN_NOISE: Final = 0.3  # of the range by the wing's apparent length, for the whole flight: its heading is open
LONGEST_DELAY_S: Final = 0.45  # the path reaches half a second beyond the images
HUBER: Final = 3.0  # sigmas
ITERATIONS: Final = 30
PARAMETERS: Final = 5  # delay, three angles of the mount, logarithm of the focal length
FIRST_SIGMA: Final = np.array([0.3, 0.2, 0.2, 0.2, 0.2])  # s, rad, 1: what a configuration may be off by
DERIVATIVE: Final = 1e-5
FEWEST: Final = 100


class OwnPoses(NamedTuple):
    """Our own poses: times (n,) s, positions (n, 3) m in local NED, attitudes q_nb (n, 4)."""

    t: Array
    r_OF_n: Array
    q_nb: Array

    def at(self, t: Array) -> tuple[Array, Array]:
        """Positions (k, 3) and rotations R_nb (k, 3, 3) at times (k,)."""
        r = np.column_stack([np.interp(t, self.t, self.r_OF_n[:, i]) for i in range(3)])
        q = np.column_stack([np.interp(t, self.t, self.q_nb[:, i]) for i in range(4)])
        w, x, y, z = (q / np.linalg.norm(q, axis=1, keepdims=True)).T
        rows = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
        return r, np.moveaxis(np.array(rows), 2, 0)


class Images(NamedTuple):
    """Images of the leader by the configured camera: times (k,) s, centers (k, 2), apparent wings (k,), in focal
    lengths, and the centers' standard deviations (k,)."""

    t: Array
    center: Array
    span: Array
    sigma: Array


class Calibration(NamedTuple):
    """Corrections to the configuration, and their standard deviations: the delay in s, the mount as a rotation
    vector (3,) in rad about the camera's axes, the factor of the focal length. `before` and `after` (k, 2):
    residuals in sigmas as configured and corrected, of images at `t` (k,) s. `calm`: the leader's acceleration,
    m/s^2."""

    calm: float
    t: Array
    delay: float
    delay_sigma: float
    mount: Array
    mount_sigma: Array
    focal: float
    focal_sigma: float
    before: Array
    after: Array


def calibrate(images: Images, own: OwnPoses, camera: Camera, size: float) -> Calibration:
    """The corrections of a camera that fit one flight best. `size`: the leader's wingspan, m.

    Raises UserError for a flight with too few images.
    """
    inside = (images.t > own.t[0] + 1.0) & (images.t < own.t[-1] - 1.0)
    images = Images(*(array[inside] for array in images))
    if len(images.t) < FEWEST:
        raise UserError(f"{len(images.t)} images with our own pose: at least {FEWEST} are needed")
    problem = Problem(images, own, camera, size)
    x, information = problem.best()
    before = problem.residuals(problem.solve(problem.start(), fixed=True)[0])[0]
    after = problem.residuals(x)[0]
    worse = max(1.0, float(np.sum(problem.weights(after)[:, None] * after**2)) / (2 * len(after)))
    sigma = np.sqrt(worse * np.diag(np.linalg.inv(information))[:PARAMETERS])
    return Calibration(
        problem.calm,
        images.t,
        float(x[0]),
        float(sigma[0]),
        x[1:4],
        sigma[1:4],
        math.exp(x[4]),
        float(sigma[4]),
        before,
        after,
    )


class Problem:
    """Residuals of a flight and their derivatives; the unknowns are the five corrections and the leader's path,
    whose accelerations have one sigma of `calm`."""

    def __init__(self, images: Images, own: OwnPoses, camera: Camera, size: float) -> None:
        self._images, self._own, self._camera, self._size = images, own, camera, size
        first, last = images.t[0] - 0.5, images.t[-1] + 0.5
        inner = np.linspace(first, last, max(2, round((last - first) / KNOTS_S)))
        self._knots = np.concatenate([[first] * 3, inner, [last] * 3])
        self._count = len(self._knots) - 4
        times = np.linspace(first, last, 2 * len(inner))
        bend = BSpline(self._knots, np.eye(self._count), 3).derivative(2)(times)
        self._steep = bend / math.sqrt(2.0)  # two samples a second, of one acceleration
        self.calm = CALM[0]

    @property
    def _bend(self) -> Array:
        return self._steep / self.calm

    def start(self) -> Array:
        """No corrections, and the leader where each image shows it, smoothed."""
        images, camera = self._images, self._camera
        r, R_nb = self._own.at(images.t)
        rays = np.column_stack([np.ones(len(images.t)), images.center])
        distance = np.median(self._size / images.span) * np.ones(len(rays))
        r_CL_b = distance[:, None] * rays @ camera.R_bc.T + camera.r_FC_b
        path = r + np.einsum("kij,kj->ki", R_nb, r_CL_b)
        B = BSpline.design_matrix(images.t, self._knots, 3).toarray()
        smooth = np.linalg.solve(B.T @ B + self._bend.T @ self._bend, B.T @ path)
        return np.concatenate([np.zeros(PARAMETERS), smooth.ravel()])

    def best(self) -> tuple[Array, Array]:
        """The unknowns and the information about them with the likeliest calmness of the leader."""
        x, found = self.start(), []
        for calm in CALM:
            self.calm = calm
            x, information = self.solve(x)
            _, logarithm = np.linalg.slogdet(information)
            evidence = -self._cost(x) - 0.5 * logarithm - 3 * (self._count - 2) * math.log(calm)
            found.append((evidence, calm, x, information))
        _, self.calm, x, information = max(found, key=lambda one: one[0])
        return x, information

    def solve(self, x: Array, *, fixed: bool = False) -> tuple[Array, Array]:
        """The unknowns that fit best, and the information (n, n) about them. `fixed`: without corrections."""
        damping, cost = 1e-3, self._cost(x)
        for _ in range(ITERATIONS):
            gradient, information = self._normal(x)
            if fixed:
                information[:PARAMETERS, :PARAMETERS] += np.eye(PARAMETERS) * 1e15
            step = -np.linalg.solve(information + damping * np.diag(np.diag(information)), gradient)
            trial = self._cost(x + step)
            if not trial <= cost:
                damping *= 10.0
                continue
            done = cost - trial < 1e-6 * cost
            x, cost, damping = x + step, trial, 0.1 * damping
            if done:
                break
        return x, self._normal(x)[1]

    def residuals(self, x: Array) -> tuple[Array, Array, Array, Array]:
        """Residuals (k, 2) of the centers in sigmas, (k,) of the ranges; derivatives (k, 2, 3) and (k, 3) by the
        leader's position."""
        images, camera = self._images, self._camera
        t = images.t - x[0]
        B = BSpline.design_matrix(t, self._knots, 3)
        r, R_nb = self._own.at(t)
        R_cn = np.swapaxes(R_nb @ (camera.R_bc @ _turn(x[1:4])), 1, 2)
        offset = B @ x[PARAMETERS:].reshape(-1, 3) - r - R_nb @ camera.r_FC_b
        forward, right, down = np.einsum("kij,kj->ik", R_cn, offset)
        forward = np.maximum(forward, 0.5)
        f = math.exp(x[4])
        point = f * np.column_stack([right / forward, down / forward])
        by_camera = np.zeros((len(t), 2, 3))
        by_camera[:, 0, 1] = by_camera[:, 1, 2] = f / forward
        by_camera[:, :, 0] = -point / forward[:, None]
        distance = np.linalg.norm(offset, axis=1)
        whole = SPAN_NOISE * math.sqrt(len(t))
        ranges = (np.log(distance * images.span / (f * self._size))) / whole
        scaled = images.sigma[:, None]
        by_range = offset / distance[:, None] ** 2 / whole
        return (point - images.center) / scaled, ranges, by_camera @ R_cn / scaled[..., None], by_range

    def weights(self, residuals: Array) -> Array:
        """Huber's weights (k,) of residuals (k, 2)."""
        return np.asarray(np.minimum(1.0, HUBER / np.maximum(np.linalg.norm(residuals, axis=1), 1e-9)))

    def _cost(self, x: Array) -> float:
        if abs(x[0]) > LONGEST_DELAY_S or float(np.abs(x[1:PARAMETERS]).max()) > 1.0:
            return math.inf  # beyond the path's ends, or no mount or lens at all
        points, ranges, *_ = self.residuals(x)
        n = np.linalg.norm(points, axis=1)
        huber = np.where(n < HUBER, 0.5 * n**2, HUBER * (n - 0.5 * HUBER))
        bend = self._bend @ x[PARAMETERS:].reshape(-1, 3)
        prior = x[:PARAMETERS] / FIRST_SIGMA
        return float(huber.sum() + 0.5 * (np.sum(ranges**2) + np.sum(bend**2) + np.sum(prior**2)))

    def _normal(self, x: Array) -> tuple[Array, Array]:
        """Gradient (n,) and information (n, n)."""
        points, ranges, by_point, by_range = self.residuals(x)
        k, n = len(ranges), len(x)
        B = BSpline.design_matrix(self._images.t - x[0], self._knots, 3).toarray()
        J = np.zeros((3 * k, n))
        stacked = np.concatenate([by_point, by_range[:, None]], 1)  # (k, 3, 3)
        J[:, PARAMETERS:] = (stacked[:, :, None, :] * B[:, None, :, None]).reshape(3 * k, n - PARAMETERS)
        e = np.column_stack([points, ranges])
        for i in range(PARAMETERS):
            moved = x.copy()
            moved[i] += DERIVATIVE
            other = self.residuals(moved)
            J[:, i] = ((np.column_stack(other[:2]) - e) / DERIVATIVE).ravel()
        w = np.column_stack([self.weights(points)] * 2 + [np.ones(k)]).ravel()
        path = x[PARAMETERS:].reshape(-1, 3)
        gradient, information = J.T @ (w * e.ravel()), J.T @ (w[:, None] * J)
        gradient[PARAMETERS:] += (self._bend.T @ (self._bend @ path)).ravel()
        information[PARAMETERS:, PARAMETERS:] += np.kron(self._bend.T @ self._bend, np.eye(3))
        gradient[:PARAMETERS] += x[:PARAMETERS] / FIRST_SIGMA**2
        information[:PARAMETERS, :PARAMETERS] += np.diag(FIRST_SIGMA**-2.0)
        return gradient, information


def _turn(vector: Array) -> Array:
    """The rotation matrix (3, 3) of a small rotation vector, as Euler angles: to the second order the same."""
    return matrix_from_euler(*vector)
