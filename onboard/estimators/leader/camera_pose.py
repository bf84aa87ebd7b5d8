"""Where the camera is, how it moves and where it points, at the time of an image."""

from typing import Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.geometry.camera import Camera
from onboard.geometry.units import S_PER_NS
from onboard.messages import MountAttitude
from onboard.ownship import Ownship, Pose, head_attitude

RATE_NS: Final = 40_000_000  # interval over which the camera's rates are computed
MOST_POSES: Final = 64  # kept while no own motion arrives but images do


class CameraPose(NamedTuple):
    """The camera at one time: its attitude R_cn (3, 3), its place r_FC_n (3,) m, F's velocity v_F_n (3,) m/s, and
    the camera's rates omega_c (3,) rad/s."""

    R_cn: Array
    r_FC_n: Array
    v_F_n: Array
    omega_c: Array


class CameraPoses:
    """Poses of the camera on our vehicle, from our own motion. All targets in an image share one pose, so each is
    computed once."""

    def __init__(self, camera: Camera) -> None:
        self.camera = camera
        self._poses: dict[tuple[int, str, MountAttitude | None], CameraPose | None] = {}
        self._as_of: tuple[Ownship, int] | None = None

    def at(
        self, t_ns: int, ownship: Ownship, camera: Camera | None = None, mount: MountAttitude | None = None
    ) -> CameraPose | None:
        """The pose of a camera, by default the first, at a time; None where our own pose, or where its gimbal
        points, is not known. `mount`: where a moving mount pointed, where that came with the image."""
        camera = camera or self.camera
        as_of = ownship, ownship.samples + ownship.gimbals.count
        if self._as_of != as_of or len(self._poses) >= MOST_POSES:
            self._poses.clear()
            self._as_of = as_of
        key = t_ns, camera.name, mount
        if key not in self._poses:
            self._poses[key] = _pose(camera, t_ns, ownship, mount)
        return self._poses[key]

    def see(self, r_FL_n: Array, t_ns: int, ownship: Ownship) -> bool:
        """Whether what is at r_FL_n (3,) m should be in the image of a camera; where a pose is unknown, it may."""
        for camera in (self.camera, *self.camera.others):
            pose = self.at(t_ns, ownship, camera)
            if pose is None:
                return True
            ahead, right, down = (pose.R_cn @ (r_FL_n - pose.r_FC_n)).tolist()
            half = 0.5 * camera.width_px / camera.f_px, 0.5 * camera.height_px / camera.f_px
            if ahead > 0 and abs(right) <= half[0] * ahead and abs(down) <= half[1] * ahead:
                return True
        return False

    def is_final(self, t_ns: int, ownship: Ownship, camera: Camera, mount: MountAttitude | None) -> bool:
        """Whether nothing to come can change the pose of a camera at a time."""
        is_fixed = camera.gimbal is None or mount is not None
        return ownship.knows(t_ns) and (is_fixed or ownship.gimbals.knows(camera.gimbal or 0, t_ns))


def _pose(camera: Camera, t_ns: int, ownship: Ownship, mount: MountAttitude | None) -> CameraPose | None:
    pose, before = ownship.pose_at(t_ns), ownship.pose_at(t_ns - RATE_NS)
    R_nc = None if pose is None else _attitude(camera, t_ns, ownship, pose, mount)
    if pose is None or R_nc is None:
        return None
    R_cn = R_nc.T
    # an attitude that came with the image is the head's at exposure, whenever that was: only its frame turns
    R_nc_before = None if before is None else _attitude(camera, t_ns - RATE_NS, ownship, before, mount)
    # with the camera's axes c before and c' now, R_c'c = exp(-[rotation])
    M = np.eye(3) if R_nc_before is None else R_cn @ R_nc_before
    rotation = np.array([M[1, 2] - M[2, 1], M[2, 0] - M[0, 2], M[0, 1] - M[1, 0]])
    return CameraPose(R_cn, pose.R_nb @ camera.r_FC_b, pose.v_F_n, 0.5 * rotation / (RATE_NS * S_PER_NS))


def _attitude(
    camera: Camera, t_ns: int, ownship: Ownship, pose: Pose, mount: MountAttitude | None
) -> Array | None:
    """R_nc (3, 3) at a time; None where a gimbal's attitude is not known."""
    if mount is None and camera.gimbal is None:
        return np.asarray(pose.R_nb @ camera.R_bc)
    if mount is None and camera.gimbal is not None:
        mount = ownship.gimbals.at(camera.gimbal, t_ns)
    return None if mount is None else np.asarray(head_attitude(mount, pose.R_nb) @ camera.R_bc)
