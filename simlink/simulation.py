"""One run, step by step: world, sensors, traffic. It depends on scenario and seed alone.

A run has three forms, from ideal to realistic. Studies have a fourth, arrays
(`studies/relative_motion/flight.py`).

    ticks(scenario, seed, boot_ns)       endless steps of 5 ms: for the server
    simulate(scenario, seed, duration)   records with the times at which they are sent
    datagrams(scenario, seed, duration)  bytes with arrival times: the input of `Pipeline.feed`
"""

from collections import deque
from collections.abc import Callable, Iterator
from itertools import islice
from typing import Final, Generic, Literal, NamedTuple, TypeVar

import msgspec

from onboard.messages import (
    CameraDetections,
    CameraPoints,
    Datagram,
    DistanceReading,
    Encoding,
    GimbalAttitude,
    Message,
    Pseudoranges,
    RadarDetections,
    Record,
    TargetPoints,
    TrafficTruth,
    Truth,
)
from onboard.units import NS_PER_S
from onboard.wire.mavlink.encode import MavlinkEncoder
from onboard.wire.mavlink.frame import frame_length
from simlink.autopilot import Autopilot, AutopilotLink
from simlink.scenarios.camera import is_plain
from simlink.scenarios.scenario import Scenario, ScenarioError
from simlink.sensors.camera import Image, document, is_exposure, target_points
from simlink.sensors.detector import Vision
from simlink.sensors.gimbal import make_gimbal
from simlink.sensors.navigation import Reading, readings
from simlink.sensors.rangefinder import RangefinderSensor
from simlink.traffic.reports import sender
from simlink.traffic.traffic import Traffic, TrafficOutput
from simlink.world.constants import STEP_NS, step_count
from simlink.world.drawn import draw_scenario
from simlink.world.guided import GuidedMode
from simlink.world.noise import uniforms
from simlink.world.offboard import OffboardMode
from simlink.world.setpoint_mode import SetpointMode
from simlink.world.truth import State, states, true_size, truth_record

T = TypeVar("T")
CameraLink = Literal["zenoh", "mavlink", "none"]
Detect = Callable[[State, int], Image | None]
CAMERA_COMPONENT_ID: Final = 191
EPOCH_NS: Final = 1_735_689_600 * 10**9  # 2025-01-01: Unix time at boot of runs without a real clock
TRANSPORT_LATENCY_NS: Final = 1_000_000
TRANSPORT_SPREAD_NS: Final = 1_000_000
# Channel and encoding of the records that are published as JSON.
JSON_CHANNELS: Final[dict[type[Record], tuple[str, Encoding]]] = {
    CameraPoints: ("points", Encoding.POINTS),
    CameraDetections: ("points", Encoding.DETECTIONS),
    RadarDetections: ("radar", Encoding.RADAR),
    Pseudoranges: ("gnss", Encoding.RANGES),
}


class Tick(NamedTuple):
    """One step of a run; `truth` is set at exposures only, `images` are those delivered at it."""

    t_ns: int  # boot clock
    state: State
    reading: Reading
    truth: Truth | None
    images: tuple[Image, ...]
    traffic: TrafficOutput = TrafficOutput()
    gimbal: GimbalAttitude | None = None
    distance: DistanceReading | None = None


class Event(NamedTuple):
    """A record that leaves the simulated vehicle at `t_ns` (boot clock).

    `sender` is the MAVLink system and component of records that are not the autopilot's own.
    """

    t_ns: int
    message: Message | CameraPoints | CameraDetections | RadarDetections | Pseudoranges | Truth | TrafficTruth
    sender: tuple[int, int] | None = None


class InTransit(Generic[T]):
    """A queue of items that have left a sensor and are delivered after its latency, in order."""

    def __init__(self, latency: float) -> None:
        self._latency_ns = round(latency * NS_PER_S)
        self._waiting: deque[tuple[int, T]] = deque()

    def put(self, t_ns: int, item: T) -> None:
        """Add an item that leaves now."""
        self._waiting.append((t_ns + self._latency_ns, item))

    def due(self, t_ns: int) -> tuple[T, ...]:
        """Remove and return the items delivered by now."""
        found = []
        while self._waiting and self._waiting[0][0] <= t_ns:
            found.append(self._waiting.popleft()[1])
        return tuple(found)


def boot_time_ns(scenario: Scenario) -> int:
    """Return the boot clock when the flight begins: a whole number of steps."""
    return step_count(scenario.vehicle.boot) * STEP_NS


