"""The slot's height at which the leader stays in the image at the pitch of the flight."""

import math
from typing import Final

from onboard.geometry.camera import Camera
from onboard.geometry.rotations import euler_from_quaternion
from onboard.messages import Quaternion, Vec3

MIN_FORWARD_RATIO: Final = 0.5  # cosine; a camera that points elsewhere does not see the leader ahead
TILT_MARGIN: Final = math.radians(10.0)  # beyond the mean pitch, for an acceleration of 1.7 m/s^2
PITCH_TIME_S: Final = 5.0  # time constant of the mean pitch
MAX_LIFT_SPEED_M_S: Final = 0.5
MAX_LIFT_RATIO: Final = 0.5  # of the slot's horizontal distance


class Framing:
    """Change of the slot's height that keeps the leader in the image."""

    def __init__(self, slot: Vec3) -> None:
        forward, right, self._down = slot
        self._distance = math.hypot(forward, right)
        self._pitch: float | None = None
        self.lift = 0.0  # m, down; 0 while the leader is well inside the image

    def update(self, camera: Camera, q_nb: Quaternion, dt: float) -> float:
        """Update and return the lift, `dt` s later. A camera on a gimbal needs none."""
        if camera.gimbal is not None or camera.R_bc[0, 0] < MIN_FORWARD_RATIO or self._distance == 0.0:
            return self.lift
        _, pitch, _ = euler_from_quaternion(q_nb)
        before = pitch if self._pitch is None else self._pitch
        self._pitch = before + min(dt / PITCH_TIME_S, 1.0) * (pitch - before)
        up = self._pitch + math.asin(-camera.R_bc[2, 0])  # elevation of the optical axis
        half = math.atan2(0.5 * camera.height_px, camera.f_px)
        edge = max(half - TILT_MARGIN, 0.5 * half)
        elevation = math.atan2(self._down, self._distance)
        kept = min(max(elevation, up - edge), up + edge)
        wanted = self._distance * math.tan(min(max(kept, -1.2), 1.2)) - self._down
        max_lift = MAX_LIFT_RATIO * self._distance
        wanted = min(max(wanted, -max_lift), max_lift)
        max_change = MAX_LIFT_SPEED_M_S * dt
        self.lift += min(max(wanted - self.lift, -max_change), max_change)
        return self.lift
