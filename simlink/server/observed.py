"""A vehicle simulated by another program, observed on a MAVLink link.

Its true states are on its own boot clock. ArduPilot's SIM_STATE has no time, and PX4 1.17 sends zero in
HIL_STATE_QUATERNION. They are requested at the interval of ATTITUDE_QUATERNION: the autopilot sends both in one
pass of its loop, and the truth takes the attitude's stamp.
"""

from bisect import bisect_right
from collections import deque
from typing import Final

from onboard.geometry.geodesy import ned_from_geodetic
from onboard.messages import Attitude, Clock, Command, Heartbeat, Message, Quaternion, Vec3
from onboard.units import NS_PER_S, S_PER_NS
from onboard.wire.mavlink.decode import MavlinkDecoder
from onboard.wire.mavlink.encode import MavlinkEncoder
from simlink.autopilot import ATTITUDE_QUATERNION as ATTITUDE
from simlink.autopilot import AUTOPILOT, SET_MESSAGE_INTERVAL, TRUTH
from simlink.sensors.true_state import CONVERT, VehicleTruth
from simlink.world.attitude import difference
from simlink.world.truth import Motion

TRUTH_RATE_HZ: Final = 50.0
OUR_SYSTEM, OUR_COMPONENT = 254, 191  # a ground station's number, so that we are no vehicle of the flight
ONBOARD_CONTROLLER, NO_AUTOPILOT, ACTIVE = 18, 8, 4  # MAV_TYPE, MAV_AUTOPILOT, MAV_STATE
REQUEST_PERIOD_NS: Final = NS_PER_S  # of heartbeats, and of requests while the truth is missing
HISTORY_LENGTH: Final = 200  # states: 4 s
OFFSET_GAIN: Final = 0.01  # of the mean clock offset: a time constant of 2 s
MIN_CLOCK_STEP_NS: Final = 500_000_000  # an offset this far from the mean starts a new mean
MAX_CLOCK_STEPS: Final = 3  # the start and reboots; more mean a clock of another speed
ACCELERATION_WINDOW_NS: Final = 100_000_000  # for the difference of velocities


class LocalFrame:
    """NED at the first position that it receives; all vehicles of a run share one."""

    def __init__(self) -> None:
        self._origin: Vec3 | None = None

    def ned(self, place: Vec3) -> Vec3:
        """Return the position in n of WGS-84 degrees and height (m)."""
        self._origin = self._origin or place
        north, east, down = ned_from_geodetic(place, self._origin).tolist()
        return north, east, down


