"""A rangefinder on the camera's axis that measures the range of a leader in its beam."""

import math
from typing import Final

from onboard.messages import DistanceReading
from simlink.scenarios.camera import Camera
from simlink.scenarios.rangefinder import Rangefinder
from simlink.sensors.camera import Mount, in_camera, mount_quaternion
from simlink.world.attitude import difference
from simlink.world.noise import normals, uniforms
from simlink.world.truth import State

COMPONENT_ID: Final = 158  # MAV_COMP_ID_PERIPHERAL


class RangefinderSensor:
    """The rangefinder of one run: call `measure` once for each of its readings, in order.

    `mount` gives q_bc of a moving mount of the camera.
    """

    def __init__(self, settings: Rangefinder, camera: Camera, seed: int, mount: Mount | None = None) -> None:
        self._settings, self._camera, fixed = settings, camera, mount_quaternion(camera)
        self._mount = mount or (lambda _: fixed)
        self._noise, self._chance = normals(seed, "rangefinder.noise"), uniforms(seed, "rangefinder.misses")
        self._bias = settings.bias * next(self._noise)

    def measure(self, state: State, t_ns: int, system: int) -> DistanceReading:
        """Return the reading at this state."""
        s = self._settings
        r = in_camera(difference(state.r_OL_n, state.r_OF_n), state.q_nF, self._camera, self._mount(state))
        distance = math.hypot(*r)
        noise, missed = next(self._noise), next(self._chance) < s.p_miss
        is_seen = r[0] > distance * math.cos(math.radians(s.half_angle_deg)) and distance <= s.range_max
        return DistanceReading(
            t_ns=t_ns,
            t_recv_ns=t_ns,
            system=system,
            component=COMPONENT_ID,
            sensor=s.sensor,
            distance=distance + self._bias + s.white * noise if is_seen and not missed else None,
            sigma=None,
        )
