"""Other aircraft around ours: how they move, what they say of themselves, and what our radar sees of them.

Their dynamics are their own: a course that a lateral acceleration turns, a speed, a climb, and turbulence in the
velocity. Everything random is of the seed and of one aircraft or sensor, so that one more aircraft leaves the
others as they were. Frames are those of `onboard.geometry`; O is the scenario's origin.
"""

import heapq
import math
from collections.abc import Iterator
from typing import Final, NamedTuple

from msgspec.structs import replace

from onboard.geometry.geodesy import geodetic_from_ned, rotation_ne
from onboard.messages import (
    AdsbVehicle,
    AltitudeType,
    Clock,
    GlobalPosition,
    IntruderTruth,
    Message,
    Pseudoranges,
    RadarDetections,
    TrafficTruth,
    Vec3,
)
from simlink.scenarios.scenario import Scenario
from simlink.scenarios.scene import Aircraft
from simlink.sensors.navigation import add
from simlink.traffic.peer_gnss import RangesSensor
from simlink.traffic.radar import RadarSensor
from simlink.world.noise import gauss_markov, normals, uniforms
from simlink.world.truth import STEPS_PER_SECOND, State, difference

STRIDE: Final = 4  # steps of the world for one of the traffic: 50 Hz
DT: Final = STRIDE / STEPS_PER_SECOND
TRUTH_STRIDE: Final = 20  # 10 Hz
FIRST_ICAO: Final = 0x4B1A00
FIRST_SYSTEM: Final = 101
RECEIVER: Final = 156  # MAV_COMP_ID_ADSB
REPEATS: Final = 10.0  # s that a receiver goes on saying what it heard last
METRES_PER_DEGREE: Final = 111_195.0

Matrix = list[list[float]]


class Now(NamedTuple):
    """What the traffic has for the outside at one step."""

    said: tuple[Message, ...] = ()
    ranges: tuple[Pseudoranges, ...] = ()
    scan: RadarDetections | None = None
    truth: TrafficTruth | None = None


class Motion(NamedTuple):
    """Position from O and velocity, in n."""

    r: Vec3
    v: Vec3


def motions(aircraft: Aircraft, seed: int) -> Iterator[Motion]:
    """The aircraft at 50 Hz, without end."""
    draw = normals(seed, f"traffic.{aircraft.name}.start")
    spread = aircraft.start_sigma
    r = add(aircraft.start, (spread * next(draw), spread * next(draw), 0.2 * spread * next(draw)))
    course = math.radians(aircraft.course_deg + aircraft.course_sigma_deg * next(draw))
    gusts = [
        gauss_markov(
            normals(seed, f"traffic.{aircraft.name}.{axis}"),
            aircraft.turbulence.sigma,
            aircraft.turbulence.time,
            DT,
        )
        for axis in "xyz"
    ]
    lateral, t = aircraft.a_lat, 0.0
    before: Vec3 | None = None
    while True:
        gx, gy, gz = (next(g) for g in gusts)
        v = (
            aircraft.speed * math.cos(course) + gx,
            aircraft.speed * math.sin(course) + gy,
            -aircraft.climb + 0.5 * gz,
        )
        if before is not None:
            half = 0.5 * DT
            r = (
                r[0] + half * (v[0] + before[0]),
                r[1] + half * (v[1] + before[1]),
                r[2] + half * (v[2] + before[2]),
            )
        yield Motion(r, v)
        before = v
        phase = 2 * math.pi * t / lateral.period + math.radians(lateral.phase_deg)
        course += DT * (lateral.mean + lateral.amplitude * math.sin(phase)) / aircraft.speed
        t += DT


