"""Reports of other aircraft: ADS-B, GLOBAL_POSITION_INT, pseudoranges."""

import heapq
import math
from typing import Final

from msgspec.structs import replace

from onboard.geometry.geodesy import geodetic_from_ned
from onboard.messages import AdsbVehicle, AltitudeType, Clock, GlobalPosition, Message, Pseudoranges, Vec3
from simlink.scenarios.scenario import Scenario
from simlink.scenarios.traffic import FIRST_ICAO, FIRST_SYSTEM_ID, Aircraft, Reports
from simlink.traffic.aircraft import Motion, level_at, rotate
from simlink.traffic.peer_gnss import RangesSensor
from simlink.world.attitude import add
from simlink.world.noise import gauss_markov_vectors, normals, uniforms

RECEIVER_COMPONENT_ID: Final = 156  # MAV_COMP_ID_ADSB
REPEAT_DURATION_S: Final = 10.0  # for which the ADS-B receiver repeats an aircraft's last report
DEGREE_LENGTH_M: Final = 111_195.0


class Transmitter:
    """The reports of one aircraft; `received` counts those that reach us.

    `errors` replaces those of the scenario's traffic.
    """

    def __init__(
        self, aircraft: Aircraft, number: int, scenario: Scenario, seed: int, errors: Reports | None = None
    ) -> None:
        self.aircraft = aircraft
        self.icao, self.system = FIRST_ICAO + number, FIRST_SYSTEM_ID + number
        self.received = 0
        name, origin = f"traffic.{aircraft.name}", scenario.vehicle.origin
        self._origin = origin
        self._is_peer = aircraft.says == "peer"
        self._errors = errors or (scenario.traffic.peer if self._is_peer else scenario.traffic.adsb)
        self._u, self._z = uniforms(seed, f"{name}.link"), normals(seed, f"{name}.noise")
        self._period = 1.0 / self._errors.rate
        self._position_error = gauss_markov_vectors(seed, f"{name}.gnss", self._errors.position, self._period)
        self._due = self._period * next(self._u)
        self._receiver: RangesSensor | None = None
        if aircraft.says == "ranges":
            receiver = scenario.traffic.receiver
            self._receiver = RangesSensor(receiver, self.system, origin, seed, name)
            self._range_period = 1.0 / receiver.rate
        self._receivable = True
        self._last: tuple[float, AdsbVehicle] | None = None  # flight time and content of the last ADS-B report
        self._in_transit: list[tuple[float, int, Message]] = []  # a heap by arrival time
        self._sent = 0

    @property
    def target(self) -> str:
        """The daemon's name of the aircraft; "" if it sends nothing."""
        peer = f"system/{self.system}"
        names = {"adsb": f"icao/{self.icao:06x}", "peer": peer, "ranges": peer, "nothing": ""}
        return names[self.aircraft.says]

    def step(self, t: float, motion: Motion) -> list[Message]:
        """Return the reports that reach our vehicle at flight time t (s)."""
        if self.aircraft.says in ("nothing", "ranges"):
            return []
        if t >= self._due:
            self._due += self._period
            self._transmit(t, motion)
        arrived = []
        while self._in_transit and self._in_transit[0][0] <= t:
            arrived.append(heapq.heappop(self._in_transit)[2])
        return arrived

    def ranges(self, t: float, t_ns: int, motion: Motion) -> list[Pseudoranges]:
        """Return the pseudoranges that its receiver shares at flight time t (s)."""
        if self._receiver is None or t < self._due:
            return []
        self._due += self._range_period
        measured = self._receiver.measure(t, t_ns, motion.r, motion.v)
        if measured is None:
            return []
        self.received += 1
        return [measured]

    def _transmit(self, t: float, motion: Motion) -> None:
        """Send a report; if it is lost, our ADS-B receiver repeats the last one."""
        e = self._errors
        low, high = e.latency
        delay, lost = low + (high - low) * next(self._u), next(self._u)
        self._receivable = lost >= e.p_lose if self._receivable else lost < e.p_regain
        position_error = next(self._position_error)
        off_from = self.aircraft.silent_from
        if self._receivable and (off_from is None or t < off_from):
            message = self._peer(motion, position_error) if self._is_peer else self._adsb(motion, position_error)
            self.received += 1
            if isinstance(message, AdsbVehicle):
                self._last = t, message
            self._post(t + delay, message)
        elif self._last is not None and t - self._last[0] < REPEAT_DURATION_S:
            self._post(t + delay, replace(self._last[1], tslc=float(math.floor(t + delay - self._last[0]))))

    def _post(self, t: float, message: Message) -> None:
        """Schedule a message to arrive at flight time t."""
        self._sent += 1
        heapq.heappush(self._in_transit, (t, self._sent, message))

    def _measured(self, motion: Motion, position_error: Vec3) -> tuple[tuple[float, float, float], Vec3, Vec3]:
        """Return the aircraft's own GNSS measurement.

        It is latitude, longitude (deg) and height (m), r_OT in n, and the velocity in NED at that place.
        """
        e, z = self._errors, self._z
        noise = (e.position_white * next(z), e.position_white * next(z), e.position_white * next(z))
        r = add(add(motion.r, position_error), noise)
        v = add(motion.v, (e.velocity_white * next(z), e.velocity_white * next(z), e.velocity_white * next(z)))
        lat_deg, lon_deg, height = geodetic_from_ned(r, self._origin)
        return (lat_deg, lon_deg, height), r, rotate(level_at(lat_deg, lon_deg, self._origin), v)

    def _adsb(self, motion: Motion, position_error: Vec3) -> AdsbVehicle:
        e = self._errors
        (lat_deg, lon_deg, height), _, v = self._measured(motion, position_error)
        step_deg = e.position_step / DEGREE_LENGTH_M
        wide_deg = step_deg / math.cos(math.radians(lat_deg))
        north, east = _quantised(v[0], e.velocity_step), _quantised(v[1], e.velocity_step)
        return AdsbVehicle(
            t_ns=0,
            t_recv_ns=0,
            clock=Clock.NONE,
            icao=self.icao,
            lat_deg=_quantised(lat_deg, step_deg),
            lon_deg=_quantised(lon_deg, wide_deg),
            altitude=_quantised(height, e.altitude_step),
            altitude_type=AltitudeType.GEOMETRIC,
            course=math.atan2(east, north) % (2 * math.pi),
            ground_speed=math.hypot(north, east),
            climb=_quantised(-v[2], e.climb_step),
            callsign=self.aircraft.name.upper()[:8],
            emitter=1,
        )

    def _peer(self, motion: Motion, position_error: Vec3) -> GlobalPosition:
        (lat_deg, lon_deg, height), r, v = self._measured(motion, position_error)
        return GlobalPosition(
            t_ns=0,
            t_recv_ns=0,
            system=self.system,
            lat_deg=lat_deg,
            lon_deg=lon_deg,
            alt_msl=height,
            height=-r[2],
            v_F_n=v,
            heading_rad=math.atan2(v[1], v[0]),
        )


def sender(message: Message, vehicle_system: int) -> tuple[int, int]:
    """Return (system, component) of the sender of a traffic message."""
    return (vehicle_system, RECEIVER_COMPONENT_ID) if isinstance(message, AdsbVehicle) else (message.system, 1)


def _quantised(value: float, step: float) -> float:
    return round(value / step) * step if step > 0 else value
