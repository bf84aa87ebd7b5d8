"""A baseline for the leader: filterpy's unscented filter with constant relative velocity.

It measures the image's center and the apparent width of a wing of known size. The wing is assumed to be seen
from behind or ahead, so a turning leader seems more distant than it is. Needs filterpy.
"""

from collections import deque
from typing import Any, Final

import numpy as np

from onboard.arrays import Array
from onboard.config import Config
from onboard.geometry.rotations import matrix_from_quaternion
from onboard.messages import Cause, Estimate, Lifecycle, Output, OwnPose
from onboard.models import relative_motion
from onboard.scoring.beside import PRIMARY_ESTIMATOR
from onboard.units import S_PER_NS

BASELINE_NAME: Final = "filterpy"
MAX_OWN_POSE_OFFSET_NS: Final = 60_000_000  # from the image
MAX_IMAGE_GAP_S: Final = 2.0  # without an image; then it restarts
ACCELERATION_NOISE: Final = 2.0  # m/s^2, white
WING_SIGMA: Final = 0.02  # of the size, as configured by default
POINT_COUNT: Final = 3
NIS_GATE: Final = 30.0  # 3 degrees of freedom


class Baseline:
    """The filter of one flight, on the raw image points and our own attitude."""

    def __init__(self, config: Config) -> None:
        leader = config.estimator.get(PRIMARY_ESTIMATOR) or next(iter(config.estimator.values()))
        self._size = float(getattr(leader, "size_prior_m", 2.0))
        camera = config.camera_model()
        self._R_cb, self._sigma = np.asarray(camera.R_bc).T, camera.sigma
        self._poses: deque[OwnPose] = deque(maxlen=100)
        self._filter: Any = None
        self._t_ns = self._sequence = 0

    def follow(self, output: Output) -> Estimate | None:
        """Fuse an output of our pipeline. Returns an estimate for each image that it can use."""
        if isinstance(output, OwnPose):
            self._poses.append(output)
            return None
        report = output.measurement if output.name == PRIMARY_ESTIMATOR and output.is_primary else None
        if report is None or report.points is None or len(report.points) < POINT_COUNT or not self._poses:
            return None
        own = min(self._poses, key=lambda pose: abs(pose.t_ns - report.t_ns))
        if abs(own.t_ns - report.t_ns) > MAX_OWN_POSE_OFFSET_NS or report.t_ns <= self._t_ns:
            return None
        center, left, right = (np.array(point) for point in report.points[:POINT_COUNT])
        z = np.array([*center, np.linalg.norm(right - left)])
        self._step(z, self._R_cb @ matrix_from_quaternion(np.array(own.q_nb)).T, report.t_ns)
        return self._estimate()

    def _step(self, z: Array, R_cn: Array, t_ns: int) -> None:
        dt = (t_ns - self._t_ns) * S_PER_NS
        if self._filter is None or dt > MAX_IMAGE_GAP_S:
            self._begin(z, R_cn)
        else:
            eye, filter_ = np.eye(3), self._filter
            blocks = [[dt**3 / 3 * eye, dt**2 / 2 * eye], [dt**2 / 2 * eye, dt * eye]]
            filter_.Q = ACCELERATION_NOISE**2 * np.block(blocks)
            filter_.predict(dt=dt)
            size = self._size

            def seen(x: Array) -> Array:
                ahead, across, down = R_cn @ x[:3]
                return np.array([across / ahead, down / ahead, size / np.linalg.norm(x[:3])])

            before = filter_.x.copy(), filter_.P.copy()
            filter_.update(z, hx=seen)
            if filter_.y @ np.linalg.solve(filter_.S, filter_.y) > NIS_GATE:
                filter_.x, filter_.P = before
        self._t_ns = t_ns

    def _begin(self, z: Array, R_cn: Array) -> None:
        from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter  # noqa: PLC0415 - an extra

        def moved(x: Array, dt: float) -> Array:
            return np.concatenate([x[:3] + dt * x[3:], x[3:]])

        points = MerweScaledSigmaPoints(6, alpha=0.5, beta=2.0, kappa=-3.0)
        self._filter = UnscentedKalmanFilter(dim_x=6, dim_z=3, dt=0.04, hx=None, fx=moved, points=points)
        direction = np.array([1.0, z[0], z[1]])
        distance = self._size / max(float(z[2]), 1e-3)
        self._filter.x = np.concatenate([distance * R_cn.T @ direction / np.linalg.norm(direction), np.zeros(3)])
        self._filter.P = np.diag([(0.2 * distance) ** 2] * 3 + [25.0] * 3)
        width = 2.0 * self._sigma**2 + (WING_SIGMA * float(z[2])) ** 2
        self._filter.R = np.diag([self._sigma**2, self._sigma**2, width])

    def _estimate(self) -> Estimate:
        self._sequence += 1
        nine = len(relative_motion.COMPONENTS)
        mean, P = np.zeros(nine), np.diag([0.0] * 6 + [(WING_SIGMA * self._size) ** 2, 4.0, 4.0])
        mean[:6], mean[6], P[:6, :6] = self._filter.x, self._size, self._filter.P
        return Estimate(
            name=BASELINE_NAME,
            target=BASELINE_NAME,
            sequence=self._sequence,
            t_ns=self._t_ns,
            state=Lifecycle.TRACKING,
            valid=True,
            cause=Cause.FUSED,
            reason="",
            frame="n",
            components=relative_motion.COMPONENTS,
            units=relative_motion.UNITS,
            mean=tuple(mean.tolist()),
            covariance=tuple(map(tuple, P.tolist())),
            age=0.0,
            reset_count=0,
        )