def setpoint_mode(scenario: Scenario) -> SetpointMode | None:
    """Return the mode in which the scenario's autopilot follows, or None if it does not."""
    if scenario.follow is None:
        return None
    return (OffboardMode if scenario.vehicle.autopilot == "px4" else GuidedMode)(scenario.follow)


def ticks(
    scenario: Scenario, seed: int, boot_ns: int, world: Iterator[State] | None = None, detect: Detect | None = None
) -> Iterator[Tick]:
    """Yield the run, 200 ticks per second, without end.

    The flight begins at boot time `boot_ns`. `world` replaces the states that follow from scenario and seed.
    `detect` replaces the own detector: it takes a state and a stamp (ns, boot clock) and returns an image.
    """
    scenario = draw_scenario(scenario, seed)
    size = true_size(scenario, seed)
    gimbal, settings = make_gimbal(scenario.camera, seed), scenario.camera.gimbal
    mount = None if gimbal is None else gimbal.mount
    detect = detect or Vision(scenario, seed, size, mount).expose
    rangefinder = None
    if scenario.rangefinder is not None:
        rangefinder = RangefinderSensor(scenario.rangefinder, scenario.camera, seed, mount)
    rate, stamp_late_ns = scenario.camera.rate, round(scenario.camera.stamp_late * NS_PER_S)
    images: InTransit[Image] = InTransit(scenario.camera.latency)
    attitudes: InTransit[GimbalAttitude] = InTransit(0.0 if settings is None else settings.latency)
    traffic = Traffic(scenario, seed)
    for state, reading in readings(scenario, seed, world or states(scenario, seed)):
        t_ns = boot_ns + state.step * STEP_NS
        truth = None
        if is_exposure(state.step, rate):
            truth = truth_record(state, size, t_ns)
            image = detect(state, t_ns + stamp_late_ns)
            if image is not None:
                images.put(t_ns, image)
        if gimbal is not None and settings is not None and is_exposure(state.step, settings.rate):
            attitudes.put(t_ns, gimbal.attitude(state, t_ns, scenario.vehicle.system))
        distance = _distance(rangefinder, scenario, state, t_ns)
        reports = traffic.step(state, t_ns)
        (attitude,) = attitudes.due(t_ns) or (None,)  # no more than one leaves at a step
        yield Tick(t_ns, state, reading, truth, images.due(t_ns), reports, attitude, distance)


def _distance(
    rangefinder: RangefinderSensor | None, scenario: Scenario, state: State, t_ns: int
) -> DistanceReading | None:
    """Return the reading that the rangefinder sends at this step, or None."""
    settings = scenario.rangefinder
    if rangefinder is None or settings is None or not is_exposure(state.step, settings.rate):
        return None
    return rangefinder.measure(state, t_ns, scenario.vehicle.system)


def simulate(
    scenario: Scenario,
    seed: int,
    duration: float | None = None,
    camera: CameraLink = "zenoh",
    world: Iterator[State] | None = None,
) -> Iterator[Event]:
    """Yield all records that the vehicle sends in `duration` s, in order, and the truth.

    A `duration` of None is the scenario's; `world` is that of `ticks`. Images are CameraPoints or
    CameraDetections, or TargetPoints with `camera` "mavlink"; nothing is quantised. Raises ScenarioError for
    images that MAVLink does not carry.
    """
    if camera == "mavlink":
        check_mavlink(scenario)
    autopilot = Autopilot(scenario.vehicle, EPOCH_NS)
    steps = step_count(scenario.duration if duration is None else duration)
    for tick in islice(ticks(scenario, seed, boot_time_ns(scenario), world), steps + 1):
        if tick.truth is not None:
            yield Event(tick.t_ns, tick.truth)
        for message in autopilot.due(tick.t_ns, tick.reading):
            yield Event(tick.t_ns, message)
        for report in (tick.gimbal, tick.distance):
            if report is not None:
                yield Event(tick.t_ns, report, (report.system, report.component))
        for image in tick.images:
            if camera == "zenoh":
                yield Event(tick.t_ns, document(image, scenario.camera))
            elif camera == "mavlink":
                yield Event(tick.t_ns, target_points(image, scenario.camera))
        yield from _traffic_events(tick, scenario.vehicle.system)


def _traffic_events(tick: Tick, system: int) -> Iterator[Event]:
    reports, ranges, scan, truth = tick.traffic
    if truth is not None:
        yield Event(tick.t_ns, truth)
    for report in reports:
        yield Event(tick.t_ns, report, sender(report, system))
    for epoch in ranges:
        yield Event(tick.t_ns, epoch)
    if scan is not None:
        yield Event(tick.t_ns, scan)


