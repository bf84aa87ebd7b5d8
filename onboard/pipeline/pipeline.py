"""The heart: bytes in, estimates out. Synchronous and deterministic; no clock, no socket, no thread.

    decode     bytes -> messages in SI units                        onboard.wire.datagrams
    _heed      of our vehicle, and wanted                           admission
    _align     onto the clock of our own motion                     onboard.clocks
    _route     own motion to ownship, which predicts every estimate; the rest to who listens
    _observe   a message to the estimators that listen for it       onboard.estimators
    _noted     what is published, and what health learns of it

`feed = advance . decode`. Live, the daemon calls the two apart, because the session with the autopilot needs
the decoded messages too; a replay calls `feed`. Both run the same code on the same bytes.
"""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from typing import Final

from onboard.clocks import SENSED, ClockEvent, Clocks
from onboard.config import Config, source_delays_ns
from onboard.estimators import CountsVerdicts, EstimatorProtocol, Listens, Withholds, load
from onboard.health import Advisor, Monitor
from onboard.health.mounts import Mounts
from onboard.messages import (
    Attitude,
    Clock,
    Datagram,
    Estimate,
    EstimatorStatus,
    Exposure,
    GlobalPosition,
    Health,
    Heartbeat,
    Message,
    NavState,
    Output,
    TimeSync,
    WarmState,
    invalidate,
)
from onboard.messages.causes import Cause, Reason
from onboard.pipeline.admission import FROM_ARRIVAL, Admission
from onboard.pipeline.needs import needs
from onboard.pipeline.own_motion import OwnMotionSource
from onboard.pipeline.report import NO_RIM, Parts, Rim, health
from onboard.pipeline.silence import BEHIND, HELD_UP, TIMEOUT_NS, LastWords
from onboard.pipeline.waiting import Waiting
from onboard.pipeline.warm_start import WarmStart
from onboard.units import NS_PER_S
from onboard.wire.datagrams import NO_KEYS, DatagramDecoder, Keys
from onboard.wire.logs import tlog
from onboard.wire.surplus import surplus

NO_POSITION: Final = Reason(
    Cause.NO_POSITION, "the autopilot has no position yet: its filter still aligns, or GPS is missing"
)
UNKNOWN: Final = Reason(Cause.OWN_MOTION_UNKNOWN, "our own motion is not known")
NEW_TIME: Final = {
    ClockEvent.REBOOTED: Reason(Cause.REBOOTED, "the autopilot has rebooted"),
    ClockEvent.CLOCK_SET: Reason(Cause.CLOCK_SET, "the autopilot has set its clock"),
}
CORRECTED: Final = Reason(
    Cause.CLOCK_CORRECTED,
    "the clocks' offset was wrong: the link had been held up, or they run at different rates",
)


