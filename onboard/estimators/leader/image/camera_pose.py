"""The camera's position, motion and attitude at the time of an image."""

from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.estimators.leader import assumptions as given
from onboard.geometry.camera import Camera, in_view
from onboard.messages import Exposure, MountAttitude
from onboard.ownship import Ownship, Pose, head_attitude
from onboard.units import S_PER_NS

NO_NOISE: Final = np.zeros((3, 3))


class CameraPose(NamedTuple):
    """The camera at one time: its attitude R_cn (3, 3), its place r_FC_n (3,) m, F's velocity v_F_n (3,) m/s,
    the camera's rates omega_c (3,) rad/s, and the covariance noise_c (3, 3) of the attitude's white noise, a small
    rotation in c, rad^2."""

    R_cn: Array
    r_FC_n: Array
    v_F_n: Array
    omega_c: Array
    noise_c: Array = NO_NOISE


class PosedExposure(NamedTuple):
    """An exposure, by which camera and from which pose it was taken; None where that is not known. The pose is
    `is_final` if nothing to come can change it."""

    exposure: Exposure
    camera: Camera
    sigma: float  # of an image coordinate without one of its own, in focal lengths
    pose: CameraPose | None
    is_final: bool


class CameraPoses:
    """Poses of the camera on our vehicle, from our own motion.

    All targets in an image share one pose, so each is computed once."""

    def __init__(self, camera: Camera) -> None:
        self.camera = camera
        self._named = {each.name: (each, each.sigma) for each in (camera, *reversed(camera.others))}
        self._first = camera, camera.sigma
        self._poses: dict[tuple[int, str, MountAttitude | None], CameraPose | None] = {}
        self._as_of: tuple[Ownship, int] | None = None

    def at(
        self, t_ns: int, ownship: Ownship, camera: Camera | None = None, mount: MountAttitude | None = None
    ) -> CameraPose | None:
        """The pose of a camera, by default the first, at a time; None where our own pose, or where its gimbal
        points, is not known. `mount`: where a moving mount pointed, where that came with the image."""
        camera = camera or self.camera
        as_of = ownship, ownship.samples + ownship.gimbals.count
        if self._as_of != as_of or len(self._poses) >= given.MAX_POSE_COUNT:
            self._poses.clear()
            self._as_of = as_of
        key = t_ns, camera.name, mount
        if key not in self._poses:
            self._poses[key] = _pose(camera, t_ns, ownship, mount)
        return self._poses[key]

    def see(self, r_FL_n: Array, t_ns: int, ownship: Ownship) -> bool:
        """Whether what is at r_FL_n (3,) m should be in the image of a camera.

        Where a pose is unknown, it may."""
        for camera in (self.camera, *self.camera.others):
            pose = self.at(t_ns, ownship, camera)
            if pose is None:
                return True
            r_CL_c = pose.R_cn @ (r_FL_n - pose.r_FC_n)
            if r_CL_c[0] > 0 and in_view(r_CL_c[1:] / r_CL_c[0], camera):
                return True
        return False

    def view(self, exposure: Exposure, ownship: Ownship) -> PosedExposure:
        """An exposure with the pose from which it was taken, for all its detections."""
        (camera, sigma), mount = self._named.get(exposure.camera, self._first), exposure.detections[0].mount
        t_ns = exposure.t_ns
        is_fixed = camera.gimbal is None or mount is not None
        is_final = ownship.knows(t_ns) and (is_fixed or ownship.gimbals.knows(camera.gimbal or 0, t_ns))
        pose = self.at(t_ns, ownship, camera, mount)
        return PosedExposure(exposure, camera, sigma, pose, is_final)


def _pose(camera: Camera, t_ns: int, ownship: Ownship, mount: MountAttitude | None) -> CameraPose | None:
    pose = ownship.pose_at(t_ns)
    if pose is None:
        return None
    r_FC_n = pose.R_nb @ camera.r_FC_b
    if mount is None and camera.gimbal is None:
        R_cb = camera.R_bc.T
        noise_c = (R_cb * pose.attitude_noise**2) @ R_cb.T
        return CameraPose(R_cb @ pose.R_nb.T, r_FC_n, pose.v_F_n, R_cb @ pose.omega_b, noise_c)
    head = _head(camera, t_ns, ownship, mount)
    if head is None:
        return None
    R_cn = (head_attitude(head, pose.R_nb) @ camera.R_bc).T
    omega_c = _rates(R_cn, camera, t_ns - given.RATE_INTERVAL_NS, ownship, mount)
    return CameraPose(R_cn, r_FC_n, pose.v_F_n, omega_c, _noise_c(R_cn, head, pose))


def _head(camera: Camera, t_ns: int, ownship: Ownship, mount: MountAttitude | None) -> MountAttitude | None:
    """Return the attitude of a moving mount's head at a time; None if unknown."""
    return mount or ownship.gimbals.of(camera, t_ns)


def _rates(R_cn: Array, camera: Camera, before_ns: int, ownship: Ownship, mount: MountAttitude | None) -> Array:
    """The rates (3,) of a camera on a moving mount, which states none, by its attitude shortly before."""
    pose, head = ownship.pose_at(before_ns), _head(camera, before_ns, ownship, mount)
    if pose is None or head is None:
        return np.zeros(3)
    # An attitude that came with the image is the head's at exposure, whenever that was: only its frame turns. With
    # the camera's axes c before and c' now, R_c'c = exp(-[rotation]).
    M = R_cn @ head_attitude(head, pose.R_nb) @ camera.R_bc
    rotation = np.array([M[1, 2] - M[2, 1], M[2, 0] - M[0, 2], M[0, 1] - M[1, 0]])
    return np.asarray(0.5 * rotation / (given.RATE_INTERVAL_NS * S_PER_NS))


def _noise_c(R_cn: Array, head: MountAttitude, pose: Pose) -> Array:
    """Return the noise of our own attitude that moves the head with its frame."""
    if head.frame == "earth":
        return NO_NOISE
    R_cb = R_cn @ pose.R_nb
    if head.frame == "body":
        return np.asarray((R_cb * pose.attitude_noise**2) @ R_cb.T)
    heading = float(pose.R_nb[2] ** 2 @ pose.attitude_noise**2)
    return heading * np.outer(R_cn[:, 2], R_cn[:, 2])
