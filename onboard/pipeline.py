"""The heart: bytes in, estimates out. Synchronous and deterministic; no clock, no socket, no thread.

`feed = advance . decode`. Live, the daemon calls the two apart, because the session with the autopilot wants
the decoded messages too; a replay calls `feed`. Both run the same code on the same bytes.
"""

from collections import Counter, deque
from collections.abc import Callable, Iterable, Sequence
from typing import Final

from msgspec.structs import replace

from onboard.clocks import Clocks
from onboard.config import Config, source_delays_ns
from onboard.estimators import CountsVerdicts, EstimatorProtocol, load
from onboard.messages import (
    AdsbVehicle,
    Clock,
    Datagram,
    Encoding,
    Estimate,
    Fault,
    GlobalPosition,
    Health,
    Heartbeat,
    Lifecycle,
    Message,
    NavState,
    Output,
    PeerPosition,
    PeerRanges,
    RadarScan,
    SinkHealth,
    StreamHealth,
    TargetPoints,
    TimeSync,
)
from onboard.ownship import Ownship
from onboard.wire.document import BadDocumentError
from onboard.wire.mavlink_decode import MavlinkDecoder
from onboard.wire.points import decode_points
from onboard.wire.radar import decode_radar
from onboard.wire.ranges import decode_ranges

MAV_AUTOPILOT_INVALID: Final = 8
AUTOPILOT_NAMES: Final = {3: "ArduPilot", 12: "PX4"}
RATE_WINDOW_NS: Final = 2_000_000_000
MOST_WAITING: Final = 256
SILENT_NS: Final = (
    1_000_000_000  # own motion this long unheard of, by arrival: time stands still, and no estimate holds
)
DOCUMENTS: Final[dict[Encoding, Callable[[bytes, int], Message]]] = {
    Encoding.POINTS: decode_points,
    Encoding.RADAR: decode_radar,
    Encoding.RANGES: decode_ranges,
}
NO_SYSTEM: Final = 0  # a vision process on this computer: no MAVLink system
# stamped by a sensor, and of use once our own pose then is known
SENSED: Final = (TargetPoints, RadarScan, PeerRanges)
ANY_COMPONENT: Final = (*SENSED, AdsbVehicle)  # not of our own motion, so whoever of our vehicle sends it
UNSTAMPED: Final = (AdsbVehicle, PeerPosition)  # of use though they say no time we know: true at arrival


