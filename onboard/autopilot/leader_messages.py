"""The leader's state as MAVLink records; None where the state lacks a field."""

import math
from collections.abc import Callable
from typing import Any, Final, NamedTuple

import numpy as np

from onboard.arrays import Array
from onboard.geometry.camera import Camera, in_view, pixels_from_points, project
from onboard.geometry.rotations import matrix_from_quaternion
from onboard.messages import (
    AdsbVehicle,
    AltitudeType,
    CameraTracking,
    CameraTrackingGeo,
    Clock,
    FollowTarget,
    GlobalPosition,
    LandingTarget,
    LeaderState,
    Message,
    Quaternion,
    TargetRelative,
    Vec3,
)

ICAO: Final = 0xF2_0000  # unassigned; `autopilot.traffic` uses the two ranges below
CALLSIGN: Final = "LEADER"
UNKNOWN_YAW: Final = math.pi  # standard deviation of a yaw that is not known


class CameraView(NamedTuple):
    """Our own attitude and camera, and whether the autopilot is a PX4."""

    q_nb: Quaternion
    camera: Camera
    is_px4: bool


def follow_target(s: LeaderState, _: CameraView) -> Message | None:
    """Make FOLLOW_TARGET. ArduPilot's offsets are relative to its yaw: the course."""
    place = _place(s)
    if place is None or s.v_L_n is None:
        return None
    q = None if s.course is None else _yaw(s.course)
    return FollowTarget(**_stamp(s), **place, v_n=s.v_L_n, a_n=s.a_L_n, q_nL=q, position_sigma=_sigmas(s)[0])


def global_position(s: LeaderState, _: CameraView) -> Message | None:
    """Make GLOBAL_POSITION_INT. Its `height` is above the origin, which is near home."""
    place = _place(s)
    if place is None or s.v_L_n is None or s.r_OL_n is None:
        return None
    return GlobalPosition(**_stamp(s), **place, height=-s.r_OL_n[2], v_F_n=s.v_L_n, heading_rad=s.course)


def target_relative(s: LeaderState, _: CameraView) -> Message | None:
    """Make TARGET_RELATIVE: the leader relative to us, in NED."""
    if s.r_FL_n is None or s.r_FL_covariance is None:
        return None
    velocity_sigma = _sigmas(s)[1]
    north, east, down = _deviations(s.r_FL_covariance)
    yaw_sigma = UNKNOWN_YAW
    if s.course is not None and s.v_L_n is not None:
        speed = math.hypot(s.v_L_n[0], s.v_L_n[1])
        yaw_sigma = min(math.atan2(max(velocity_sigma[:2]), speed), UNKNOWN_YAW)
    return TargetRelative(
        **_stamp(s),
        unix_ns=s.t_host_ns,
        r_FL_n=s.r_FL_n,
        position_sigma=(north, east, down),
        yaw_sigma=yaw_sigma,
        q_nL=_yaw(s.course or 0.0),
    )


def landing_target(s: LeaderState, view: CameraView) -> Message | None:
    """Make LANDING_TARGET: in local NED for PX4, in the body frame for ArduPilot."""
    if s.r_FL_n is None or s.r_OL_n is None:
        return None
    r_b = _in_body(s, view)
    forward, right, down = r_b.tolist()
    distance = float(np.linalg.norm(r_b))
    return LandingTarget(
        **_stamp(s),
        r=s.r_OL_n if view.is_px4 else (forward, right, down),
        is_local=view.is_px4,
        angles=(math.atan2(right, forward), math.atan2(down, forward)),
        distance=distance,
        size=(s.size or 0.0) / distance,
    )


def adsb_vehicle(s: LeaderState, _: CameraView) -> Message | None:
    """Make ADSB_VEHICLE, which shows the leader on the map of a ground station."""
    place = _place(s)
    if place is None or s.v_L_n is None:
        return None
    north, east, down = s.v_L_n
    return AdsbVehicle(
        t_ns=s.t_ns,
        t_recv_ns=s.t_ns,
        clock=Clock.NONE,
        icao=ICAO,
        lat_deg=place["lat_deg"],
        lon_deg=place["lon_deg"],
        altitude=place["alt_msl"],
        altitude_type=AltitudeType.PRESSURE,  # which MAVLink means above mean sea level
        course=None if s.course is None else s.course % (2 * math.pi),
        ground_speed=math.hypot(north, east),
        climb=-down,
        callsign=CALLSIGN,
        emitter=14,  # ADSB_EMITTER_TYPE_UAV
        tslc=s.age or 0.0,
        squawk=None,
    )


