"""The composition root: configuration -> links, pipeline, sinks; the one TaskGroup of a flight.

Links are required: one that ends takes the daemon down with a clear error, for the service manager to start it
again. Sinks are optional: each runs in its own thread behind a bounded queue and restarts by itself. A datagram
is recorded before it is decoded, goes through the pipeline in one synchronous call, and what it makes known is
queued for the sinks before the next one is read.
"""

import asyncio
import signal
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from onboard.autopilot.odometry import OdometryStream
from onboard.autopilot.session import Session
from onboard.autopilot.traffic import TrafficOut
from onboard.config import Config
from onboard.links import Link, LinkError, parse_link
from onboard.links.zenoh import ZenohLink
from onboard.messages import Datagram, Estimate, Health, Lifecycle, NavState, SinkHealth
from onboard.pipeline import Pipeline
from onboard.sinks import SinkRunner
from onboard.sinks import recorder as recording
from onboard.sinks import zenoh as publishing
from onboard.sinks.zenoh_session import ZenohSession, open_session

TICK_S: Final = 0.05
HEALTH_EVERY_NS: Final = 1_000_000_000
SILENT_NS: Final = 3_000_000_000  # without an autopilot's bytes: no longer healthy


class Daemon:
    """Everything of one flight. `now_ns` is this computer's clock; `say` is told what a person should know."""

    def __init__(self, config: Config, *, now_ns: Callable[[], int], say: Callable[[str], None]) -> None:
        self._now_ns = now_ns
        self._say = say
        self._config = config
        self._pipeline = Pipeline(config)
        self._links: list[Link] = [parse_link(link.url, link.name) for link in config.link]
        self._sessions = {link.name: Session(config.autopilot) for link in config.link if link.autopilot}
        self._traffic_out = TrafficOut(config.traffic_out, config.autopilot.component)
        self._sinks: dict[str, SinkRunner[Any]] = {}
        self._zenoh: ZenohSession | None = None
        self._odometry: OdometryStream | None = None
        self._states: dict[str, Lifecycle] = {}
        self._next_health_ns = 0
        self._frames: Counter[str] = Counter()
        self._rates: dict[str, float] = {}
        self._heard_ns = 0
        self._is_silent = False  # as told last
        self._troubles: dict[str, str] = {}  # of sinks, as told last

    async def run(self) -> None:
        """Fly until SIGINT or SIGTERM.

        Raises LinkError or SinkError, in one line, for what cannot be opened or has ended for good.
        """
        loop = asyncio.get_running_loop()
        stop = asyncio.Event()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, stop.set)
        try:
            await self._open()
            await self._fly(stop)
        finally:
            if self._zenoh is not None:
                await asyncio.to_thread(self._zenoh.close)
            self._say("stopped")

    async def _open(self) -> None:
        """Claim ports, devices and files, so that a mistake shows before the flight does."""
        config = self._config
        if config.zenoh.enabled:
            self._zenoh = await asyncio.to_thread(open_session, config.zenoh)
            sink = publishing.ZenohSink(self._zenoh, config.zenoh.prefix, now_ns=self._now_ns)
            self._sinks["zenoh"] = SinkRunner("zenoh", sink, publishing.CAPACITY)
            self._links.append(ZenohLink(self._zenoh, config.zenoh.prefix))
            self._say(f"zenoh: {config.zenoh.mode} at {', '.join(config.zenoh.listen)}, {config.zenoh.prefix}/**")
        if config.recorder.path is not None:
            recorder = recording.Recorder(Path(config.recorder.path))
            recorder.check()
            self._sinks["recorder"] = SinkRunner("recorder", recorder, recording.CAPACITY)
            self._say(f"recording to {config.recorder.path}")
        for link in self._links:
            await link.open()
        for described in config.link:
            self._say(f"link {described.name}: {described.url}")

    async def _fly(self, stop: asyncio.Event) -> None:
        try:
            async with asyncio.TaskGroup() as group:
                tasks = [group.create_task(sink.run()) for sink in self._sinks.values()]
                tasks += [group.create_task(link.run(self._deliver, self._now_ns)) for link in self._links]
                tasks.append(group.create_task(self._keep_time()))
                await stop.wait()
                for task in reversed(tasks):  # sinks last: they still write what is queued
                    task.cancel()
        except* LinkError as group_of_one:
            raise group_of_one.exceptions[0] from None

    def _deliver(self, datagram: Datagram) -> None:
        """One datagram's way through the program."""
        recorder = self._sinks.get("recorder")
        if recorder is not None:
            recorder.put(datagram)
        pipeline = self._pipeline
        messages = pipeline.decode(datagram)
        was_heard, reboots = pipeline.autopilot is not None, pipeline.clocks.reboots
        for output in pipeline.advance(messages):
            self._publish(output)
            if isinstance(output, NavState):
                self._send_odometry(output)
            if isinstance(output, Estimate) and output.name == output.target:
                self._tell(output)
            elif isinstance(output, Estimate) and self._traffic_out.link:  # one of many, that come and go
                self._send(self._traffic_out.link, self._traffic_out.frames(output))
        session = self._sessions.get(datagram.channel)
        if session is None or not messages:
            return
        self._heard_ns = datagram.t_recv_ns
        if pipeline.autopilot is not None and not was_heard:
            for each in self._sessions.values():
                each.connect(pipeline.autopilot)
            self._traffic_out.connect(pipeline.autopilot.system)
            self._say(f"autopilot: {pipeline.health(datagram.t_recv_ns).autopilot}")
        if pipeline.clocks.reboots > reboots:
            self._say("the autopilot has rebooted")
            for each in self._sessions.values():
                each.reboot()
        self._send(datagram.channel, session.respond(messages, self._now_ns()))

    async def _keep_time(self) -> None:
        """What is due by the clock: the session with the autopilot, and our health."""
        while True:
            now_ns = self._now_ns()
            for channel, session in self._sessions.items():
                self._send(channel, session.tick(now_ns, healthy=self._is_healthy(now_ns), rates=self._rates))
            if now_ns >= self._next_health_ns or now_ns < self._next_health_ns - HEALTH_EVERY_NS:
                self._next_health_ns = now_ns + HEALTH_EVERY_NS
                self._measure_rates()
                self._tell_troubles()
                self._tell_silence(now_ns)
                self._publish(self._health(now_ns))
            await asyncio.sleep(TICK_S)

    def _publish(self, record: Any) -> None:
        for sink in self._sinks.values():
            sink.put(record)

    def _health(self, now_ns: int) -> Health:
        sinks: dict[str, SinkHealth] = {name: sink.health() for name, sink in self._sinks.items()}
        return self._pipeline.health(now_ns, sinks)

    def _is_healthy(self, now_ns: int) -> bool:
        """Whether the autopilot is heard and every estimator's last word was no loss of its target."""
        return now_ns - self._heard_ns < SILENT_NS and Lifecycle.LOST not in self._states.values()

    def _tell_silence(self, now_ns: int) -> None:
        """Estimates come with the autopilot's messages: without them there is nothing but this to notice."""
        silent = self._heard_ns > 0 and now_ns - self._heard_ns >= SILENT_NS
        if silent != self._is_silent:
            self._is_silent = silent
            self._say("the autopilot is silent: no estimates" if silent else "the autopilot is heard again")

    def _tell_troubles(self) -> None:
        """A sink that fails does not end the flight, but somebody should know: a recording may be missing."""
        troubles = {name: sink.health().error for name, sink in self._sinks.items()}
        for name, error in troubles.items():
            if error != self._troubles.get(name, ""):
                self._say(f"{name}: {error or 'works again'}")
        self._troubles = troubles

    def _measure_rates(self) -> None:
        """Frames a second by MAVLink name, over the last health interval."""
        frames = self._pipeline.frames()
        self._rates = {
            name: (count - self._frames[name]) / (HEALTH_EVERY_NS * 1e-9) for name, count in frames.items()
        }
        self._frames = frames

    def _send(self, channel: str, frames: list[bytes]) -> None:
        for link in self._links:
            if link.channel == channel:
                for frame in frames:
                    link.send(frame)

    def _send_odometry(self, state: NavState) -> None:
        """Our own state on the link chosen for it, which drops rather than waits."""
        config, autopilot = self._config, self._pipeline.autopilot
        if config.odometry.link is None or autopilot is None:
            return
        if self._odometry is None:
            ids = autopilot.system, config.autopilot.component
            self._odometry = OdometryStream(*ids, rate_hz=config.odometry.rate_hz)
        self._send(config.odometry.link, self._odometry.frames(state))

    def _tell(self, estimate: Estimate) -> None:
        if self._states.get(estimate.name) is not estimate.state:
            self._states[estimate.name] = estimate.state
            self._say(f"{estimate.t_ns * 1e-9:.2f} s  {estimate.name}: {estimate.state} ({estimate.reason})")
