"""The composition root: builds links, pipeline and sinks, and runs them in one TaskGroup.

Links are required: one that ends takes the daemon down with a clear error, for the service manager to restart it.
Sinks are optional: each runs in its own thread behind a bounded queue and restarts by itself. A datagram is
recorded before it is decoded, goes through the pipeline in one synchronous call, and the outputs are queued for
the sinks before the next datagram is read.
"""

import asyncio
import signal
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from msgspec.structs import replace

from onboard.autopilot.notices import WARNING
from onboard.autopilot.output import AutopilotOutput, Outgoing
from onboard.autopilot.parameters import stored_parameters
from onboard.autopilot.stream import Stream
from onboard.config import Config, WarmFile, flight_metadata, make_storing, ros_encoder, signing_key
from onboard.links import AbsentError, Link, LinkError, parse_link
from onboard.links.host_clock import HostClock
from onboard.links.host_computer import HostComputer, load_of
from onboard.links.service_manager import ServiceManager
from onboard.links.zenoh import ZenohLink
from onboard.messages import Datagram, Estimate, Health, LeaderState, Message, Output, WarmState, invalidate
from onboard.pipeline import Pipeline, Rim
from onboard.pipeline.silence import BEHIND
from onboard.sinks import SinkRunner
from onboard.sinks import recorder as recording
from onboard.sinks import zenoh as publishing
from onboard.sinks.console import ConsoleLines
from onboard.sinks.zenoh_ros import RosRunner, RosSink
from onboard.sinks.zenoh_session import RouterAbsentError, ZenohSession, open_session
from onboard.units import NS_PER_S, S_PER_NS

TICK_PERIOD_S: Final = 0.02
ROUTER_POLL_PERIOD_S: Final = 1.0
LEADER_RATE_HZ: Final = 20.0
HEALTH_PERIOD_NS: Final = NS_PER_S
MAX_WAIT_TIME_US: Final = (1 << 32) - 1  # the largest value of a recording: more than an hour
SILENCE_TIMEOUT_NS: Final = 3 * NS_PER_S  # without a message of the latched autopilot we are not healthy


