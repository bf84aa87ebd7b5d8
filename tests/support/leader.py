"""The leader's estimate, our own pose and what follows from them, made by hand."""

from typing import Any, Final

from onboard.messages import (
    Cause,
    Clock,
    Estimate,
    GlobalOrigin,
    GlobalPosition,
    Heartbeat,
    LeaderState,
    Lifecycle,
    OwnPose,
)

S: Final = 1_000_000_000
T: Final = 20 * S  # boot
ORIGIN: Final = (47.4, 8.5, 500.0)
VARIANCES: Final = (4.0, 9.0, 1.0, 0.25, 0.16, 0.09, 1.0, 1.0, 1.0)
COMPONENTS: Final = ("r_north", "r_east", "r_down", "v_north", "v_east", "v_down", "size", "a_lat", "a_long")
AUTOPILOT: Final = Heartbeat(
    t_ns=0, t_recv_ns=0, clock=Clock.NONE, system=7, component=1, vehicle_type=2, autopilot=3, armed=True, status=4
)


def estimate(**changed: Any) -> Estimate:
    """Return an estimate at T of a leader in a right turn.

    It is 30 m north, 4 m east and 2 m below us, and 1 m/s faster to the north.
    """
    fields: dict[str, Any] = {
        "name": "leader",
        "target": "leader",
        "sequence": 5,
        "t_ns": T,
        "state": Lifecycle.TRACKING,
        "valid": True,
        "reason": "images fused",
        "frame": "n",
        "components": COMPONENTS,
        "units": ("",) * 9,
        "mean": (30.0, 4.0, 2.0, 1.0, 0.0, 0.5, 2.5, 3.0, 0.0),
        "covariance": tuple(tuple(v if i == j else 0.0 for j in range(9)) for i, v in enumerate(VARIANCES)),
        "age": 0.02,
        "reset_count": 0,
    }
    return Estimate(**fields | changed)


def own_pose(**changed: Any) -> OwnPose:
    """Return our pose at T: level, nose to the north, at 10 m/s to the north.

    It is 100 m north, 50 m east and 40 m above O.
    """
    fields: dict[str, Any] = {
        "t_ns": T,
        "r_OF_n": (100.0, 50.0, -40.0),
        "v_F_n": (10.0, 0.0, 0.0),
        "a_F_n": (0.0, 0.0, 0.0),
        "q_nb": (1.0, 0.0, 0.0, 0.0),
    }
    return OwnPose(**fields | changed)


def origin(system: int = 7, component: int = 1) -> GlobalOrigin:
    """GPS_GLOBAL_ORIGIN."""
    lat, lon, alt = ORIGIN
    return GlobalOrigin(
        t_ns=T, t_recv_ns=T, system=system, component=component, lat_deg=lat, lon_deg=lon, alt_msl=alt
    )


def own_global(place: tuple[float, float, float], t_ns: int = T) -> GlobalPosition:
    """Our own GLOBAL_POSITION_INT at a place."""
    lat, lon, alt = place
    times = {"t_ns": t_ns, "t_recv_ns": t_ns}
    where = {"lat_deg": lat, "lon_deg": lon, "alt_msl": alt, "height": 40.0}
    return GlobalPosition(**times, system=7, component=1, **where, v_F_n=(10.0, 0.0, 0.0), heading_rad=0.0)


def leader_state(**changed: Any) -> LeaderState:
    """Valid, flying to the east at 8 m/s, 30 m north of us."""
    fields: dict[str, Any] = {
        "t_ns": T,
        "t_host_ns": 1_800_000_000 * S,
        "sequence": 5,
        "state": Lifecycle.TRACKING,
        "valid": True,
        "reason": "images fused",
        "r_OL_n": (130.0, 54.0, -38.0),
        "v_L_n": (0.0, 8.0, -1.0),
        "a_L_n": (0.0, 0.0, 0.0),
        "covariance": tuple(
            tuple(v if i == j else 0.0 for j in range(6)) for i, v in enumerate((4.0, 9.0, 1.0, 0.25, 0.16, 0.09))
        ),
        "r_FL_n": (30.0, 4.0, 2.0),
        "r_FL_covariance": ((2.25, 0.0, 0.0), (0.0, 6.25, 0.0), (0.0, 0.0, 0.25)),
        "lat_deg": 47.4,
        "lon_deg": -8.5,
        "alt_msl": 538.0,
        "course": 1.5707963267948966,
        "size": 2.5,
        "age": 0.5,
    }
    return LeaderState(**fields | changed)


def lost_state() -> LeaderState:
    """Not valid."""
    return LeaderState(
        t_ns=T,
        t_host_ns=T,
        sequence=6,
        state=Lifecycle.LOST,
        valid=False,
        cause=Cause.TIMEOUT,
        reason="no image fused lately",
    )
