"""The gimbal of a camera: its attitude, and the attitude that it reports.

It is level, turned with our heading, and sweeps to either side.
"""

import math

from onboard.messages import GimbalAttitude, MountAttitude, Quaternion
from simlink.scenarios.camera import Camera, Gimbal
from simlink.sensors.camera import mount_quaternion
from simlink.world import attitude
from simlink.world.noise import normals
from simlink.world.truth import State


class GimbalSensor:
    """The gimbal of one run; its reported attitude has a constant error, drawn by seed."""

    def __init__(self, camera: Camera, gimbal: Gimbal, seed: int) -> None:
        self._gimbal, self._mount = gimbal, mount_quaternion(camera)
        draw = normals(seed, "camera.gimbal")
        tilt, drift = gimbal.error_deg, gimbal.yaw_error_deg
        x, y, z = (math.radians(e) * next(draw) for e in (tilt, tilt, tilt if drift is None else drift))
        self._error = attitude.from_vector(x, y, z)

    def head(self, t: float) -> Quaternion:
        """Return q_hg at a time of flight: from the head's axes to NED turned to our heading."""
        g = self._gimbal
        yaw, pitch = (
            math.radians(width) * math.sin(2 * math.pi * t / period + math.radians(phase))
            for width, period, phase in zip(g.sweep_deg, g.period, g.phase_deg, strict=True)
        )
        return attitude.from_euler(0.0, pitch, yaw)

    def mount(self, state: State) -> Quaternion:
        """q_bc of the camera on the head."""
        w, x, y, z = state.q_nF
        heading = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
        q_nc = attitude.product(
            attitude.from_euler(0.0, 0.0, heading), attitude.product(self.head(state.t), self._mount)
        )
        return attitude.product(attitude.conjugate(state.q_nF), q_nc)

    def attitude(self, state: State, t_ns: int, system: int) -> GimbalAttitude:
        """Return the attitude report at this state."""
        q = attitude.product(self.head(state.t), self._error)
        component = self._gimbal.component
        return GimbalAttitude(
            t_ns=t_ns,
            t_recv_ns=t_ns,
            system=system,
            component=component,
            device=component,
            mount=MountAttitude(q=q, frame="heading"),
        )


def make_gimbal(camera: Camera, seed: int) -> GimbalSensor | None:
    """Return the gimbal of a camera, or None for a fixed mount."""
    return None if camera.gimbal is None else GimbalSensor(camera, camera.gimbal, seed)
