"""Attitudes of moving mounts, as gimbals state them, interpolated at any time.

MAVLink's vehicle frame is the earth's, turned to our heading: a gimbal's roll and pitch are always those against
the horizon.
"""

import math
from bisect import bisect_left
from collections.abc import Sequence
from typing import Final

import numpy as np

from onboard.arrays import Array
from onboard.geometry.camera import Camera
from onboard.geometry.rotations import (
    euler_from_quaternion,
    matrix_from_quaternion,
    quaternion_from_euler,
    slerp,
)
from onboard.messages import GimbalAttitude, MountAttitude
from onboard.units import NS_PER_S

HISTORY_DURATION_NS: Final = 5 * NS_PER_S
MAX_GAP_DURATION_NS: Final = 500_000_000  # Samples that are farther apart are not interpolated.
MAX_DEVICE_COUNT: Final = 8
MAX_QUATERNION_LENGTH: Final = 2.0  # of a quaternion, which has length 1


class Gimbals:
    """The attitudes of each gimbal in its own frame, by time."""

    def __init__(self, max_extrapolation: float) -> None:
        self.count = 0  # of samples taken
        self._max_extrapolation_ns = round(max_extrapolation * NS_PER_S)
        self._histories: dict[int, list[tuple[int, MountAttitude]]] = {}
        self._has_status: set[int] = set()  # devices whose MOUNT_ORIENTATIONs repeat what they send anyway

    def receive(self, message: GimbalAttitude) -> str:
        """Add a sample. Returns why it was rejected, or ""."""
        q = message.mount.q
        length = math.sqrt(sum(x * x for x in q))
        if not 0.5 < length < MAX_QUATERNION_LENGTH:
            return "gimbal_unusable"
        if message.device not in self._histories and len(self._histories) >= MAX_DEVICE_COUNT:
            return "gimbal_too_many"
        if message.is_replaced and message.device in self._has_status:
            return ""
        if not message.is_replaced:
            self._has_status.add(message.device)
        history = self._histories.setdefault(message.device, [])
        if history and message.t_ns <= history[-1][0]:
            return "gimbal_out_of_order"
        w, x, y, z = (component / length for component in q)
        history.append((message.t_ns, MountAttitude(q=(w, x, y, z), frame=message.mount.frame)))
        if message.t_ns - history[0][0] > 2 * HISTORY_DURATION_NS:
            del history[: bisect_left(history, message.t_ns - HISTORY_DURATION_NS, key=_time)]
        self.count += 1
        return ""

    def of(self, camera: Camera, t_ns: int) -> MountAttitude | None:
        """Return the attitude of a camera's gimbal by `gimbal_frame` and `gimbal_reversed`."""
        mount = None if camera.gimbal is None else self.at(camera.gimbal, t_ns)
        if mount is None or not (camera.gimbal_frame or camera.gimbal_reversed):
            return mount
        q = reversed_about(camera.gimbal_reversed, mount.q) if camera.gimbal_reversed else mount.q
        return MountAttitude(q=q, frame=camera.gimbal_frame or mount.frame)

    def at(self, device: int, t_ns: int) -> MountAttitude | None:
        """Return the attitude of a gimbal as it states it; None where it is not known.

        It is interpolated, and extrapolated for a short while after the newest sample."""
        history = self._histories.get(device, [])
        i = bisect_left(history, t_ns, key=_time)
        if i < len(history) and history[i][0] == t_ns:
            return history[i][1]
        is_ahead = i == len(history)
        if is_ahead:
            if not history or t_ns - history[-1][0] > self._max_extrapolation_ns:
                return None
            i -= 1
        if i == 0:
            return history[0][1] if is_ahead else None
        (t0_ns, first), (t1_ns, second) = history[i - 1], history[i]
        if t1_ns - t0_ns > MAX_GAP_DURATION_NS or first.frame != second.frame:
            return second if is_ahead else None
        w, x, y, z = slerp(first.q, second.q, (t_ns - t0_ns) / (t1_ns - t0_ns)).tolist()
        return MountAttitude(q=(w, x, y, z), frame=first.frame)

    def knows(self, device: int, t_ns: int) -> bool:
        """Whether the attitude at a time is interpolated, so that later samples do not change it."""
        history = self._histories.get(device, [])
        return bool(history) and t_ns <= history[-1][0]

    def may_know(self, device: int, t_ns: int) -> bool:
        """Whether the next sample may make the attitude at a time known."""
        history = self._histories.get(device, [])
        return bool(history) and 0 < t_ns - history[-1][0] <= MAX_GAP_DURATION_NS


def reversed_about(axes: Sequence[str], q: Sequence[float]) -> tuple[float, float, float, float]:
    """A quaternion whose Euler angles, ZYX, have the other sign about these axes."""
    angles = zip(("roll", "pitch", "yaw"), euler_from_quaternion(q), strict=True)
    w, x, y, z = quaternion_from_euler(*(-angle if axis in axes else angle for axis, angle in angles)).tolist()
    return w, x, y, z


def head_attitude(mount: MountAttitude, R_nb: Array) -> Array:
    """R_nh (3, 3) of a mount's head, with our own attitude R_nb (3, 3)."""
    R = matrix_from_quaternion(mount.q)
    if mount.frame == "earth":
        return R
    if mount.frame == "body":
        return np.asarray(R_nb @ R)
    c, s = R_nb[0, 0], R_nb[1, 0]
    length = math.hypot(c, s)
    if length < 1e-6:  # our nose points straight up or down: there is no heading
        return R
    c, s = c / length, s / length
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ R


def _time(sample: tuple[int, MountAttitude]) -> int:
    return sample[0]