class ObservedVehicle:
    """One vehicle, without I/O.

    `now_ns` is any monotonic clock, the same for all vehicles. With `stream` frames may be split anywhere.
    """

    def __init__(self, frame: LocalFrame, *, stream: bool) -> None:
        self._frame = frame
        self.sender: tuple[int, int] | None = None  # system and component of the autopilot
        self.offset_ns: float | None = None  # of `now_ns` from its boot clock, a mean that changes slowly
        self._autopilot = ""
        self._decoder = MavlinkDecoder(stream=stream, also=CONVERT)
        self._encoder = MavlinkEncoder(OUR_SYSTEM, OUR_COMPONENT)
        self._attitude_ns: int | None = None
        self._times: deque[int] = deque(maxlen=HISTORY_LENGTH)
        self._motions: deque[Motion] = deque(maxlen=HISTORY_LENGTH)
        self._truth_ns = -REQUEST_PERIOD_NS  # when the last true state came
        self._requested_ns = -REQUEST_PERIOD_NS
        self._jumps = 0  # of the difference of clocks

    @property
    def latest_ns(self) -> int | None:
        """Boot time of the last true state."""
        return self._times[-1] if self._times else None

    def missing(self, now_ns: int) -> str:
        """Describe what is missing at this time; an empty string means nothing."""
        if self.sender is None:
            return "no heartbeat of an autopilot has arrived"
        if now_ns - self._truth_ns < REQUEST_PERIOD_NS:
            wrong = "its clock and this computer's run at different speeds; set speedup 1 and reduce the load"
            return wrong if self._jumps > MAX_CLOCK_STEPS else ""
        name, message = {"ardupilot": ("ArduPilot", "SIM_STATE"), "px4": ("PX4", "HIL_STATE_QUATERNION")}[
            self._autopilot
        ]
        return f"{name}, system {self.sender[0]}, sends no {message}; only simulated vehicles do"

    def receive(self, data: bytes, now_ns: int) -> None:
        """Process bytes that arrived; messages of other systems on the link are ignored."""
        for message in self._decoder.decode(data, now_ns):
            if isinstance(message, Heartbeat) and self.sender is None:
                self._identify(message)
            if (message.system, message.component) != self.sender:
                continue
            if isinstance(message, Attitude):
                self._attitude_ns = message.t_ns
            elif isinstance(message, VehicleTruth):
                t_ns = self._attitude_ns if message.clock is Clock.NONE else message.t_ns
                if t_ns is not None:
                    self._add(message, t_ns, now_ns)

    def _identify(self, message: Heartbeat) -> None:
        kinds = {number: name for name, number in AUTOPILOT.items()}
        if message.autopilot in kinds:
            self.sender, self._autopilot = (message.system, message.component), kinds[message.autopilot]

    def _add(self, message: VehicleTruth, t_ns: int, now_ns: int) -> None:
        self._truth_ns = now_ns
        if self._times and t_ns < self._times[-1] - MIN_CLOCK_STEP_NS:  # rebooted
            self._times.clear()
            self._motions.clear()
        if self._times and t_ns <= self._times[-1]:
            return
        offset = now_ns - t_ns
        if self.offset_ns is None or abs(offset - self.offset_ns) > MIN_CLOCK_STEP_NS:
            self._jumps += 1
            self.offset_ns = float(offset)
        self.offset_ns += OFFSET_GAIN * (offset - self.offset_ns)
        r_n = self._frame.ned((message.lat_deg, message.lon_deg, message.height))
        motion = Motion(r_n, message.v_n, self._acceleration(message.v_n, t_ns), message.q_nb, message.omega_b)
        self._times.append(t_ns)
        self._motions.append(motion)

    def _acceleration(self, v_n: Vec3, t_ns: int) -> Vec3:
        """Return the mean acceleration over the last `ACCELERATION_WINDOW_NS`."""
        for before, motion in zip(self._times, self._motions, strict=True):
            if t_ns - before <= ACCELERATION_WINDOW_NS + MIN_CLOCK_STEP_NS // 50:
                x, y, z = difference(v_n, motion.v_n)
                span = (t_ns - before) * S_PER_NS
                return x / span, y / span, z / span
        return 0.0, 0.0, 0.0

    def requests(self, now_ns: int) -> list[bytes]:
        """Return the due frames: heartbeats, and requests for missing truth."""
        if now_ns - self._requested_ns < REQUEST_PERIOD_NS:
            return []
        self._requested_ns = now_ns
        messages: list[Message] = [
            Heartbeat(
                t_ns=0,
                t_recv_ns=0,
                vehicle_type=ONBOARD_CONTROLLER,
                autopilot=NO_AUTOPILOT,
                armed=False,
                status=ACTIVE,
            )
        ]
        if self.sender is not None and now_ns - self._truth_ns >= REQUEST_PERIOD_NS:
            messages += [self._interval(number) for number in (ATTITUDE, TRUTH[self._autopilot])]
        return [self._encoder.encode(message) for message in messages]

    def _interval(self, number: int) -> Command:
        system, component = self.sender or (0, 0)
        return Command(
            t_ns=0,
            t_recv_ns=0,
            target_system=system,
            target_component=component,
            command=SET_MESSAGE_INTERVAL,
            params=(float(number), 1e6 / TRUTH_RATE_HZ, 0.0, 0.0, 0.0, 0.0, 0.0),
        )

    def at(self, t_ns: float) -> Motion | None:
        """Interpolate the state at a boot time; None if it is not between two true states."""
        times = self._times
        after = bisect_right(times, t_ns)
        if not 0 < after < len(times):
            return None
        one, two = self._motions[after - 1], self._motions[after]
        span = (times[after] - times[after - 1]) * S_PER_NS
        s = (t_ns - times[after - 1]) * S_PER_NS / span
        return Motion(
            _interpolate_position(one.r_n, two.r_n, one.v_n, two.v_n, s, span),
            _interpolate(one.v_n, two.v_n, s),
            _interpolate(one.a_n, two.a_n, s),
            _interpolate_attitude(one.q_nb, two.q_nb, s),
            _interpolate(one.omega_b, two.omega_b, s),
        )


def _interpolate(a: Vec3, b: Vec3, s: float) -> Vec3:
    x, y, z = ((1.0 - s) * p + s * q for p, q in zip(a, b, strict=True))
    return x, y, z


def _interpolate_position(a: Vec3, b: Vec3, v_a: Vec3, v_b: Vec3, s: float, span: float) -> Vec3:
    """Return a cubic through two positions and velocities, at the share `s` of `span` (s)."""
    h00, h10 = (1.0 + 2.0 * s) * (1.0 - s) ** 2, s * (1.0 - s) ** 2 * span
    h01, h11 = s * s * (3.0 - 2.0 * s), s * s * (s - 1.0) * span
    x, y, z = (h00 * p + h10 * u + h01 * q + h11 * w for p, u, q, w in zip(a, v_a, b, v_b, strict=True))
    return x, y, z


def _interpolate_attitude(a: Quaternion, b: Quaternion, s: float) -> Quaternion:
    """Interpolate between two attitudes that are close to each other."""
    sign = 1.0 if sum(p * q for p, q in zip(a, b, strict=True)) >= 0.0 else -1.0
    mixed = [(1.0 - s) * p + s * sign * q for p, q in zip(a, b, strict=True)]
    length = sum(x * x for x in mixed) ** 0.5
    w, x, y, z = (part / length for part in mixed)
    return w, x, y, z
