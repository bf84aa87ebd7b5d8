"""GIMBAL_DEVICE_ATTITUDE_STATUS <-> GimbalAttitude, and the older MOUNT_ORIENTATION.

The quaternion is that of the gimbal's head against NED, or against NED turned to our heading, as the flags state.
Roll and pitch are against the horizon in both.
"""

import math
from collections.abc import Callable
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from onboard.geometry.rotations import quaternion_from_euler
from onboard.messages import GimbalAttitude, Message, MountAttitude

YAW_LOCK: Final = dialect.GIMBAL_DEVICE_FLAGS_YAW_LOCK  # in the earth's frame, if neither flag below is set
VEHICLE_YAW: Final = dialect.GIMBAL_DEVICE_FLAGS_YAW_IN_VEHICLE_FRAME
EARTH_YAW: Final = dialect.GIMBAL_DEVICE_FLAGS_YAW_IN_EARTH_FRAME
FORM: Final = "<I7fIH2B2fB"  # time, q, rates, failures; flags, target; delta_yaw, its rate, device


def attitude(f: tuple[Any, ...], h: dict[str, Any]) -> Message:
    """The record of a GIMBAL_DEVICE_ATTITUDE_STATUS; a device id of 0 is the sender's own."""
    flags, device = f[9], f[14]
    is_earth = bool(flags & EARTH_YAW) if flags & (EARTH_YAW | VEHICLE_YAW) else bool(flags & YAW_LOCK)
    mount = MountAttitude(q=f[1:5], frame="earth" if is_earth else "heading")
    return GimbalAttitude(**h, device=device or h["component"], mount=mount)


ORIENTATION: Final = "<I4f"  # time; roll, pitch, yaw in degrees, and the yaw against north


def orientation(f: tuple[Any, ...], h: dict[str, Any]) -> Message:
    """The record of a MOUNT_ORIENTATION, relative to our heading; an unknown roll is 0."""
    roll, pitch, yaw = (math.radians(angle) for angle in f[1:4])
    w, x, y, z = quaternion_from_euler(0.0 if math.isnan(roll) else roll, pitch, yaw).tolist()
    mount = MountAttitude(q=(w, x, y, z), frame="heading")
    return GimbalAttitude(**h, device=h["component"], mount=mount, is_replaced=True)


def _message(m: Any) -> list[Any]:
    """Encode a record. Raises KeyError for the frame `body`, which MAVLink does not have."""
    flags = {"earth": EARTH_YAW, "heading": VEHICLE_YAW}[m.mount.frame]
    device = 0 if m.device == m.component else m.device
    nan = float("nan")
    return [
        dialect.MAVLink_gimbal_device_attitude_status_message(
            0, 0, m.t_ns // 1_000_000 % 2**32, flags, m.mount.q, nan, nan, nan, 0, nan, nan, device
        )
    ]


ENCODE: Final[dict[type[Message], Callable[[Any], list[Any]]]] = {GimbalAttitude: _message}