class Transmitter:
    """One aircraft's reports, as they reach us: ADS-B through a receiver of ours, or GLOBAL_POSITION_INT."""

    def __init__(self, aircraft: Aircraft, number: int, scenario: Scenario, seed: int) -> None:
        self.aircraft = aircraft
        self.icao, self.system = FIRST_ICAO + number, FIRST_SYSTEM + number
        self.received = 0
        name = f"traffic.{aircraft.name}"
        self._scenario = scenario
        self._is_peer = aircraft.says == "peer"
        self._errors = scenario.traffic.peer if self._is_peer else scenario.traffic.adsb
        self._u, self._z = uniforms(seed, f"{name}.link"), normals(seed, f"{name}.noise")
        self._period = 1.0 / self._errors.rate
        place = self._errors.position
        self._wander = [
            gauss_markov(normals(seed, f"{name}.gnss.{axis}"), place.sigma, place.time, self._period)
            for axis in "xyz"
        ]
        self._due = self._period * next(self._u)
        self._receiver: RangesSensor | None = None
        if aircraft.says == "ranges":
            receiver, origin = scenario.traffic.receiver, scenario.vehicle.origin
            self._receiver = RangesSensor(receiver, self.system, origin, seed, name)
            self._range_period = 1.0 / receiver.rate
        self._receivable = True
        self._heard: tuple[float, AdsbVehicle] | None = None
        self._on_the_way: list[tuple[float, int, Message]] = []
        self._sent = 0

    @property
    def target(self) -> str:
        """What a daemon may call it; nothing for who says nothing."""
        peer = f"system/{self.system}"
        names = {"adsb": f"icao/{self.icao:06x}", "peer": peer, "ranges": peer, "nothing": ""}
        return names[self.aircraft.says]

    def step(self, t: float, motion: Motion) -> list[Message]:
        """What reaches our vehicle at flight time t (s)."""
        if self.aircraft.says in ("nothing", "ranges"):
            return []
        if t >= self._due:
            self._due += self._period
            self._transmit(t, motion)
        arrived = []
        while self._on_the_way and self._on_the_way[0][0] <= t:
            arrived.append(heapq.heappop(self._on_the_way)[2])
        return arrived

    def ranges(self, t: float, t_ns: int, motion: Motion) -> list[Pseudoranges]:
        """What its receiver shares at flight time t (s)."""
        if self._receiver is None or t < self._due:
            return []
        self._due += self._range_period
        measured = self._receiver.measure(t, t_ns, motion.r, motion.v)
        if measured is None:
            return []
        self.received += 1
        return [measured]

    def _transmit(self, t: float, motion: Motion) -> None:
        """A report on its way; or, when there is none, the receiver's memory of the last."""
        e = self._errors
        low, high = e.latency
        delay, lost = low + (high - low) * next(self._u), next(self._u)
        self._receivable = lost >= e.p_lose if self._receivable else lost < e.p_regain
        wander = tuple(next(w) for w in self._wander)
        off_from = self.aircraft.silent_from
        if self._receivable and (off_from is None or t < off_from):
            message = self._peer(motion, wander) if self._is_peer else self._adsb(motion, wander)
            self.received += 1
            if isinstance(message, AdsbVehicle):
                self._heard = t, message
            self._post(t + delay, message)
        elif self._heard is not None and t - self._heard[0] < REPEATS:
            self._post(t + delay, replace(self._heard[1], tslc=float(math.floor(t + delay - self._heard[0]))))

    def _post(self, t: float, message: Message) -> None:
        self._sent += 1
        heapq.heappush(self._on_the_way, (t, self._sent, message))

    def _measured(self, motion: Motion, wander: tuple[float, ...]) -> tuple[Vec3, Vec3]:
        """Position and velocity as the aircraft's own GNSS has them."""
        e, z = self._errors, self._z
        noise = (e.position_white * next(z), e.position_white * next(z), e.position_white * next(z))
        r = add(add(motion.r, (wander[0], wander[1], wander[2])), noise)
        return r, add(
            motion.v, (e.velocity_white * next(z), e.velocity_white * next(z), e.velocity_white * next(z))
        )

    def _adsb(self, motion: Motion, wander: tuple[float, ...]) -> AdsbVehicle:
        e = self._scenario.traffic.adsb
        r, v = self._measured(motion, wander)
        lat_deg, lon_deg, height = geodetic_from_ned(r, self._scenario.vehicle.origin)
        v = turned(level_at(lat_deg, lon_deg, self._scenario.vehicle.origin), v)
        step_deg = e.position_step / METRES_PER_DEGREE
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

    def _peer(self, motion: Motion, wander: tuple[float, ...]) -> GlobalPosition:
        r, v = self._measured(motion, wander)
        lat_deg, lon_deg, height = geodetic_from_ned(r, self._scenario.vehicle.origin)
        v = turned(level_at(lat_deg, lon_deg, self._scenario.vehicle.origin), v)
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


