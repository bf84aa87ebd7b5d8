"""The simulator as a process: it paces a run, sends its messages and answers commands.

Nothing here waits for a receiver. On a computer too slow for the requested speed the flight slows down and the
boot clock with it, so that stamps and TIMESYNC replies always agree.
"""

import asyncio
import signal
from collections.abc import Callable, Iterator
from functools import partial
from typing import Final, Protocol

from onboard.messages import SimStatus
from onboard.units import NS_PER_S, S_PER_NS
from onboard.wire.mavlink.encode import MavlinkEncoder
from simlink.autopilot import AutopilotLink
from simlink.sensors.navigation import Reading
from simlink.server.links import TcpServer, UdpLink, parse_udp
from simlink.server.outlet import Outlet, OutletOptions
from simlink.simulation import Tick, boot_time_ns, setpoint_mode, ticks
from simlink.traffic.reports import sender
from simlink.world.constants import STEP_NS, STEPS_PER_SECOND
from simlink.world.truth import State, states

MAX_LAG_S: Final = 0.25  # of wall time, beyond which the boot clock is set back
STATUS_STEPS: Final = STEPS_PER_SECOND // 5
POLL_PERIOD_S: Final = 0.02  # while waiting for a peer
MAX_SLEEP_TIME_S: Final = 0.05  # a stop is noticed within it


class Options(OutletOptions, frozen=True, kw_only=True):
    """Options of a run; `duration` in s of flight (None: endless), `wait` in s of wall time.

    A link that is None is not opened.
    """

    speed: float = 1.0
    duration: float | None = None
    mavlink: str | None = "udpout:127.0.0.1:14540"
    tcp_host: str = "127.0.0.1"
    tcp_port: int | None = 5760
    wait: float = 0.0


class BootClock:
    """The autopilot's time since boot, `speed` times as fast as `now` (s, monotonic)."""

    def __init__(self, now: Callable[[], float], boot_ns: int, speed: float) -> None:
        self._now = now
        self._speed = speed
        self._anchor = (now(), boot_ns)

    def ns(self) -> int:
        """Time since boot, ns."""
        wall, boot_ns = self._anchor
        return boot_ns + round((self._now() - wall) * self._speed * NS_PER_S)

    def wait_for(self, t_ns: int) -> float:
        """Return the wall seconds until `t_ns`, negative if it has passed.

        The clock is set back if that was too long ago.
        """
        ahead = (t_ns - self.ns()) * S_PER_NS / self._speed
        if ahead < -MAX_LAG_S:
            self._anchor = (self._now(), t_ns)
            return 0.0
        return ahead