class Pipeline:
    """State lives in five places: the decoder's buffers, the clocks, ownship's history, the images that wait until
    our own pose at their time is known, and each estimator. `Monitor` only counts. `surplus`: what may be left out
    before it is decoded, where more comes than can be."""

    surplus = staticmethod(surplus)

    def __init__(self, config: Config, keys: Keys = NO_KEYS) -> None:
        self.clocks = Clocks()
        self.estimators: dict[str, EstimatorProtocol] = {
            name: load(name).Estimator(section, config.camera_model())
            for name, section in config.estimator.items()
        }
        self._own_motion = OwnMotionSource(config.ownship, self.estimators, self.count_error)
        self.ownship = self._own_motion.begin()
        self._config, camera = config, config.camera_model()
        gimbals = {each.name: each.gimbal for each in (camera, *reversed(camera.others))}
        self._waiting = Waiting(config.ownship, gimbals)
        self._listeners: dict[type[Message], list[str]] = {}  # names of estimators
        for name, estimator in self.estimators.items():
            for kind in estimator.listens if isinstance(estimator, Listens) else load(name).LISTENS:
                self._listeners.setdefault(kind, []).append(name)
        self._admission = Admission(config.autopilot, self._listeners, config.leader_out)
        self._delays_ns: dict[type[Message], int] = {}
        self._camera_delays_ns = config.camera_delays_ns()
        self._first_recv_ns: int | None = None
        self._taken_ns = self._waited_ns = 0  # when the newest datagram was taken, and how long it had waited here
        self._max_age_ns = round(config.ownship.max_age_s * NS_PER_S)
        self._own_recv_ns = self._attitude_recv_ns = 0  # arrivals of our last position and velocity, and attitude
        self._last_words = LastWords()
        self._doubt = ""  # of our own motion; estimates that follow from it are not valid
        counts = [n for n, e in self.estimators.items() if isinstance(e, CountsVerdicts)]
        self._monitor = Monitor(counts, takes_ranges=config.takes_ranges())
        self._advisor = Advisor(needs(config))
        self.refuse = self._monitor.refusals.add  # by source and reason, what nobody could use
        self._mounts = Mounts(camera, self.refuse)
        self._warm = WarmStart(self.refuse)
        is_own = self._admission.is_own
        self._decoder = DatagramDecoder(self.count_error, self.refuse, config.camera_inputs(), keys, is_own)

    def feed(self, datagram: Datagram) -> list[Output]:
        """Estimates and own poses that follow from one datagram, in order."""
        return self.advance(self.decode(datagram))

    def decode(self, datagram: Datagram) -> list[Message]:
        """The messages in one datagram, in SI units; bad bytes are counted in `health().rejected`."""
        if self._first_recv_ns is None:
            self._first_recv_ns = datagram.t_recv_ns
        self.clocks.is_one_clock = datagram.channel != tlog.TLOG_CHANNEL
        self.clocks.compare(datagram.t_recv_ns, datagram.wall_step_ns)
        self._taken_ns, self._waited_ns = datagram.read_ns, datagram.read_ns - datagram.t_recv_ns
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

    def _advance(self, message: Message) -> list[Output]:
        if isinstance(message, WarmState):
            self._warm.receive(message)
            return self._latch(message.heartbeat)  # the next one comes within a second
        self._monitor.hear(message)
        published = self._latch(message) if isinstance(message, Heartbeat) else []
        heeded = self._heed(message)
        if heeded is None:
            return published
        if isinstance(heeded, FROM_ARRIVAL):
            return [*published, *self._observe(heeded)]
        aligned, ended = self._align(heeded)
        routed = [] if aligned is None else self._route(aligned)
        return [*published, *ended, *routed]

    def _heed(self, message: Message) -> Message | None:
        """A message as estimators know it; None for one that is not of what is followed, or of no use to them."""
        admitted = self._admission.admit(message)
        if isinstance(admitted, str):
            self._monitor.reject(message, admitted)
            return None
        self._monitor.receive(admitted)
        if isinstance(admitted, TimeSync):
            if (why := self.clocks.receive_reply(admitted)) is not None:
                self.refuse("autopilot", why, admitted.t_recv_ns)
            return None
        if isinstance(admitted, EstimatorStatus):
            if not self.ownship.receive_status(admitted):  # as if own motion had stopped long ago
                self._own_recv_ns = min(self._own_recv_ns, admitted.t_recv_ns - TIMEOUT_NS - 1)
            return None
        return admitted

    def _latch(self, heartbeat: Heartbeat) -> list[Output]:
        """An autopilot's first heartbeat decides which delays sources have; that of another vehicle begins a new
        time base."""
        before = self.autopilot
        if not self._admission.latch(heartbeat):
            return []
        self._delays_ns = source_delays_ns(self._config.delay, heartbeat.autopilot)
        if before is None or self._admission.is_same:
            return self._observe(heartbeat)
        self.clocks.restart()
        why = f"another autopilot is followed: {self.why_followed}"
        return [*self._start_over(Reason(Cause.OTHER_AUTOPILOT, why)), *self._observe(heartbeat)]

    def _align(self, message: Message) -> tuple[Message | None, list[Output]]:
        """A message by the clock of our own motion, None if its time is not known; and the last estimates by that
        clock's time before, where it has begun anew."""
        if message.clock is Clock.NONE and not self._admission.holds_from_arrival(message):
            if isinstance(message, SENSED):
                self._monitor.reject(message, "unstamped_points")
            return None, []  # not stamped: commands, heartbeats, text; nothing to estimate from
        clocks, ended = self.clocks, list[Output]()
        aligned, offset_ns, event, why = clocks.align(message, self.delay_ns(message))
        if aligned is None:  # counted by the clocks
            self._monitor.refusals.add_message(message, why if self.autopilot else "before_heartbeat")
            return None, []
        if isinstance(message, Exposure):
            self._monitor.cameras.see(message, aligned.t_ns, offset_ns, self.ownship.now_ns)
        if event in NEW_TIME:
            ended = self._start_over(NEW_TIME[event])
        elif event is ClockEvent.CORRECTED:
            self._monitor.rejected["clock_corrections"] += 1
            self._reset(CORRECTED)
        if self._warm.waits and (known := self._warm.confirmed(clocks, offset_ns, message.t_recv_ns)) is not None:
            self._observe(known)
        return aligned, ended

    def delay_ns(self, message: Message) -> int:
        """Return the configured delay of a message, by which it is older than its stamp."""
        if isinstance(message, Exposure):
            return self._image_delay_ns(message.camera)
        return self._delays_ns.get(type(message), 0)

    def _image_delay_ns(self, camera: str) -> int:
        """Return the configured delay of a camera's images."""
        return self._camera_delays_ns.get(camera, self._delays_ns.get(Exposure, 0))

    def _start_over(self, why: Reason) -> list[Output]:
        """The autopilot's clock and origin are new, so no state still holds. Gives estimates that say why, before
        another reason follows."""
        self.ownship = self._own_motion.begin()
        self._waiting.clear()
        for estimator in self.estimators.values():
            estimator.reset(why)
        return [output for name in self.estimators for output in self._noted(self._asked(name, None))]

    def _route(self, message: Message) -> list[Output]:
        """Own motion goes to ownship; images that waited for it follow, and a navigation sample (position and
        velocity) then predicts every estimate to now. Any other message goes to the estimators that listen."""
        if isinstance(message, SENSED):
            return [] if self._waiting.takes(message, self.ownship) else self._observe(message)
        outputs: list[Output] = []
        if isinstance(message, Attitude):
            self._attitude_recv_ns = message.t_recv_ns
            outputs = self._observe(message)  # before others use it: an estimator of our own state may know better
        stamp_ns = message.t_ns + self.delay_ns(message)
        is_navigation = self.ownship.receive(message, stamp_ns, self._own_motion.at(message))
        self._judge_own_motion()
        if not (is_navigation or isinstance(message, Attitude)):
            return self._observe(message)
        if is_navigation:
            self._own_recv_ns = message.t_recv_ns
            if (own := self.ownship.own_pose(self.ownship.now_ns)) is not None:
                outputs.append(own)
        for waited in self._waiting.ready(self.ownship):
            outputs.extend(self._observe(waited))
        if not is_navigation:
            return outputs
        outputs.extend(self._observe(message))
        for name in self.estimators:
            outputs.extend(self._noted(self._asked(name, None)))
        self._mounts.judge(message.t_recv_ns)
        return outputs

    def _observe(self, message: Message) -> list[Output]:
        """A message to the estimators that listen for its kind."""
        if isinstance(message, GlobalPosition) and not self.ownship.has_position(message):
            self._monitor.reject(message, "filter_has_no_position")
            return []
        if not (names := self._listeners.get(type(message))):
            return []
        if isinstance(message, Exposure) and self._mounts.doubts and (doubts := self._mounts.withheld):
            names = [name for name in names if not self._is_withheld(message, self.estimators[name], doubts)]
        estimates = [estimate for name in names for estimate in self._asked(name, message)]
        now_ns = max(message.t_recv_ns, self._attitude_recv_ns)  # an image may have waited
        is_silent = now_ns - self._own_recv_ns > TIMEOUT_NS
        unknown = UNKNOWN if self._own_recv_ns else NO_POSITION
        return self._noted(estimates, unknown if is_silent else None)

    def _is_withheld(self, exposure: Exposure, estimator: EstimatorProtocol, doubts: Mapping[str, Reason]) -> bool:
        """Whether an estimator does not want an exposure of a camera in doubt, which is then counted."""
        why = estimator.withholds(exposure, doubts) if isinstance(estimator, Withholds) else None
        if why is not None:
            self._monitor.reject(exposure, why)
        return why is not None

    def _asked(self, name: str, message: Message | None) -> list[Estimate]:
        """An estimator's answer to a message, or, without one, to a new navigation sample. One that raises may be
        left in any state, so it starts again."""
        estimator = self.estimators[name]
        try:
            return estimator.tick(self.ownship) if message is None else estimator.observe(message, self.ownship)
        except Exception as error:  # of any kind: the other estimators go on
            self.count_error(name, error)
            with suppress(Exception):
                words = f"an error in the estimator: {type(error).__name__}"
                estimator.reset(Reason(Cause.ESTIMATOR_ERROR, words))
            return []

    def _judge_own_motion(self) -> None:
        """Notice when our own motion contradicts itself. What was estimated from it is forgotten once it no longer
        does; after a single step, it is kept."""
        doubt = self.ownship.doubt
        if doubt and not self._doubt:
            self._monitor.rejected[doubt.replace(" ", "_")] += 1
        if self._doubt and not doubt and self.ownship.has_misled:
            self._reset(Reason(Cause.OWN_MOTION_DOUBT, f"our own motion was in doubt: {self._doubt}"))
        self._doubt = doubt

    def _reset(self, why: Reason) -> None:
        """Forget what was estimated from our own motion; our own state has its own checks."""
        for name, estimator in self.estimators.items():
            if name != "own_state":
                estimator.reset(why)

    def _noted(self, estimates: Iterable[Estimate], doubt: Reason | None = None) -> list[Output]:
        """Publish estimates; those that follow from our own motion are not valid if it is in doubt, and none is
        whose own motion is too old by now."""
        outputs: list[Output] = []
        doubt = doubt or self.clocks.doubt
        if doubt is None and self._doubt:
            doubt = Reason(Cause.OWN_MOTION_DOUBT, f"our own motion is in doubt: {self._doubt}")
        for made in estimates:
            why = None if isinstance(made, NavState) else doubt
            why = why or self._too_old(made)
            estimate = made if why is None else invalidate(made, why)
            self._mounts.see(estimate, self.ownship)
            self._monitor.publish(estimate)
            self._last_words.note(estimate)
            outputs.append(estimate)
        return outputs

    def _too_old(self, estimate: Estimate) -> Reason | None:
        """Why an estimate would be too old when it is published, by the time at which the datagram that it follows
        from was taken; None if it is not."""
        age_ns = self.clocks.age_ns(estimate.t_ns, self._taken_ns)
        if estimate.mean is None or age_ns <= self._max_age_ns:
            return None
        return BEHIND if 2 * self._waited_ns > age_ns else HELD_UP

    @property
    def autopilot(self) -> Heartbeat | None:
        """The heartbeat that was latched, None before it."""
        return self._admission.autopilot

    @property
    def why_followed(self) -> str:
        """Why it took the place of another autopilot."""
        return self._admission.why

    @property
    def heard_ns(self) -> int | None:
        """Arrival of the latched autopilot's last message, None before the first."""
        return self._admission.heard_ns

    @property
    def frames(self) -> dict[str, int]:
        """Well-formed MAVLink frames so far, by name."""
        return self._decoder.frames

    @property
    def unverified(self) -> dict[str, int]:
        """Counts of signed frames without a known key, by channel."""
        return self._decoder.unverified

    @property
    def errors(self) -> list[str]:
        """The first exception of each kind, described in one line each."""
        return self._monitor.errors.lines

    def health(self, t_recv_ns: int, rim: Rim = NO_RIM) -> Health:
        """Return the health at a time of this computer's clock. `rim`: sinks, links and computer."""
        if (bias := self.ownship.velocity_bias) is not None:
            self.refuse("our own velocity", bias, t_recv_ns)
        counting = self._monitor, self._decoder, self.estimators, self._advisor
        parts = Parts(self.clocks, self.ownship, self._admission, *counting)
        return health(parts, t_recv_ns, self._first_recv_ns or t_recv_ns, rim)