class Daemon:
    """Everything of one flight.

    `report` receives lines for a person, `on_health` each health. `session` is Zenoh's, which is being opened.
    """

    def __init__(
        self,
        config: Config,
        *,
        report: Callable[[str], None],
        on_health: Callable[[Health], None] = lambda _: None,
        clock: HostClock | None = None,
        session: Future[ZenohSession] | None = None,
    ) -> None:
        self._clock = clock or HostClock()
        self._now_ns = self._clock.now_ns
        self._computer = HostComputer(Path(config.recorder.path or ".").absolute().parent)
        self._report, self._on_health = report, on_health
        self._config = config
        keys = {link.name: key for link in config.link if (key := signing_key(link)) is not None}
        self._pipeline = Pipeline(config, keys)
        self._storing = make_storing(config)
        parameters = stored_parameters(config, self._storing)
        self._output = AutopilotOutput(config, parameters, keys, self._pipeline.refuse)
        self._warm = WarmFile(config, report, self._pipeline.refuse)
        self._encoder = ros_encoder(config)
        self._console = ConsoleLines(report, pilot=self._output.notices.advise)
        longest_s = config.ownship.max_age_s
        self._links: list[Link] = [
            parse_link(link.url, link.name, surplus=Pipeline.surplus, longest_wait_s=longest_s)
            for link in config.link
        ]
        self._sinks: dict[str, SinkRunner[Any]] = {}
        self._zenoh: ZenohSession | None = None
        self._opening = session
        self._frames: Mapping[str, int] = {}
        self._rates: dict[str, float] = {}
        self._next_health_ns = 0
        self._lag_ns = 0  # the longest time by which the timer was late since the last health
        self._max_age_ns = round(config.ownship.max_age_s * NS_PER_S)
        self._offset_ns: int | None = None  # of the clocks, as of the last tick: other threads read it
        self._leader_stream = Stream(LEADER_RATE_HZ)
        self._service = ServiceManager()
        self._delivered = self._processed = 0  # datagrams since the watchdog was fed

    async def run(self, end_signals: Iterable[signal.Signals] = (signal.SIGINT, signal.SIGTERM)) -> None:
        """Fly until one of `end_signals`.

        Raises LinkError or SinkError, in one line, for a part that cannot be opened or has ended for good.
        """
        stop = asyncio.Event()
        for number in end_signals:
            asyncio.get_running_loop().add_signal_handler(number, stop.set)
        try:
            if await self._open_until(stop):
                self._service.notify("READY=1")
                await self._fly(stop)
        finally:
            self._service.notify("STOPPING=1")
            if self._zenoh is not None:
                await asyncio.to_thread(self._zenoh.close)
            for storing in (self._storing, self._warm):
                if storing is not None:
                    await asyncio.to_thread(storing.close)
            self._report("stopped")

    async def _open_until(self, stop: asyncio.Event) -> bool:
        """Open everything, and return whether it is open before `stop` is set.

        A signal may arrive while a name server is silent.
        """
        opening, stopping = asyncio.ensure_future(self._open()), asyncio.ensure_future(stop.wait())
        await asyncio.wait({opening, stopping}, return_when=asyncio.FIRST_COMPLETED)
        for task in (opening, stopping):
            task.cancel()
        if opening.done():
            opening.result()
        return not stop.is_set()

    async def _open(self) -> None:
        """Claim ports, devices and files, so that a mistake shows before the flight."""
        config = self._config
        if config.zenoh.enabled:
            try:
                await self._open_zenoh()
            except RouterAbsentError as error:  # a client's; `_await_router` tries again
                self._report(f"{error}; retrying")
        if config.recorder.path is not None:
            path, rotation = Path(config.recorder.path), _rotation(config)
            recorder = recording.Recorder(
                path, rotation=rotation, metadata=flight_metadata(config), report=self._report
            )
            recorder.check()
            self._sinks["recorder"] = recording.runner(recorder)
            self._report(f"recording to {config.recorder.path}")
        if unnamed := config.unnamed_faults():
            self._report(unnamed)
        for link in self._links:
            try:
                await link.open()
            except AbsentError as error:  # it may come later: `run` tries again
                self._report(f"{error}; retrying")
        for described in config.link:
            self._report(f"link {described.name}: {described.url}")
        if (left := self._warm.read(self._wall_ns())) is not None:
            self._deliver(left)

    async def _open_zenoh(self) -> tuple[list[SinkRunner[Any]], ZenohLink]:
        """Publish, and receive sensors, over Zenoh. Raises SinkError."""
        config, opening, self._opening = self._config, self._opening, None
        opened = asyncio.to_thread(open_session, config.zenoh) if opening is None else asyncio.wrap_future(opening)
        self._zenoh = await opened
        prefix = config.zenoh.prefix
        zenoh = publishing.ZenohSink(
            self._zenoh, prefix, current=self._mark_outdated, monotonic=lambda: self._now_ns() * S_PER_NS
        )
        sinks: list[SinkRunner[Any]] = [publishing.runner(zenoh)]
        if (encoder := self._encoder) is not None:
            sink = RosSink(
                self._zenoh, config.ros2, lambda record, t: encoder.encode(self._mark_outdated(record), t)
            )
            sinks.append(RosRunner(sink, self._wall_ns, lambda: self._pipeline.clocks.offset_ns, self._clock))
        self._sinks |= {sink.name: sink for sink in sinks}
        link = ZenohLink(
            self._zenoh,
            prefix,
            camera=config.camera.name,
            ros=config.ros_keys(),
            longest_wait_s=config.ownship.max_age_s,
            is_armed=lambda: self._output.is_armed,
        )
        self._links.append(link)
        self._report(f"zenoh: {self._zenoh.words()}, {prefix}/**")
        return sinks, link

    async def _await_router(self, group: asyncio.TaskGroup, tasks: list[asyncio.Task[None]]) -> None:
        """Open Zenoh once a client's router answers that was absent at the start."""
        while self._zenoh is None:
            await asyncio.sleep(ROUTER_POLL_PERIOD_S)
            with suppress(RouterAbsentError):
                sinks, link = await self._open_zenoh()
                tasks += [group.create_task(sink.run()) for sink in sinks]
                tasks.append(group.create_task(link.run(self._deliver, self._now_ns)))

    async def _fly(self, stop: asyncio.Event) -> None:
        try:
            async with asyncio.TaskGroup() as group:
                tasks = [group.create_task(sink.run()) for sink in self._sinks.values()]
                tasks += [group.create_task(link.run(self._deliver, self._now_ns)) for link in self._links]
                if self._config.zenoh.enabled and self._zenoh is None:
                    tasks.append(group.create_task(self._await_router(group, tasks)))
                tasks.append(group.create_task(self._run_timer()))
                await stop.wait()
                for task in reversed(tasks):  # sinks last: they still write what is queued
                    task.cancel()
        except* LinkError as group:
            raise _first(group) from None
        except* Exception as group:  # a mistake of ours: its own traceback says more than the group's
            raise _first(group) from _first(group).__cause__

    def _deliver(self, datagram: Datagram) -> bool:
        """Pass one datagram through the program; return whether it held a message.

        An exception costs this datagram, never the link.
        """
        waited_us = max(self._now_ns() - datagram.t_recv_ns, 0) // 1_000
        datagram = replace(
            datagram, wall_step_ns=self._clock.step_ns(), waited_us=min(waited_us, MAX_WAIT_TIME_US)
        )
        recorder = self._sinks.get("recorder")
        if recorder is not None:
            recorder.put(datagram)
        self._delivered += 1
        try:
            messages = self._pipeline.decode(datagram)
        except Exception as error:  # of any kind
            self._pipeline.count_error("daemon", error)
            return False
        try:
            self._process(datagram, messages)
            self._processed += 1
        except Exception as error:  # of any kind
            self._pipeline.count_error("daemon", error)
        return bool(messages)

    def _process(self, datagram: Datagram, messages: Sequence[Message]) -> None:
        pipeline = self._pipeline
        before, reboots = pipeline.autopilot, pipeline.clocks.reboots
        for output in pipeline.advance(messages):
            self._handle_output(output)
        if pipeline.autopilot is not None and pipeline.autopilot is not before:
            for line in self._output.connect(pipeline.autopilot):
                self._report(line)
            why = f" ({pipeline.why_followed})" if before is not None else ""
            self._report(f"autopilot: {pipeline.health(datagram.t_recv_ns).autopilot}{why}")
        for left in (m for m in messages if isinstance(m, WarmState)):
            self._output.resume(left)
        if pipeline.clocks.reboots > reboots:
            self._warn("the autopilot has rebooted")
            self._output.reboot()
        if not messages or not self._output.is_autopilot(datagram.channel):
            return
        now_ns = self._now_ns()
        self._send([self._output.respond(datagram.channel, messages, now_ns)], now_ns)

    async def _run_timer(self) -> None:
        """Send and publish periodically: the session with the autopilot, and our health."""
        due_ns = self._now_ns()
        is_waiting = False
        while True:
            now_ns = self._now_ns()
            lag_ns = now_ns - due_ns
            self._lag_ns = max(self._lag_ns, lag_ns)
            # After a pause, what has come meanwhile is read first: only then can be judged who is silent.
            is_waiting = lag_ns > self._max_age_ns and not is_waiting
            try:
                if not is_waiting:
                    self._tick(now_ns)
            except Exception as error:  # of any kind: the next tick may succeed
                self._pipeline.count_error("timer", error)
            self._console.show_errors(self._pipeline.errors)
            due_ns = now_ns + round(
                TICK_PERIOD_S * NS_PER_S
            )  # a tick in which this program stood still is late, too
            await asyncio.sleep(TICK_PERIOD_S)

    def _tick(self, now_ns: int) -> None:
        heard_ns = self._pipeline.heard_ns
        is_heard = heard_ns is not None and now_ns - heard_ns < SILENCE_TIMEOUT_NS
        for output in self._pipeline.tick(now_ns):
            self._handle_output(output)
        offset_ns = self._offset_ns = self._pipeline.clocks.offset_ns
        boot_ns = None if offset_ns is None else now_ns - offset_ns
        host_ns = self._wall_ns()
        is_due = self._leader_stream.is_due(now_ns)
        times = {"boot_ns": boot_ns, "host_ns": host_ns}
        due = self._output.tick(now_ns, healthy=is_heard, rates=self._rates, wants_leader=is_due, **times)
        self._send(due, now_ns)
        for line in self._output.take_lines():
            self._report(line)
        if is_due and self._output.leader is not None:
            self._publish(self._output.leader)
        if now_ns >= self._next_health_ns or now_ns < self._next_health_ns - HEALTH_PERIOD_NS:
            self._next_health_ns = now_ns + HEALTH_PERIOD_NS
            self._measure_rates()
            self._output.set_computer_status(computer := self._computer.read(now_ns))
            sinks = {name: sink.health() for name, sink in self._sinks.items()}
            links = {link.channel: link.health() for link in self._links}
            load, self._lag_ns = load_of(computer, self._lag_ns * S_PER_NS), 0
            health = self._pipeline.health(now_ns, Rim(sinks, links, load, self._clock.step_ns()))
            self._publish(health)
            self._console.show_health(health)
            self._on_health(health)
            offset_ns = None if boot_ns is None else host_ns - boot_ns
            self._warm.keep(self._output.warm_state(host_ns, offset_ns, self._pipeline.clocks.round_trip_ns))
            if self._storing is not None and (error := self._storing.take_error()):
                self._warn(error)
            self._feed_watchdog()

    def _feed_watchdog(self) -> None:
        """Feed the watchdog once a second, unless everything received has failed in the pipeline.

        The service manager then restarts the daemon.
        """
        if self._processed or not self._delivered:
            self._service.notify("WATCHDOG=1")
            self._delivered = self._processed = 0

    def _handle_output(self, output: Output) -> None:
        """Publish an output of the pipeline, and send the autopilot its part of it."""
        self._publish(output)
        self._send(self._output.publish(self._mark_outdated(output)), self._now_ns())
        if isinstance(output, Estimate) and output.is_primary:
            self._console.show_state(output)

    def _warn(self, line: str) -> None:
        """Report a line here and to the pilot."""
        self._report(line)
        self._output.notices.add(WARNING, line)

    def _mark_outdated(self, record: Any) -> Any:
        """Return a record as it may be published now; any thread may call it.

        In a queue, or during a pause of this program, it may have become too old.
        """
        offset_ns = self._offset_ns
        if not isinstance(record, Estimate | LeaderState) or not record.valid or offset_ns is None:
            return record
        age_ns = self._now_ns() - offset_ns - record.t_ns
        return invalidate(record, BEHIND) if age_ns > self._max_age_ns else record

    def _publish(self, record: Any) -> None:
        for sink in self._sinks.values():
            sink.put(record)

    def _wall_ns(self) -> int:
        return self._now_ns() + self._clock.step_ns()

    def _measure_rates(self) -> None:
        """Measure frames per second by MAVLink name, over the last health period."""
        frames = self._pipeline.frames
        period_s = HEALTH_PERIOD_NS * S_PER_NS
        self._rates = {name: (count - self._frames.get(name, 0)) / period_s for name, count in frames.items()}
        self._frames = frames

    def _send(self, outgoing: Iterable[Outgoing], made_ns: int) -> None:
        """Send frames that were made at a time; none if this program has paused since."""
        for channel, frames in outgoing:
            if self._now_ns() - made_ns > self._max_age_ns:
                return
            for link in self._links:
                if link.channel == channel:
                    for frame in frames:
                        link.send(self._output.signed(channel, frame, self._wall_ns()))


def check_link(url: str) -> None:
    """Raise LinkError for an invalid link string; nothing is opened."""
    parse_link(url, "autopilot")


def _rotation(config: Config) -> recording.Rotation:
    """Return the configured rotation of recordings."""
    file_mb, keep_mb = config.recorder.file_mb, config.recorder.keep_mb
    file_bytes, keep_bytes = (None if limit is None else limit * 1e6 for limit in (file_mb, keep_mb))
    return recording.Rotation(file_bytes, keep_bytes, config.recorder.keep_days)


def _first(group: BaseExceptionGroup[Any]) -> BaseException:
    """Return the first exception of a group."""
    error = group.exceptions[0]
    return _first(error) if isinstance(error, BaseExceptionGroup) else error
