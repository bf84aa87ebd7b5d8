"""The autopilot's side of one MAVLink link: periodic messages and replies to commands.

As on a real autopilot, message intervals belong to one link. All times are on the boot clock.
"""

import math
from collections.abc import Callable, Iterable
from functools import partial
from typing import Final

from onboard.geometry.geodesy import geodetic_from_ned
from onboard.messages import (
    ActuatorOutputs,
    Attitude,
    Battery,
    Clock,
    Command,
    CommandAck,
    CurrentMode,
    GlobalOrigin,
    GlobalPosition,
    GpsFix,
    Heartbeat,
    Imu,
    LandedState,
    LocalPosition,
    Message,
    Setpoint,
    SystemTime,
    TimeSync,
)
from onboard.units import S_PER_NS
from onboard.wire.mavlink.decode import MavlinkDecoder
from onboard.wire.mavlink.encode import MavlinkEncoder
from simlink.scenarios.vehicle import Vehicle
from simlink.sensors.navigation import Reading
from simlink.sensors.true_state import ENCODE, true_state
from simlink.world.constants import GRAVITY, STEP_NS
from simlink.world.setpoint_mode import SetpointMode, Target

SET_MESSAGE_INTERVAL: Final = 511  # MAV_CMD
REQUEST_MESSAGE: Final = 512  # MAV_CMD
ACCEPTED, DENIED, UNSUPPORTED, FAILED = 0, 2, 3, 4  # MAV_RESULT
VEHICLE_TYPE: Final = {"fixed_wing": 1, "quadrotor": 2}  # MAV_TYPE
AUTOPILOT: Final = {"ardupilot": 3, "px4": 12}  # MAV_AUTOPILOT
ACTIVE: Final = 4  # MAV_STATE
NO_FIX, FIX_3D = 1, 3  # GPS_FIX_TYPE
HOVER_PULSE_WIDTH_US: Final = 1500
PULSE_WIDTH_PER_G_US: Final = 400

HEARTBEAT, SYS_STATUS, SYSTEM_TIME, GPS_RAW_INT, ATTITUDE_QUATERNION = 0, 1, 2, 24, 31
LOCAL_POSITION_NED, GLOBAL_POSITION_INT, SERVO_OUTPUT_RAW, GPS_GLOBAL_ORIGIN, HIGHRES_IMU = 32, 33, 36, 49, 105
SIM_STATE, HIL_STATE_QUATERNION, EXTENDED_SYS_STATE, CURRENT_MODE = 108, 115, 245, 436
TRUTH: Final = {"ardupilot": SIM_STATE, "px4": HIL_STATE_QUATERNION}  # where each sends its true state


