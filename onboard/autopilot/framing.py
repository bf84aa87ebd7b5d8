"""The slot's height at which the leader stays inside the image, at the pitch that the flight needs."""

import math
from typing import Final

from onboard.geometry.camera import Camera
from onboard.geometry.rotations import euler_from_quaternion
from onboard.messages import Quaternion, Vec3

LOOKS_AHEAD: Final = 0.5  # cosine: a camera that looks elsewhere does not see the leader ahead
TILT_MARGIN: Final = math.radians(10.0)  # for a lean of 1.7 m/s^2, beyond the mean pitch
SMOOTH_S: Final = 5.0  # s, time constant of the mean pitch
SPEED: Final = 0.5  # m/s, at which the height is changed
MOST_LIFT: Final = 0.5  # of the slot's horizontal distance


class Framing:
    """`lift` (m, down positive) is added to the slot's height; 0 while the leader is well inside the image."""

    def __init__(self, slot: Vec3) -> None:
        forward, right, self._down = slot
        self._distance = math.hypot(forward, right)
        self._pitch: float | None = None
        self.lift = 0.0

    def update(self, camera: Camera, q_nb: Quaternion, dt: float) -> float:
        """The lift after a further `dt` s with this attitude. A gimbal's camera needs none."""
        if camera.gimbal is not None or camera.R_bc[0, 0] < LOOKS_AHEAD or self._distance == 0.0:
            return self.lift
        _, pitch, _ = euler_from_quaternion(q_nb)
        before = pitch if self._pitch is None else self._pitch
        self._pitch = before + min(dt / SMOOTH_S, 1.0) * (pitch - before)
        up = self._pitch + math.asin(-camera.R_bc[2, 0])  # elevation of the optical axis
        half = math.atan2(0.5 * camera.height_px, camera.f_px)
        edge = max(half - TILT_MARGIN, 0.5 * half)
        elevation = math.atan2(self._down, self._distance)
        kept = min(max(elevation, up - edge), up + edge)
        wanted = self._distance * math.tan(min(max(kept, -1.2), 1.2)) - self._down
        most = MOST_LIFT * self._distance
        wanted = min(max(wanted, -most), most)
        self.lift += min(max(wanted - self.lift, -SPEED * dt), SPEED * dt)
        return self.lift