def camera_tracking(s: LeaderState, view: CameraView) -> Message | None:
    """Make CAMERA_TRACKING_IMAGE_STATUS; idle without a valid estimate."""
    if s.r_FL_n is None or not s.valid:
        return CameraTracking(**_stamp(s), is_active=False)
    camera = view.camera
    r_c = camera.R_bc.T @ (_in_body(s, view) - camera.r_FC_b)
    point = project(r_c)
    if not np.isfinite(point).all() or not in_view(point, camera):
        return CameraTracking(**_stamp(s), is_active=True)
    u, v = pixels_from_points(point, camera).tolist()
    radius = None if s.size is None else 0.5 * s.size * camera.f_px / float(np.linalg.norm(r_c)) / camera.width_px
    at = (u / camera.width_px, v / camera.height_px)
    return CameraTracking(**_stamp(s), is_active=True, point=at, radius=radius)


def camera_tracking_geo(s: LeaderState, _: CameraView) -> Message | None:
    """Make CAMERA_TRACKING_GEO_STATUS; idle without a valid estimate."""
    place = _place(s)
    if place is None or s.r_FL_n is None or not s.valid:
        return CameraTrackingGeo(**_stamp(s), is_active=s.valid)
    (north, east, down), velocity_sigma = _sigmas(s)
    return CameraTrackingGeo(
        **_stamp(s),
        is_active=True,
        position=(place["lat_deg"], place["lon_deg"], place["alt_msl"]),
        h_acc=math.hypot(north, east),
        v_acc=down,
        v_n=s.v_L_n,
        v_acc_m_s=math.hypot(*velocity_sigma),
        distance=math.hypot(*s.r_FL_n),
        heading=math.atan2(s.r_FL_n[1], s.r_FL_n[0]),
    )


MESSAGE_MAKERS: Final[dict[str, Callable[[LeaderState, CameraView], Message | None]]] = {
    "FOLLOW_TARGET": follow_target,
    "GLOBAL_POSITION_INT": global_position,
    "TARGET_RELATIVE": target_relative,
    "LANDING_TARGET": landing_target,
    "ADSB_VEHICLE": adsb_vehicle,
    "CAMERA_TRACKING_IMAGE_STATUS": camera_tracking,
    "CAMERA_TRACKING_GEO_STATUS": camera_tracking_geo,
}
OWN_SYSTEM: Final = frozenset({"FOLLOW_TARGET", "GLOBAL_POSITION_INT"})  # sent with the leader's own system id


def _stamp(s: LeaderState) -> dict[str, Any]:
    return {"t_ns": s.t_ns, "t_recv_ns": s.t_ns}


def _place(s: LeaderState) -> dict[str, Any] | None:
    if s.lat_deg is None or s.lon_deg is None or s.alt_msl is None:
        return None
    return {"lat_deg": s.lat_deg, "lon_deg": s.lon_deg, "alt_msl": s.alt_msl}


def _sigmas(s: LeaderState) -> tuple[Vec3, Vec3]:
    """Return the standard deviations of position and velocity."""
    north, east, down, v_north, v_east, v_down = _deviations(s.covariance)
    return (north, east, down), (v_north, v_east, v_down)


def _deviations(covariance: tuple[tuple[float, ...], ...] | None) -> list[float]:
    return [math.sqrt(max(row[i], 0.0)) for i, row in enumerate(covariance or ())]


def _yaw(course: float) -> Quaternion:
    return math.cos(0.5 * course), 0.0, 0.0, math.sin(0.5 * course)


def _in_body(s: LeaderState, view: CameraView) -> Array:
    return np.asarray(matrix_from_quaternion(view.q_nb).T @ np.array(s.r_FL_n))
