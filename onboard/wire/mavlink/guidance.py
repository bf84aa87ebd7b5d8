"""Messages about the leader (FOLLOW_TARGET, TARGET_RELATIVE, ...) <-> records.

TARGET_RELATIVE (511) is not in pymavlink's dialects. Its layout and CRC_EXTRA follow MAVLink's development.xml.
"""

import math
import struct
from collections.abc import Callable
from typing import Any, Final, cast

from pymavlink.dialects.v20 import ardupilotmega as dialect

from onboard.messages import (
    CameraTracking,
    CameraTrackingGeo,
    CurrentMode,
    FollowTarget,
    LandingTarget,
    Message,
    MessageInterval,
    Quaternion,
    Setpoint,
    TargetRelative,
    Vec3,
)
from onboard.messages.mavlink_enums import BODY_FRD
from onboard.wire.mavlink.frame import CURRENT_MODE_ID, TARGET_RELATIVE_ID, UNLISTED

POSITION, VELOCITY, ACCELERATION, ATTITUDE = 1, 2, 4, 8  # bits of est_capabilities
LOCAL_OFFSET_NED: Final = 2  # TARGET_OBS_FRAME: NED, travels with the vehicle
ALL_FIELDS: Final = 0  # POSITION_TARGET_TYPEMASK
NAN: Final = math.nan
UNKNOWN_LATITUDE: Final = 2**31 - 1  # and longitude


class UnlistedMessage(dialect.MAVLink_message):  # type: ignore[misc]  # pymavlink has no types
    """A message of `UNLISTED` for pymavlink, with its payload in `struct` layout."""

    def __init__(self, number: int, layout: str, *fields: Any) -> None:
        name, self._extra = UNLISTED[number]
        super().__init__(number, name)
        self._payload = struct.pack(layout, *fields)

    def pack(self, mav: Any, force_mavlink1: bool = False) -> bytes:
        """The frame."""
        return cast(bytes, self._pack(mav, self._extra, self._payload, force_mavlink1=force_mavlink1))


def _target_relative(m: Any) -> list[Any]:
    no_sensor = (0.0, 0.0, 0.0, 0.0)
    fields = (*m.r_FL_n, *m.position_sigma, m.yaw_sigma, *m.q_nL, *no_sensor)
    # timestamp, r, pos_std, yaw_std, q_target, q_sensor; id, frame, type
    fields = (m.unix_ns // 1000, *fields, 0, LOCAL_OFFSET_NED, dialect.LANDING_TARGET_TYPE_VISION_OTHER)
    return [UnlistedMessage(TARGET_RELATIVE_ID, "<Q3f3ff4f4f3B", *fields)]


def _follow_target(m: Any) -> list[Any]:
    capabilities = POSITION | VELOCITY
    capabilities |= (0 if m.a_n is None else ACCELERATION) | (0 if m.q_nL is None else ATTITUDE)
    zero = (0.0, 0.0, 0.0)
    return [
        dialect.MAVLink_follow_target_message(
            m.t_ns // 1_000_000,
            capabilities,
            round(m.lat_deg * 1e7),
            round(m.lon_deg * 1e7),
            m.alt_msl,
            m.v_n,
            m.a_n or zero,
            m.q_nL or (1.0, 0.0, 0.0, 0.0),
            zero,
            tuple(sigma * sigma for sigma in m.position_sigma),
            0,
        )
    ]


def follow_target(fields: tuple[Any, ...], header: dict[str, Any]) -> Message:
    """The record of a FOLLOW_TARGET; its stamp is milliseconds since its sender's boot."""
    stamp, _, lat, lon, alt = fields[:5]
    capabilities = fields[-1]
    q: Quaternion | None = cast(Quaternion, fields[11:15]) if capabilities & ATTITUDE else None
    north, east, down = (math.sqrt(max(variance, 0.0)) for variance in fields[18:21])
    return FollowTarget(
        **header | {"t_ns": stamp * 1_000_000},
        lat_deg=lat * 1e-7,
        lon_deg=lon * 1e-7,
        alt_msl=alt,
        v_n=fields[5:8],
        a_n=cast(Vec3, fields[8:11]) if capabilities & ACCELERATION else None,
        q_nL=q,
        position_sigma=(north, east, down),
    )


def _setpoint(m: Any) -> list[Any]:
    frame, target = dialect.MAV_FRAME_LOCAL_NED, (m.target_system, m.target_component)
    fields = (*m.r_OF_n, *m.v_F_n, *m.a_F_n, m.yaw, m.yaw_rate)
    stamp_ms = m.t_ns // 1_000_000 % 2**32
    return [dialect.MAVLink_set_position_target_local_ned_message(stamp_ms, *target, frame, ALL_FIELDS, *fields)]


def setpoint(fields: tuple[Any, ...], header: dict[str, Any]) -> Message | None:
    """The record of a SET_POSITION_TARGET_LOCAL_NED, or None if it ignores fields."""
    type_mask, system, component, frame = fields[12:]
    if type_mask != ALL_FIELDS or frame != dialect.MAV_FRAME_LOCAL_NED:
        return None
    return Setpoint(
        **header,
        target_system=system,
        target_component=component,
        r_OF_n=fields[1:4],
        v_F_n=fields[4:7],
        a_F_n=fields[7:10],
        yaw=fields[10],
        yaw_rate=fields[11],
    )


def _landing_target(m: Any) -> list[Any]:
    frame = dialect.MAV_FRAME_LOCAL_NED if m.is_local else BODY_FRD
    none = (0.0, 0.0, 0.0, 0.0)
    args = (m.t_ns // 1000, 0, frame, *m.angles, m.distance, m.size, m.size)
    return [dialect.MAVLink_landing_target_message(*args, *m.r, none, dialect.LANDING_TARGET_TYPE_VISION_OTHER, 1)]


def _camera_tracking(m: Any) -> list[Any]:
    status = int(m.is_active)
    x, y = m.point or (NAN, NAN)
    data = 0 if m.point is None else dialect.CAMERA_TRACKING_TARGET_DATA_IN_STATUS
    radius = NAN if m.radius is None else m.radius
    mode = dialect.CAMERA_TRACKING_MODE_POINT if m.is_active else 0
    return [dialect.MAVLink_camera_tracking_image_status_message(status, mode, data, x, y, radius, *(NAN,) * 4)]


def _camera_tracking_geo(m: Any) -> list[Any]:
    def known(value: float | None) -> float:
        return NAN if value is None else value

    lat, lon, alt = m.position or (None, None, None)
    return [
        dialect.MAVLink_camera_tracking_geo_status_message(
            int(m.is_active),
            UNKNOWN_LATITUDE if lat is None else round(lat * 1e7),
            UNKNOWN_LATITUDE if lon is None else round(lon * 1e7),
            *map(
                known, (alt, m.h_acc, m.v_acc, *(m.v_n or (None,) * 3), m.v_acc_m_s, m.distance, m.heading, None)
            ),
        )
    ]


ENCODE: Final[dict[type[Message], Callable[[Any], list[Any]]]] = {
    FollowTarget: _follow_target,
    TargetRelative: _target_relative,
    Setpoint: _setpoint,
    CurrentMode: lambda m: [UnlistedMessage(CURRENT_MODE_ID, "<2IB", m.custom_mode, m.intended_mode, 0)],
    LandingTarget: _landing_target,
    CameraTracking: _camera_tracking,
    CameraTrackingGeo: _camera_tracking_geo,
    MessageInterval: lambda m: [dialect.MAVLink_message_interval_message(m.number, m.interval_us)],
}
