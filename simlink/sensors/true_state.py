"""The true state that an autopilot in simulation sends."""

from onboard.geometry.geodesy import geodetic_from_ned
from onboard.messages import Clock, VehicleTruth
from simlink.scenarios.vehicle import Vehicle
from simlink.sensors.navigation import Reading


def true_state(vehicle: Vehicle, t_ns: int, reading: Reading) -> VehicleTruth | None:
    """The truth behind a reading at boot time `t_ns`, on the clock of the vehicle's message; None: not known."""
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
