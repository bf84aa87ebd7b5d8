"""The heart: bytes in, estimates out. Synchronous and deterministic; no clock, no socket, no thread.

`feed = advance . decode`. Live, the daemon calls the two apart, because the session with the autopilot needs
the decoded messages too; a replay calls `feed`. Both run the same code on the same bytes.
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from contextlib import suppress
from typing import Final

from msgspec.structs import replace

from onboard.clocks import Clocks
from onboard.config import Config, source_delays_ns
from onboard.estimators import CountsVerdicts, EstimatorProtocol, load
from onboard.health import Monitor, autopilot_name, total
from onboard.messages import (
    Attitude,
    Clock,
    Datagram,
    Estimate,
    EstimatorStatus,
    GlobalOrigin,
    GlobalPosition,
    Health,
    Heartbeat,
    Message,
    NavState,
    Output,
    SinkHealth,
    TargetImage,
    TimeSync,
)
from onboard.ownship import Ownship
from onboard.pipeline.admission import SENSED, UNSTAMPED, Admission
from onboard.pipeline.silence import TIMEOUT_NS, LastWords
from onboard.wire.datagrams import DatagramDecoder

MAX_WAITING: Final = 256  # of each source
FIRST: Final = ("leader", "")  # targets whose images have room of their own; "" is a target without an id


class Pipeline:
    """State lives in five places: the decoder's buffers, the clocks, ownship's history, the images that wait until
    our own pose at their time is known, and each estimator. `Monitor` only counts."""

    def __init__(self, config: Config) -> None:
        self.clocks = Clocks()
        self.ownship = Ownship(max_extrapolation=config.ownship.max_extrapolation_s)
        self.estimators: dict[str, EstimatorProtocol] = {
            name: load(name).Estimator(section, config.camera_model())
            for name, section in config.estimator.items()
        }
        self._config = config
        self._waiting: list[Message] = []
        self._places: Counter[tuple[type[Message], bool]] = Counter()  # taken among them, by source
        self._listeners: dict[type[Message], list[str]] = {}  # names of estimators
        for name in self.estimators:
            for kind in load(name).LISTENS:
                self._listeners.setdefault(kind, []).append(name)
        virtual = {out.system for out in config.leader_out}
        self._admission = Admission(config.autopilot, self._listeners, virtual)
        self._delays_ns: dict[type[Message], int] = {}
        self._first_recv_ns: int | None = None
        self._own_recv_ns = 0  # arrival of the last message of our own position and velocity
        self._attitude_recv_ns = 0
        self._last_words = LastWords()
        self._monitor = Monitor(n for n, e in self.estimators.items() if isinstance(e, CountsVerdicts))
        self._decoder = DatagramDecoder(self.count_error, self._monitor.refusals.add, config.camera_inputs())

    def feed(self, datagram: Datagram) -> list[Output]:
        """Estimates and own poses that follow from one datagram, in order."""
        return self.advance(self.decode(datagram))

    def decode(self, datagram: Datagram) -> list[Message]:
        """The messages in one datagram, in SI units; bad bytes are counted in `health().rejected`."""
        if self._first_recv_ns is None:
            self._first_recv_ns = datagram.t_recv_ns
        self.clocks.compare(datagram.t_recv_ns, datagram.wall_step_ns)
        return self._decoder.decode(datagram)

    def advance(self, messages: Sequence[Message]) -> list[Output]:
        """Let messages act on clocks, ownship and estimators; estimates and own poses that follow, in order. An
        exception over one message costs that message: it is counted, and described in `errors`."""
        outputs: list[Output] = []
        for message in messages:
            try:
                outputs.extend(self._advance(message))
            except Exception as error:  # of any kind: what arrives must not end a flight
                self.count_error(type(message).__name__, error)
        return outputs

    def tick(self, t_recv_ns: int) -> list[Output]:
        """Estimates that are no longer valid, because the autopilot sends nothing. Live, a timer calls it; a
        replay has no timer, and these estimates are not repeated in it."""

        def is_silent(estimate: Estimate) -> bool:
            heard_ns = self._attitude_recv_ns if isinstance(estimate, NavState) else self._own_recv_ns
            return t_recv_ns - heard_ns > TIMEOUT_NS

        return self._noted(self._last_words.withdraw(is_silent))

    def count_error(self, place: str, error: Exception) -> None:
        """Count an exception over one message in the health, also one of what follows the pipeline."""
        self._monitor.errors.count(place, error)

    # ------------------------------------------------------------------------------- one message

    def _advance(self, message: Message) -> list[Output]:
        if isinstance(message, Heartbeat):
            self._latch(message)
        admitted = self._admission.admit(message)
        if isinstance(admitted, str):
            self._monitor.reject(message, admitted)
            return []
        self._monitor.receive(admitted)
        if isinstance(admitted, TimeSync):
            self.clocks.receive_reply(admitted)
            return []
        if isinstance(admitted, EstimatorStatus):
            if not self.ownship.receive_status(admitted):  # as if own motion had stopped long ago
                self._own_recv_ns = min(self._own_recv_ns, admitted.t_recv_ns - TIMEOUT_NS - 1)
            return []
        if isinstance(admitted, GlobalOrigin):
            return self._observe(admitted)  # often without a stamp: it holds from its arrival
        return self._align(admitted)

    def _latch(self, heartbeat: Heartbeat) -> None:
        """An autopilot's first heartbeat decides which delays sources have; another's begins a new time base."""
        before = self.autopilot
        if not self._admission.latch(heartbeat):
            return
        self._delays_ns = source_delays_ns(self._config.delay, heartbeat.autopilot)
        if before is not None:
            self.clocks.restart()
            self._start_over("another autopilot is followed")

    # ------------------------------------------------------------------------------- one time base

    def _align(self, message: Message) -> list[Output]:
        if message.clock is Clock.NONE and not isinstance(message, UNSTAMPED):
            if isinstance(message, SENSED):
                self._monitor.reject(message, "unstamped_points")
            return []  # not stamped: commands, heartbeats, text; nothing to estimate from
        reboots = self.clocks.reboots
        delay_ns = self._delays_ns.get(type(message), 0)
        aligned = self.clocks.align(message, delay_ns)
        if aligned is None:  # counted by the clocks
            self._monitor.refusals.add_message(message, "no_time_base")
            return []
        if self.clocks.reboots > reboots:
            self._start_over("the autopilot has rebooted")
        return self._estimate(aligned, aligned.t_ns + delay_ns)

    def _start_over(self, reason: str) -> None:
        """The autopilot's clock and origin are new, so no state still holds."""
        self.ownship = Ownship(max_extrapolation=self._config.ownship.max_extrapolation_s)
        self._waiting.clear()
        self._places.clear()
        for estimator in self.estimators.values():
            estimator.reset(reason)

    # ------------------------------------------------------------------------------- estimates

    def _estimate(self, message: Message, stamp_ns: int) -> list[Output]:
        """Own motion predicts every estimate to now; any other message goes to the estimators that listen."""
        if isinstance(message, SENSED) and self._must_wait(message):
            self._waiting.append(message)
            self._places[_source(message)] += 1
            return []
        if isinstance(message, Attitude):
            self._attitude_recv_ns = message.t_recv_ns
        if not self.ownship.receive(message, stamp_ns):
            return self._observe(message)
        self._own_recv_ns = message.t_recv_ns
        outputs: list[Output] = []
        own = self.ownship.own_pose(self.ownship.now_ns)
        if own is not None:
            outputs.append(own)
        ready = [m for m in self._waiting if self._is_ready(m)]
        if ready:
            self._waiting = [m for m in self._waiting if not self._is_ready(m)]
            self._places = Counter(map(_source, self._waiting))
        for waited in (*ready, message):
            outputs.extend(self._observe(waited))
        for name in self.estimators:
            outputs.extend(self._noted(self._asked(name, None)))
        return outputs

    def _observe(self, message: Message) -> list[Output]:
        """A message to the estimators that listen for its kind."""
        if isinstance(message, GlobalPosition) and not self.ownship.has_position(message):
            self._monitor.reject(message, "filter_has_no_position")
            return []
        estimates: list[Estimate] = []
        for name in self._listeners.get(type(message), ()):
            estimates.extend(self._asked(name, message))
        if message.t_recv_ns - self._own_recv_ns > TIMEOUT_NS:
            estimates = [
                e if isinstance(e, NavState) else replace(e, valid=False, reason="our own motion is not known")
                for e in estimates
            ]
        return self._noted(estimates)

    def _asked(self, name: str, message: Message | None) -> list[Estimate]:
        """An estimator's answer to a message, or, without one, to a new navigation sample. One that raises may be
        left in any state, so it starts again."""
        estimator = self.estimators[name]
        try:
            return estimator.tick(self.ownship) if message is None else estimator.observe(message, self.ownship)
        except Exception as error:  # of any kind: the other estimators go on
            self.count_error(name, error)
            with suppress(Exception):
                estimator.reset(f"an error in the estimator: {type(error).__name__}")
            return []

    def _noted(self, estimates: Iterable[Estimate]) -> list[Output]:
        outputs: list[Output] = []
        for estimate in estimates:
            self._monitor.publish(estimate)
            self._last_words.note(estimate)
            outputs.append(estimate)
        return outputs

    def _is_ready(self, waiting: Message) -> bool:
        """Whether our motion at its time is known, or has not become so for too long: a stream has stopped."""
        late_ns = self.ownship.now_ns - waiting.t_ns
        return self.ownship.knows(waiting.t_ns) or late_ns > self._config.ownship.max_lead_s * 1e9

    def _must_wait(self, image: Message) -> bool:
        """Whether our own motion at an image's time is not known yet, but may soon be. A camera's clock may lead
        (in some recordings by half a second): an image that waits is not lost."""
        lead_ns = image.t_ns - self.ownship.now_ns
        own = self._config.ownship
        return (
            self.ownship.now_ns > 0
            and own.max_lead_s * 1e9 >= lead_ns > 0.5 * own.max_extrapolation_s * 1e9
            and self._places[_source(image)] < MAX_WAITING
        )

    # ------------------------------------------------------------------------------- health

    @property
    def autopilot(self) -> Heartbeat | None:
        """The heartbeat that was latched, None before it."""
        return self._admission.autopilot

    @property
    def heard_ns(self) -> int | None:
        """Arrival of the latched autopilot's last message, None before the first."""
        return self._admission.heard_ns

    @property
    def frames(self) -> dict[str, int]:
        """Well-formed MAVLink frames so far, by name."""
        return self._decoder.frames

    @property
    def errors(self) -> list[str]:
        """The first exception of each kind, described in one line each."""
        return self._monitor.errors.lines

    def health(self, t_recv_ns: int, sinks: dict[str, SinkHealth] | None = None) -> Health:
        """How the program is doing, as of a time on this computer's clock."""
        clocks, monitor = self.clocks, self._monitor
        offset, round_trip = clocks.offset_ns, clocks.round_trip_ns
        sources = (monitor.rejected, monitor.errors.counts, clocks.rejected, self.ownship.rejected)
        counted = {
            f"{name}.{verdict}": count
            for name, estimator in self.estimators.items()
            if isinstance(estimator, CountsVerdicts)
            for verdict, count in estimator.verdicts.items()
            if count
        }
        return Health(
            t_ns=t_recv_ns - offset if offset is not None else 0,
            t_recv_ns=t_recv_ns,
            uptime=(t_recv_ns - (self._first_recv_ns or t_recv_ns)) * 1e-9,
            autopilot=autopilot_name(self.autopilot),
            autopilot_reboots=clocks.reboots,
            clock_source=clocks.source,
            clock_offset_ns=offset,
            round_trip=round_trip * 1e-9 if round_trip is not None else None,
            streams=monitor.streams(t_recv_ns),
            states=dict(monitor.states),
            verdicts=dict(monitor.verdicts) | counted,
            rejected=total([*sources, self._decoder.rejected]),
            sinks=sinks or {},
            faults=monitor.faults,
            refusals=monitor.refusals.latest,
        )


def _source(message: Message) -> tuple[type[Message], bool]:
    """Whose room a message takes while it waits: other targets never cost the leader's images their place."""
    return type(message), isinstance(message, TargetImage) and message.target in FIRST