class Autopilot:
    """The MAVLink session of one link; `unix_epoch_ns` is the Unix time at boot."""

    def __init__(self, vehicle: Vehicle, unix_epoch_ns: int, mode: SetpointMode | None = None) -> None:
        self._vehicle, self._mode = vehicle, mode
        self._unix_epoch_ns = unix_epoch_ns
        self._default = _default_intervals(vehicle, leads=mode is not None)
        self._custom_mode = self._reported_mode
        self._interval = dict(self._default)  # ns by message number; 0: not sent
        self._due = dict.fromkeys(self._interval, 0)
        self._latest: Reading | None = None
        self._make: dict[int, Callable[[int, Reading], Message | None]] = {
            GPS_RAW_INT: self._gps,
            ATTITUDE_QUATERNION: _attitude,
            LOCAL_POSITION_NED: _local_position,
            GLOBAL_POSITION_INT: self._global_position,
            SERVO_OUTPUT_RAW: _servo,
            GPS_GLOBAL_ORIGIN: self._origin,
            HIGHRES_IMU: _imu,
            SYS_STATUS: _battery,
            EXTENDED_SYS_STATE: _in_the_air,
            CURRENT_MODE: self._current_mode,
            TRUTH[vehicle.autopilot]: partial(true_state, vehicle),
        }

    def due(self, t_ns: int, reading: Reading | None) -> list[Message]:
        """Return the messages to send at `t_ns`; call it once per step of the world.

        Before the flight there is no reading, and only HEARTBEAT and SYSTEM_TIME are sent.
        """
        self._latest = reading
        if self._custom_mode != (mode := self._reported_mode):
            self._custom_mode = mode
            if self._vehicle.autopilot == "ardupilot":  # which reports a change at once
                self._due[HEARTBEAT] = t_ns
        messages = []
        for number, interval in self._interval.items():
            if interval == 0 or t_ns < self._due[number]:
                continue
            message = self._message(number, t_ns)
            if message is None:
                continue
            messages.append(message)
            # counted from the due time, so that the rate holds on average; from now after a pause
            due = self._due[number] + interval
            self._due[number] = due if due > t_ns else t_ns + interval
        return messages

    def answer(self, message: Message, t_ns: int) -> list[Message]:
        """Return the replies to a message that arrived at `t_ns`."""
        if isinstance(message, TimeSync) and message.tc1_ns == 0:
            return [TimeSync(t_ns=t_ns, t_recv_ns=t_ns, tc1_ns=t_ns, ts1_ns=message.ts1_ns)]
        if not isinstance(message, Command):
            return []
        ours = (self._vehicle.system, self._vehicle.component)
        if message.target_system not in (0, ours[0]) or message.target_component not in (0, ours[1]):
            return []
        result, replies = self._execute(message, t_ns)
        ack = CommandAck(
            t_ns=t_ns,
            t_recv_ns=t_ns,
            target_system=message.system,
            target_component=message.component,
            command=message.command,
            result=result,
        )
        return [ack, *replies]

    def _execute(self, command: Command, t_ns: int) -> tuple[int, list[Message]]:
        """Execute a command; return its MAV_RESULT and the messages that it requests."""
        if command.command not in (SET_MESSAGE_INTERVAL, REQUEST_MESSAGE):
            return UNSUPPORTED, []
        number = command.params[0]
        if number not in self._interval:
            return DENIED, []
        if command.command == REQUEST_MESSAGE:
            message = self._message(int(number), t_ns)
            return (ACCEPTED, [message]) if message is not None else (FAILED, [])
        interval_us = command.params[1]
        if not math.isfinite(interval_us) or interval_us < -1:
            return DENIED, []
        self._set_interval(int(number), interval_us, t_ns)
        return ACCEPTED, []

    def _set_interval(self, number: int, interval_us: float, t_ns: int) -> None:
        if interval_us == 0:
            self._interval[number] = self._default[number]
        elif interval_us < 0:
            self._interval[number] = 0
        else:
            self._interval[number] = max(round(interval_us * 1000), STEP_NS)
        self._due[number] = t_ns

    def _message(self, number: int, t_ns: int) -> Message | None:
        """Return the message of this number, or None if it needs a reading and there is none yet."""
        if number == HEARTBEAT:
            return Heartbeat(
                t_ns=t_ns,
                t_recv_ns=t_ns,
                vehicle_type=VEHICLE_TYPE[self._vehicle.type],
                autopilot=AUTOPILOT[self._vehicle.autopilot],
                armed=True,
                status=ACTIVE,
                custom_mode=self._reported_mode,
            )
        if number == SYSTEM_TIME:
            return SystemTime(t_ns=t_ns, t_recv_ns=t_ns, unix_ns=self._unix_epoch_ns + t_ns)
        if self._latest is None:
            return None
        return self._make[number](t_ns, self._latest)

    @property
    def _reported_mode(self) -> int:
        return 0 if self._mode is None else self._mode.custom_mode

    def _current_mode(self, t_ns: int, _: Reading) -> Message | None:
        if self._mode is None:
            return None
        modes = {"custom_mode": self._mode.custom_mode, "intended_mode": self._mode.intended_mode}
        return CurrentMode(t_ns=t_ns, t_recv_ns=t_ns, clock=Clock.NONE, **modes)

    def _origin(self, t_ns: int, _: Reading) -> Message:
        lat_deg, lon_deg, height = self._vehicle.origin
        return GlobalOrigin(t_ns=t_ns, t_recv_ns=t_ns, lat_deg=lat_deg, lon_deg=lon_deg, alt_msl=height)

    def _gps(self, t_ns: int, reading: Reading) -> Message:
        if not reading.gps_fix:
            return GpsFix(
                t_ns=t_ns,
                t_recv_ns=t_ns,
                fix_type=NO_FIX,
                satellites=0,
                lat_deg=0.0,
                lon_deg=0.0,
                alt_msl=0.0,
                ground_speed=None,
                course_rad=None,
                h_acc=None,
                v_acc=None,
            )
        lat_deg, lon_deg, height = geodetic_from_ned(reading.gps_r_OF_n, self._vehicle.origin)
        north, east, down = reading.gps_v_F_n
        return GpsFix(
            t_ns=t_ns,
            t_recv_ns=t_ns,
            fix_type=FIX_3D,
            satellites=14,
            lat_deg=lat_deg,
            lon_deg=lon_deg,
            alt_msl=height,
            ground_speed=math.hypot(north, east),
            course_rad=math.atan2(east, north),
            h_acc=1.5,
            v_acc=2.0,
            v_down=down,
        )

    def _global_position(self, t_ns: int, reading: Reading) -> Message:
        r_OF_n = reading.position_r_OF_n
        lat_deg, lon_deg, height = geodetic_from_ned(r_OF_n, self._vehicle.origin)
        w, x, y, z = reading.q_nb
        heading = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
        return GlobalPosition(
            t_ns=t_ns,
            t_recv_ns=t_ns,
            lat_deg=lat_deg,
            lon_deg=lon_deg,
            alt_msl=height,
            height=-r_OF_n[2],
            v_F_n=reading.position_v_F_n,
            heading_rad=heading,
        )