class Server:
    """One run: `await run(stop)` opens the links, flies, and closes them in any case.

    `now` is a monotonic clock in seconds, `unix_ns` the present Unix time for SYSTEM_TIME; `report` is called with
    one line of text at a time. `world` replaces the states that follow from scenario and seed, and ends the
    flight. Raises LinkError for invalid options.
    """

    def __init__(
        self,
        options: Options,
        now: Callable[[], float],
        unix_ns: int,
        report: Callable[[str], None],
        world: Iterator[State] | None = None,
    ) -> None:
        self.frames = 0  # sent so far
        self._options, self._now, self._report, self._world = options, now, report, world
        self._vehicle = options.scenario.vehicle
        boot_ns = boot_time_ns(options.scenario)
        self._clock = BootClock(now, boot_ns, options.speed)
        self._epoch_ns = unix_ns - boot_ns
        self._mode = setpoint_mode(options.scenario)  # the follower flies on setpoints
        self._session = self._make_session(stream=False)
        self._traffic: dict[tuple[int, int], MavlinkEncoder] = {}  # by system and component
        self._outlet = Outlet(options, self._vehicle.system)
        self.udp: UdpLink | None = None
        self.tcp: TcpServer | None = None
        if options.mavlink is not None:
            self.udp = UdpLink(parse_udp(options.mavlink), self._answer)
        if options.tcp_port is not None:
            session = partial(self._make_session, stream=True)
            self.tcp = TcpServer(options.tcp_host, options.tcp_port, session, self._clock.ns)

    @property
    def images(self) -> int:
        """Images sent so far."""
        return self._outlet.images

    async def run(self, stop: asyncio.Event) -> None:
        """Fly until the end or `stop`. Raises LinkError if a link cannot be opened."""
        try:
            await self._open()
            await self._wait_for_peer(stop)
            await self._fly(stop)
        finally:
            await self._close()

    async def _open(self) -> None:
        for link in (self.udp, self.tcp, self._outlet):
            if link is not None:
                await link.open()
        o = self._options
        tcp = "no TCP" if self.tcp is None else f"TCP {o.tcp_host}:{self.tcp.port}"
        self._report(
            f"{o.scenario.name}, seed {o.seed}: MAVLink {o.mavlink or 'not by UDP'}, {tcp}; {o.destinations}"
        )

    async def _close(self) -> None:
        if self.udp is not None:
            self.udp.close()
        if self.tcp is not None:
            await self.tcp.close()
        await self._outlet.close()
        await asyncio.sleep(0)  # asyncio closes sockets on its next turn

    async def _wait_for_peer(self, stop: asyncio.Event) -> None:
        """Send heartbeats only, until a peer answers and the images have a subscriber.

        Give up after `wait` seconds.
        """
        o = self._options
        deadline = self._now() + o.wait
        if o.wait > 0:
            self._report(f"waiting up to {o.wait:g} s for a peer")
        while not stop.is_set() and self._now() < deadline and not self._peer_is_there():
            self._send_frames(self._clock.ns(), None)
            await asyncio.sleep(POLL_PERIOD_S)

    def _peer_is_there(self) -> bool:
        links = [link for link in (self.udp, self.tcp) if link is not None]
        has_peer = not links or any(link.has_peer for link in links)
        return has_peer and self._outlet.has_viewer()

    async def _fly(self, stop: asyncio.Event) -> None:
        o = self._options
        boot_ns = -(-self._clock.ns() // STEP_NS) * STEP_NS
        end_ns = None if o.duration is None else boot_ns + round(o.duration * NS_PER_S)
        self._report("flying" + (" until stopped" if o.duration is None else f" for {o.duration:g} s"))
        t_ns = boot_ns
        world = self._world
        if self._mode is not None:
            self._mode.begin_ns = boot_ns
            world = states(o.scenario, o.seed, self._mode)
        for tick in ticks(o.scenario, o.seed, boot_ns, world):
            await self._until(tick.t_ns, stop)
            if stop.is_set() or (end_ns is not None and tick.t_ns > end_ns):
                break
            t_ns = tick.t_ns
            self._send(tick)
        await self._outlet.finish()
        self._status(t_ns, finished=True)
        self._report(
            f"sent {self.frames} MAVLink frames and {self.images} images in {(t_ns - boot_ns) * S_PER_NS:.1f} s"
        )
        await self._outlet.flush()

    async def _until(self, t_ns: int, stop: asyncio.Event) -> None:
        """Sleep until the boot clock shows `t_ns`, and serve the sockets at least once."""
        # waiting for the event with a time limit would make and cancel a task 200 times a second
        while (ahead := self._clock.wait_for(t_ns)) > 0 and not stop.is_set():  # noqa: ASYNC110
            await asyncio.sleep(min(ahead, MAX_SLEEP_TIME_S))
        await asyncio.sleep(0)

    def _send(self, tick: Tick) -> None:
        """Send the messages and records of one tick."""
        self._send_frames(tick.t_ns, tick.reading)
        for image in tick.images:
            self._outlet.send_image(image)
        if tick.truth is not None:
            self._outlet.draw(tick.state, tick.t_ns)
            self._outlet.publish(tick.truth)
        self._send_others(tick)
        if tick.state.step % STATUS_STEPS == 0:
            self._status(tick.t_ns, finished=False)

    def _send_frames(self, t_ns: int, reading: Reading | None) -> None:
        if self.udp is not None:
            self.frames += sum(self.udp.send(frame) for frame in self._session.send(t_ns, reading))
        if self.tcp is not None:
            sent = self.tcp.send(t_ns, reading)
            self.frames += sent if self.udp is None else 0

    def _send_others(self, tick: Tick) -> None:
        """Send the records that are not the autopilot's own.

        Reports of traffic, gimbal and rangefinder go to the autopilot's link, which forwards them. Pseudoranges,
        scans and truth go to Zenoh.
        """
        traffic = tick.traffic
        reports = [(report, sender(report, self._vehicle.system)) for report in traffic.reports]
        own = [(report, (report.system, report.component)) for report in (tick.gimbal, tick.distance) if report]
        for report, key in (*reports, *own):
            encoder = self._traffic.setdefault(key, MavlinkEncoder(*key))
            frame = encoder.encode(report)
            if self.udp is not None:
                self.frames += self.udp.send(frame)
            if self.tcp is not None:
                for client in tuple(self.tcp.clients):
                    client.send([frame])
        for record in (traffic.scan, *traffic.ranges, traffic.truth):
            if record is not None:
                self._outlet.publish(record)

    def _status(self, t_ns: int, *, finished: bool) -> None:
        self._outlet.publish(SimStatus(t_ns=t_ns, images=self.images, frames=self.frames, finished=finished))

    def _answer(self, data: bytes) -> list[bytes]:
        """Return the replies to a datagram from the UDP peer, counted in `frames`."""
        replies = self._session.receive(data, self._clock.ns())
        self.frames += len(replies)
        return replies

    def _make_session(self, *, stream: bool) -> AutopilotLink:
        return AutopilotLink(self._vehicle, self._epoch_ns, stream=stream, mode=self._mode)


class Run(Protocol):
    """Anything that runs until it is stopped."""

    async def run(self, stop: asyncio.Event) -> None:
        """Run until the end, or until `stop` is set."""


async def serve(server: Run) -> None:
    """Run until the flight ends or SIGINT, SIGTERM or SIGHUP arrives. Raises LinkError.

    SIGHUP is ignored if `nohup` ignores it.
    """
    ignored = signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    numbers = (signal.SIGINT, signal.SIGTERM, *(() if ignored else (signal.SIGHUP,)))
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in numbers:
        loop.add_signal_handler(number, stop.set)
    try:
        await server.run(stop)
    finally:
        for number in numbers:
            loop.remove_signal_handler(number)
