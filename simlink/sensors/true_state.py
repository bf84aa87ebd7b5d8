"""The true state that an autopilot sends in simulation.

It is SIM_STATE of ArduPilot or HIL_STATE_QUATERNION of PX4. No daemon reads them: a decoder and an encoder know
them only with `CONVERT` and `ENCODE`.
"""

from collections.abc import Callable
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from onboard.geometry.geodesy import geodetic_from_ned
from onboard.messages import Clock, Message, Quaternion, Vec3
from onboard.wire.mavlink.records import Convert, Layout
from simlink.scenarios.vehicle import Vehicle
from simlink.sensors.navigation import Reading

# q, roll, pitch, yaw, specific force, rates, degrees (too coarse), height, two deviations, velocity, degrees 1e-7
SIM_STATE: Final = Layout("<21f2i")
# time; q, rates; degrees 1e-7, height mm; velocity cm/s; two airspeeds; specific force
HIL_STATE_QUATERNION: Final = Layout("<Q7f3i3h2H3h", usec=0)


class VehicleTruth(Message, frozen=True, kw_only=True):
    """The true state of a simulated vehicle: WGS-84 degrees, m, m/s in n, body rates in rad/s.

    SIM_STATE of an ArduPilot has no time: its clock is NONE and `t_ns` the time of arrival. HIL_STATE_QUATERNION
    of a PX4 is on the boot clock.
    """

    lat_deg: float
    lon_deg: float
    height: float
    v_n: Vec3
    q_nb: Quaternion
    omega_b: Vec3


def true_state(vehicle: Vehicle, t_ns: int, reading: Reading) -> VehicleTruth | None:
    """Return the truth behind a reading at boot time `t_ns`, or None if it is unknown."""
    state = reading.state
    if state is None:
        return None
    lat_deg, lon_deg, height = geodetic_from_ned(state.r_OF_n, vehicle.origin)
    return VehicleTruth(
        t_ns=t_ns,
        t_recv_ns=t_ns,
        clock=Clock.NONE if vehicle.autopilot == "ardupilot" else Clock.BOOT,
        lat_deg=lat_deg,
        lon_deg=lon_deg,
        height=height,
        v_n=state.v_F_n,
        q_nb=state.q_nF,
        omega_b=state.omega_b,
    )


def _sim_state(f: tuple[Any, ...], h: dict[str, Any]) -> Message:
    lat, lon = f[21] * 1e-7, f[22] * 1e-7
    return VehicleTruth(**h, lat_deg=lat, lon_deg=lon, height=f[15], v_n=f[18:21], q_nb=f[0:4], omega_b=f[10:13])


def _hil_state(f: tuple[Any, ...], h: dict[str, Any]) -> Message:
    north, east, down = (0.01 * v for v in f[11:14])
    return VehicleTruth(
        **h,
        lat_deg=f[8] * 1e-7,
        lon_deg=f[9] * 1e-7,
        height=f[10] * 1e-3,
        v_n=(north, east, down),
        q_nb=f[1:5],
        omega_b=f[5:8],
    )


def _message(m: Any) -> list[Any]:
    lat, lon = round(m.lat_deg * 1e7), round(m.lon_deg * 1e7)
    if m.clock is Clock.NONE:
        angles_and_force = (0.0,) * 6
        coarse = (m.lat_deg, m.lon_deg, m.height, 0.0, 0.0)
        return [
            dialect.MAVLink_sim_state_message(*m.q_nb, *angles_and_force, *m.omega_b, *coarse, *m.v_n, lat, lon)
        ]
    speeds = (round(100.0 * v) for v in m.v_n)
    place = (lat, lon, round(1000.0 * m.height))
    return [
        dialect.MAVLink_hil_state_quaternion_message(
            m.t_ns // 1000, m.q_nb, *m.omega_b, *place, *speeds, 0, 0, 0, 0, 0
        )
    ]


CONVERT: Final[dict[str, tuple[Layout, Convert]]] = {
    "SIM_STATE": (SIM_STATE, _sim_state),
    "HIL_STATE_QUATERNION": (HIL_STATE_QUATERNION, _hil_state),
}
ENCODE: Final[dict[type[Message], Callable[[Any], list[Any]]]] = {VehicleTruth: _message}