def _default_intervals(vehicle: Vehicle, *, leads: bool) -> dict[int, int]:
    """Return the intervals in ns by message number, in the order of sending within a step.

    With `leads` the vehicle flies on setpoints, and a PX4 then sends its state and mode without a request.
    """
    rates = vehicle.rates
    table = {
        HEARTBEAT: rates.heartbeat,
        SYSTEM_TIME: rates.system_time,
        HIGHRES_IMU: rates.imu,
        ATTITUDE_QUATERNION: rates.attitude,
        LOCAL_POSITION_NED: rates.local_position,
        GLOBAL_POSITION_INT: rates.global_position,
        GPS_RAW_INT: rates.gps,
        SERVO_OUTPUT_RAW: rates.servo,
        SYS_STATUS: rates.battery,
        GPS_GLOBAL_ORIGIN: 0,  # on request, as the truth
        TRUTH[vehicle.autopilot]: 0,
        EXTENDED_SYS_STATE: 1.0 if leads and vehicle.autopilot == "px4" else 0,
    }
    if vehicle.autopilot == "px4":
        table[CURRENT_MODE] = 0.5 if leads else 0
    return {number: round(1e9 / rate) if rate > 0 else 0 for number, rate in table.items()}


def _attitude(t_ns: int, reading: Reading) -> Message:
    return Attitude(t_ns=t_ns, t_recv_ns=t_ns, q_nb=reading.q_nb, omega_b=reading.omega_b)


def _local_position(t_ns: int, reading: Reading) -> Message:
    return LocalPosition(t_ns=t_ns, t_recv_ns=t_ns, r_OF_n=reading.position_r_OF_n, v_F_n=reading.position_v_F_n)


def _imu(t_ns: int, reading: Reading) -> Message:
    return Imu(
        t_ns=t_ns,
        t_recv_ns=t_ns,
        f_b=reading.imu_f_b,
        omega_b=reading.imu_omega_b,
        pressure_altitude=reading.pressure_altitude,
    )


def _battery(t_ns: int, reading: Reading) -> Message | None:
    volts = reading.voltage_v
    return None if volts is None else Battery(t_ns=t_ns, t_recv_ns=t_ns, clock=Clock.NONE, voltage_v=volts)


def _in_the_air(t_ns: int, _: Reading) -> Message:
    return LandedState(t_ns=t_ns, t_recv_ns=t_ns, clock=Clock.NONE, on_ground=False)


def _servo(t_ns: int, reading: Reading) -> Message:
    """Return a quadrotor's motor commands, else four outputs that follow the load factor."""
    if reading.pwm_us is not None:
        return ActuatorOutputs(t_ns=t_ns, t_recv_ns=t_ns, clock=Clock.BOOT, pwm_us=reading.pwm_us)
    load = -reading.imu_f_b[2] / GRAVITY
    pwm = min(max(round(HOVER_PULSE_WIDTH_US + PULSE_WIDTH_PER_G_US * (load - 1.0)), 1000), 2000)
    return ActuatorOutputs(t_ns=t_ns, t_recv_ns=t_ns, clock=Clock.BOOT, pwm_us=(pwm,) * 4)


class AutopilotLink:
    """The session of one link in bytes.

    With `stream` (TCP) frames may be split anywhere. `mode` receives the setpoints.
    """

    def __init__(
        self, vehicle: Vehicle, unix_epoch_ns: int, *, stream: bool, mode: SetpointMode | None = None
    ) -> None:
        self._vehicle, self._mode = vehicle, mode
        self._autopilot = Autopilot(vehicle, unix_epoch_ns, mode)
        self._encoder = MavlinkEncoder(vehicle.system, vehicle.component, ENCODE)
        self._decoder = MavlinkDecoder(stream=stream)

    def send(self, t_ns: int, reading: Reading | None) -> list[bytes]:
        """Return the frames due at `t_ns`."""
        return self._encode(self._autopilot.due(t_ns, reading))

    def receive(self, data: bytes, t_ns: int) -> list[bytes]:
        """Return the replies to `data`, which arrived at `t_ns`; invalid bytes are ignored."""
        replies: list[bytes] = []
        for message in self._decoder.decode(data, t_ns):
            if isinstance(message, Setpoint) and self._mode is not None:
                self._aim(message, t_ns, self._mode)
            replies += self._encode(self._autopilot.answer(message, t_ns))
        return replies

    def _aim(self, message: Setpoint, t_ns: int, mode: SetpointMode) -> None:
        to = (message.target_system, message.target_component)
        if to[0] in (0, self._vehicle.system) and to[1] in (0, self._vehicle.component):
            target = Target(message.r_OF_n, message.v_F_n, message.a_F_n, message.yaw, message.yaw_rate)
            mode.receive(target, (t_ns - mode.begin_ns) * S_PER_NS)

    def _encode(self, messages: Iterable[Message]) -> list[bytes]:
        return [self._encoder.encode(message) for message in messages]