class Traffic:
    """All other aircraft of a run. `step` once for each step of the world, in order."""

    def __init__(self, scenario: Scenario, seed: int) -> None:
        self._radar = scenario.traffic.radar
        self._origin = scenario.vehicle.origin
        aircraft = scenario.traffic.aircraft
        self._transmitters = [Transmitter(a, number, scenario, seed) for number, a in enumerate(aircraft)]
        self._motions = [motions(a, seed) for a in aircraft]
        self._sensor = RadarSensor(self._radar, seed)
        self._detections = [0] * len(self._motions)
        rate = self._radar.rate or STEPS_PER_SECOND  # 0: it is off
        self._scan_steps = max(round(STEPS_PER_SECOND / rate / STRIDE) * STRIDE, STRIDE)

    def step(self, state: State, t_ns: int) -> Now:
        """What there is at this state of the world, `t_ns` on the boot clock."""
        if not self._motions or state.step % STRIDE:
            return Now()
        now = [next(m) for m in self._motions]
        said: list[Message] = []
        for transmitter, motion in zip(self._transmitters, now, strict=True):
            said += transmitter.step(state.t, motion)
        scanning = self._radar.rate > 0 and state.step % self._scan_steps == 0
        ranges = tuple(
            epoch
            for transmitter, motion in zip(self._transmitters, now, strict=True)
            for epoch in transmitter.ranges(state.t, t_ns, motion)
        )
        if not scanning and state.step % TRUTH_STRIDE:
            return Now(tuple(said), ranges)
        # the autopilot's attitude is against the horizon where we are, and so is what the radar sees with it
        lat_deg, lon_deg, _ = geodetic_from_ned(state.r_OF_n, self._origin)
        level = level_at(lat_deg, lon_deg, self._origin)
        r = [turned(level, difference(m.r, state.r_OF_n)) for m in now]
        scan = truth = None
        if scanning:
            scan, seen = self._sensor.scan(state.t, t_ns, state.q_nF, r)
            self._detections = [count + hit for count, hit in zip(self._detections, seen, strict=True)]
        if state.step % TRUTH_STRIDE == 0:
            v = [turned(level, difference(m.v, state.v_F_n)) for m in now]
            truth = self._truth(t_ns, r, v)
        return Now(tuple(said), ranges, scan, truth)

    def _truth(self, t_ns: int, r: list[Vec3], v: list[Vec3]) -> TrafficTruth:
        intruders = tuple(
            IntruderTruth(
                name=transmitter.aircraft.name,
                target=transmitter.target,
                r_FT_n=r[i],
                v_FT_n=v[i],
                messages=transmitter.received,
                detections=self._detections[i],
            )
            for i, transmitter in enumerate(self._transmitters)
        )
        return TrafficTruth(t_ns=t_ns, intruders=intruders)


def level_at(lat_deg: float, lon_deg: float, origin: tuple[float, float, float]) -> Matrix:
    """The turn from NED at the origin to NED at a place: 10 km apart the two horizons are 1.6 mrad apart."""
    rows = rotation_ne(lat_deg, lon_deg) @ rotation_ne(origin[0], origin[1]).T
    return rows.tolist()  # type: ignore[no-any-return]  # of an array


def turned(matrix: Matrix, v: Vec3) -> Vec3:
    """matrix v."""
    x, y, z = (row[0] * v[0] + row[1] * v[1] + row[2] * v[2] for row in matrix)
    return x, y, z


def sender(message: Message, vehicle_system: int) -> tuple[int, int]:
    """(system, component) a traffic message comes from: our own ADS-B receiver, or another autopilot."""
    return (vehicle_system, RECEIVER) if isinstance(message, AdsbVehicle) else (message.system, 1)


def _quantised(value: float, step: float) -> float:
    return round(value / step) * step if step > 0 else value