def datagrams(
    scenario: Scenario,
    seed: int,
    duration: float | None = None,
    camera: CameraLink = "zenoh",
    world: Iterator[State] | None = None,
) -> Iterator[Datagram | Truth | TrafficTruth]:
    """Yield `simulate` as bytes with arrival times, in order, and the truth.

    Each Datagram is one MAVLink frame (channel "autopilot", images "camera") or one JSON document (channels
    "points", "radar", "gnss"), and arrives 1 to 2 ms after it was sent.
    """
    vehicle = scenario.vehicle
    encoder = MavlinkEncoder(vehicle.system, vehicle.component)
    vision = MavlinkEncoder(vehicle.system, CAMERA_COMPONENT_ID)
    traffic: dict[tuple[int, int], MavlinkEncoder] = {}
    jitter = uniforms(seed, "transport")
    t_recv_ns = 0
    for t_ns, message, source in simulate(scenario, seed, duration, camera, world):
        if isinstance(message, Truth | TrafficTruth):
            yield message
            continue
        t_recv_ns = max(
            t_recv_ns, EPOCH_NS + t_ns + TRANSPORT_LATENCY_NS + int(TRANSPORT_SPREAD_NS * next(jitter))
        )
        if not isinstance(message, Message):
            channel, encoding = JSON_CHANNELS[type(message)]
            yield _datagram(channel, encoding, t_recv_ns, msgspec.json.encode(message))
        elif isinstance(message, TargetPoints):
            for frame in split_frames(vision.encode(message)):
                yield _datagram("camera", Encoding.MAVLINK, t_recv_ns, frame)
        else:
            by = encoder if source is None else traffic.setdefault(source, MavlinkEncoder(*source))
            yield _datagram("autopilot", Encoding.MAVLINK, t_recv_ns, by.encode(message))


def check_mavlink(scenario: Scenario) -> None:
    """Raise ScenarioError if MAVLink cannot carry the camera's detections."""
    if scenario.camera.sees != "wing":
        sees = scenario.camera.sees
        raise ScenarioError(
            f"{scenario.name}: camera.sees is {sees!r}, but LANDING_TARGET carries 'wing' only; use Zenoh"
        )
    if not is_plain(scenario.camera):
        raise ScenarioError(
            f"{scenario.name}: camera: LANDING_TARGET carries no distortion, classes or ids; use Zenoh"
        )


class GuidedRun:
    """A run whose follower flies on the setpoints that it receives, in bytes and step by step.

    `detect` is that of `ticks`.
    """

    def __init__(self, scenario: Scenario, seed: int, detect: Detect | None = None) -> None:
        if (mode := setpoint_mode(scenario)) is None:
            raise ValueError(f"{scenario.name} has no [follow], which a guided run needs")
        self.mode = mode
        self._scenario = scenario
        self._link = AutopilotLink(scenario.vehicle, EPOCH_NS, stream=False, mode=self.mode)
        self.mode.begin_ns = boot_time_ns(scenario)
        world = states(scenario, seed, self.mode)
        self._ticks = ticks(scenario, seed, self.mode.begin_ns, world, detect)

    def step(self) -> tuple[Tick, list[Datagram]]:
        """Advance by 5 ms; return the tick and the datagrams for the companion computer."""
        tick = next(self._ticks)
        t_recv_ns = EPOCH_NS + tick.t_ns + TRANSPORT_LATENCY_NS
        frames = self._link.send(tick.t_ns, tick.reading)
        images = [document(image, self._scenario.camera) for image in tick.images]
        return tick, [
            *(_datagram("autopilot", Encoding.MAVLINK, t_recv_ns, data) for data in frames),
            *(_datagram(*JSON_CHANNELS[type(image)], t_recv_ns, msgspec.json.encode(image)) for image in images),
        ]

    def receive(self, data: bytes, tick: Tick) -> list[Datagram]:
        """Process bytes of the companion computer; return the autopilot's replies."""
        t_recv_ns = EPOCH_NS + tick.t_ns + TRANSPORT_LATENCY_NS
        replies = self._link.receive(data, tick.t_ns)
        return [_datagram("autopilot", Encoding.MAVLINK, t_recv_ns, reply) for reply in replies]


def _datagram(channel: str, encoding: Encoding, t_recv_ns: int, data: bytes) -> Datagram:
    return Datagram(channel=channel, encoding=encoding, t_recv_ns=t_recv_ns, data=data)


def split_frames(data: bytes) -> list[bytes]:
    """Split a sequence of whole MAVLink frames."""
    frames, at = [], 0
    while (length := frame_length(data, at)) is not None:
        frames.append(data[at : at + length])
        at += length
    return frames