class Pipeline:
    """State lives in five places: the decoders' buffers, the clocks, ownship's history, the images that wait for
    our own pose to be known at their time, and each estimator."""

    def __init__(self, config: Config) -> None:
        self.clocks = Clocks()
        self.ownship = Ownship(max_extrapolation=config.ownship.max_extrapolation_s)
        self.estimators: dict[str, EstimatorProtocol] = {
            name: load(name).Estimator(section, config.camera_model())
            for name, section in config.estimator.items()
        }
        self._counting = {n: e for n, e in self.estimators.items() if isinstance(e, CountsVerdicts)}
        self._listeners: dict[type[Message], list[EstimatorProtocol]] = {}
        for name, estimator in self.estimators.items():
            for kind in load(name).LISTENS:
                self._listeners.setdefault(kind, []).append(estimator)
        self.autopilot: Heartbeat | None = None
        self._config = config
        self._waiting: list[Message] = []
        self._decoders: dict[str, MavlinkDecoder] = {}
        self._delays_ns: dict[type[Message], int] = {}
        self._rejected: Counter[str] = Counter()
        self._verdicts: Counter[str] = Counter()
        self._states: dict[str, Lifecycle] = {}
        self._faults: tuple[Fault, ...] = ()
        self._streams: dict[str, deque[int]] = {}
        self._counts: Counter[str] = Counter()
        self._first_recv_ns: int | None = None
        self._own_recv_ns = 0

    def feed(self, datagram: Datagram) -> list[Output]:
        """What one datagram makes known: estimates and own poses, in order."""
        return self.advance(self.decode(datagram))

    def decode(self, datagram: Datagram) -> list[Message]:
        """The messages in one datagram, in SI units; bad bytes are counted in `health().rejected`."""
        if self._first_recv_ns is None:
            self._first_recv_ns = datagram.t_recv_ns
        decode_document = DOCUMENTS.get(datagram.encoding)
        if decode_document is not None:
            try:
                return [decode_document(datagram.data, datagram.t_recv_ns)]
            except BadDocumentError:
                self._rejected[f"bad_{datagram.encoding}"] += 1
                return []
        decoder = self._decoders.get(datagram.channel)
        if decoder is None:
            decoder = MavlinkDecoder(stream=datagram.encoding is Encoding.MAVLINK_STREAM)
            self._decoders[datagram.channel] = decoder
        return decoder.decode(datagram.data, datagram.t_recv_ns)

    def advance(self, messages: Sequence[Message]) -> list[Output]:
        """Let messages act on clocks, ownship and estimators; what they make known."""
        outputs: list[Output] = []
        for message in messages:
            outputs.extend(self._advance(message))
        return outputs

    def is_ours(self, message: Message) -> bool:
        """Whether a message comes from our own vehicle (any component of it) or this computer."""
        return message.system == NO_SYSTEM or (
            self.autopilot is not None and message.system == self.autopilot.system
        )

    def _from_autopilot(self, message: Message) -> bool:
        return self.autopilot is not None and message.component == self.autopilot.component

    def _advance(self, message: Message) -> list[Output]:
        if isinstance(message, Heartbeat):
            self._latch(message)
        if not self.is_ours(message):
            peer = self._of_others(message)
            if peer is None:
                self._rejected["other_system" if self.autopilot else "before_heartbeat"] += 1
                return []
            message = peer
        elif not isinstance(message, ANY_COMPONENT) and not self._from_autopilot(message):
            self._rejected["other_component"] += 1  # a gimbal's attitude, a peer's clock: not our own motion
            return []
        elif isinstance(message, AdsbVehicle) and message.component == self._config.autopilot.component:
            self._rejected["our_own"] += 1  # what we have told of others, come back by another way
            return []
        self._count(message)
        if isinstance(message, TimeSync):
            self.clocks.receive_reply(message)
            return []
        if message.clock is Clock.NONE and not isinstance(message, UNSTAMPED):
            if isinstance(message, SENSED):
                self._rejected["unstamped_points"] += 1
            return []  # not stamped: commands, heartbeats, text; nothing to estimate from
        reboots = self.clocks.reboots
        aligned = self.clocks.align(message, self._delays_ns.get(type(message), 0))
        if aligned is None:
            return []
        if self.clocks.reboots > reboots:
            self._start_over()
        return self._estimate(aligned, aligned.t_ns + self._delays_ns.get(type(message), 0))

    def _of_others(self, message: Message) -> Message | None:
        """What another system says, if an estimator listens for it: where it is, or what its receiver hears."""
        if isinstance(message, GlobalPosition):
            message = PeerPosition(
                t_ns=message.t_recv_ns,
                t_recv_ns=message.t_recv_ns,
                clock=Clock.NONE,
                system=message.system,
                component=message.component,
                lat_deg=message.lat_deg,
                lon_deg=message.lon_deg,
                alt_msl=message.alt_msl,
                v_n=message.v_F_n,
            )
        wanted = self.autopilot is not None and isinstance(message, UNSTAMPED) and type(message) in self._listeners
        return message if wanted else None

    def _estimate(self, message: Message, stamp_ns: int) -> list[Output]:
        """Own motion moves every estimate on to now; anything else goes to whom it concerns."""
        if isinstance(message, SENSED) and self._must_wait(message):
            self._waiting.append(message)
            return []
        if not self.ownship.receive(message, stamp_ns):
            return self._observe(message)
        self._own_recv_ns = message.t_recv_ns
        outputs: list[Output] = []
        own = self.ownship.own_pose(self.ownship.now_ns)
        if own is not None:
            outputs.append(own)
        ready = [m for m in self._waiting if self._is_ready(m)]
        self._waiting = [m for m in self._waiting if not self._is_ready(m)]
        for waited in ready:
            outputs.extend(self._observe(waited))
        outputs.extend(self._observe(message))
        for estimator in self.estimators.values():
            outputs.extend(self._noted(estimator.tick(self.ownship)))
        return outputs

    def _observe(self, message: Message) -> list[Output]:
        """A message to the estimators that listen for its kind."""
        estimates: list[Estimate] = []
        for estimator in self._listeners.get(type(message), ()):
            estimates.extend(estimator.observe(message, self.ownship))
        if message.t_recv_ns - self._own_recv_ns > SILENT_NS:
            estimates = [
                e if isinstance(e, NavState) else replace(e, valid=False, reason="our own motion is not known")
                for e in estimates
            ]
        return self._noted(estimates)

    def _is_ready(self, waiting: Message) -> bool:
        """Whether our motion is known then, or has not become so for too long: a stream has stopped."""
        late_ns = self.ownship.now_ns - waiting.t_ns
        return self.ownship.knows(waiting.t_ns) or late_ns > self._config.ownship.max_lead_s * 1e9

    def _must_wait(self, image: Message) -> bool:
        """Whether an image is of a moment our own motion is not known at yet, but may soon be. A camera's clock
        may lead (recordings are found that do by half a second): what waits is not lost."""
        lead_ns = image.t_ns - self.ownship.now_ns
        own = self._config.ownship
        return (
            self.ownship.now_ns > 0
            and own.max_lead_s * 1e9 >= lead_ns > 0.5 * own.max_extrapolation_s * 1e9
            and len(self._waiting) < MOST_WAITING
        )

    def _latch(self, heartbeat: Heartbeat) -> None:
        """The first heartbeat of an autopilot says whose vehicle this is, and which stamps to mend."""
        wanted = self._config.autopilot.system
        if self.autopilot is not None or heartbeat.autopilot == MAV_AUTOPILOT_INVALID:
            return
        if wanted in {0, heartbeat.system}:
            self.autopilot = heartbeat
            self._delays_ns = source_delays_ns(self._config.delay, heartbeat.autopilot)

    def _start_over(self) -> None:
        """The autopilot has rebooted: its clock and its origin are new, so nothing kept still holds."""
        self.ownship = Ownship(max_extrapolation=self._config.ownship.max_extrapolation_s)
        self._waiting.clear()
        for estimator in self.estimators.values():
            estimator.reset("the autopilot has rebooted")

    def _count(self, message: Message) -> None:
        name = type(message).__name__
        self._counts[name] += 1
        window = self._streams.setdefault(name, deque())
        window.append(message.t_recv_ns)
        while not 0 <= message.t_recv_ns - window[0] <= RATE_WINDOW_NS:  # < 0: this computer's clock was set back
            window.popleft()

    def _noted(self, estimates: Iterable[Estimate]) -> list[Output]:
        """Estimates, counted for the health."""
        outputs: list[Output] = []
        for estimate in estimates:
            key = estimate.name if estimate.target == estimate.name else f"{estimate.name}.{estimate.target}"
            self._states[key] = estimate.state
            if estimate.state is Lifecycle.SEARCHING and key != estimate.name:
                del self._states[key]  # the last word on one of many, of which there may be any number in a flight
            if estimate.measurement is not None and estimate.name not in self._counting:
                self._verdicts[f"{estimate.name}.{estimate.measurement.verdict}"] += 1
            if isinstance(estimate, NavState):
                self._faults = estimate.faults
            outputs.append(estimate)
        return outputs

    # ------------------------------------------------------------------------------------------ health

    def frames(self) -> Counter[str]:
        """Well-formed MAVLink frames so far, by name."""
        total: Counter[str] = Counter()
        for decoder in self._decoders.values():
            total.update(decoder.names)
        return total

    def health(self, t_recv_ns: int, sinks: dict[str, SinkHealth] | None = None) -> Health:
        """How all this is doing, as of a time on this computer's clock."""
        offset = self.clocks.offset_ns
        round_trip = self.clocks.round_trip_ns
        name = "none"
        if self.autopilot is not None:
            kind = AUTOPILOT_NAMES.get(self.autopilot.autopilot, f"MAV_AUTOPILOT {self.autopilot.autopilot}")
            name = f"{kind}, system {self.autopilot.system}"
        return Health(
            t_ns=t_recv_ns - offset if offset is not None else 0,
            t_recv_ns=t_recv_ns,
            uptime=(t_recv_ns - (self._first_recv_ns or t_recv_ns)) * 1e-9,
            autopilot=name,
            autopilot_reboots=self.clocks.reboots,
            clock_source=self.clocks.source,
            clock_offset_ns=offset,
            round_trip=round_trip * 1e-9 if round_trip is not None else None,
            streams={name: self._stream(name, window, t_recv_ns) for name, window in self._streams.items()},
            states=dict(self._states),
            verdicts=self._all_verdicts(),
            rejected=self._all_rejected(),
            sinks=sinks or {},
            faults=self._faults,
        )

    def _stream(self, name: str, window: deque[int], t_recv_ns: int) -> StreamHealth:
        recent = sum(1 for t in window if t_recv_ns - t <= RATE_WINDOW_NS)
        return StreamHealth(
            count=self._counts[name],
            rate=recent / (RATE_WINDOW_NS * 1e-9),
            age=(t_recv_ns - window[-1]) * 1e-9,
        )

    def _all_verdicts(self) -> dict[str, int]:
        counted = {
            f"{n}.{verdict}": k for n, e in self._counting.items() for verdict, k in e.verdicts.items() if k
        }
        return dict(self._verdicts) | counted

    def _all_rejected(self) -> dict[str, int]:
        total = Counter(self._rejected)
        total.update(self.clocks.rejected)
        total.update(self.ownship.rejected)
        for decoder in self._decoders.values():
            total.update(decoder.rejected)
        return dict(total)
