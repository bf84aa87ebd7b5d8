"""The simulator as a process: it paces a run by the clock, sends its messages and answers commands.

Nothing here waits for a receiver. On a computer too slow for the requested speed the flight slows down, and the
boot clock with it: stamps and TIMESYNC replies always agree.
"""

import asyncio
import signal
from collections.abc import Callable
from functools import partial
from typing import Final, Literal

from onboard.messages import Record, SimStatus
from onboard.wire.mavlink_encode import MavlinkEncoder
from simlink.autopilot import AutopilotLink
from simlink.scenarios.scenario import Scenario
from simlink.sensors.camera import Image, camera_points, target_points
from simlink.sensors.gimbal import make_gimbal
from simlink.sensors.navigation import Reading
from simlink.sensors.pictures import Painter
from simlink.server.links import LinkError, TcpServer, UdpLink, parse_udp
from simlink.server.publish import Published, ZenohPublisher, check_vehicle
from simlink.simulation import CAMERA_COMPONENT, Tick, boot_ns_of, ticks
from simlink.traffic.reports import sender
from simlink.world.constants import STEP_NS, STEPS_PER_SECOND
from simlink.world.drawn import drawn
from simlink.world.follow import FollowMode, following_states
from simlink.world.truth import true_size

MOST_BEHIND: Final = 0.25  # s of wall time; beyond that the boot clock is set back
STATUS_STEPS: Final = STEPS_PER_SECOND // 5
WAIT_POLL: Final = 0.02  # s
LONGEST_SLEEP: Final = 0.05  # s: a stop is noticed this soon
FLUSH: Final = 0.2  # s, for Zenoh to send the last records


class Options(Record, frozen=True, kw_only=True):
    """Options of a run. `duration` in s of flight (None: endless), `wait` in s of wall time; a link that is None
    is absent."""

    scenario: Scenario
    seed: int = 1
    speed: float = 1.0
    duration: float | None = None
    mavlink: str | None = "udpout:127.0.0.1:14540"
    camera: Literal["zenoh", "mavlink", "both", "none"] = "zenoh"
    camera_mavlink: str = "udpout:127.0.0.1:14560"
    tcp_host: str = "127.0.0.1"
    tcp_port: int | None = 5760
    zenoh: str | None = "tcp/127.0.0.1:7447"
    vehicle: str = "1"
    wait: float = 0.0


class BootClock:
    """The autopilot's time since boot. It runs `speed` times as fast as `now` (s, monotonic)."""

    def __init__(self, now: Callable[[], float], boot_ns: int, speed: float) -> None:
        self._now = now
        self._speed = speed
        self._anchor = (now(), boot_ns)

    def ns(self) -> int:
        """Time since boot, ns."""
        wall, boot_ns = self._anchor
        return boot_ns + round((self._now() - wall) * self._speed * 1e9)

    def wait_for(self, t_ns: int) -> float:
        """Wall seconds until `t_ns`, negative when it has passed. The clock is set back when that was too long
        ago."""
        ahead = (t_ns - self.ns()) * 1e-9 / self._speed
        if ahead < -MOST_BEHIND:
            self._anchor = (self._now(), t_ns)
            return 0.0
        return ahead


class Server:
    """One run. `await run(stop)` opens the links, flies, and closes them in any case.

    `now` is a monotonic clock in seconds, `unix_ns` the present Unix time, for SYSTEM_TIME; `report` is called
    with one line of text at a time. Raises LinkError for invalid options.
    """

    def __init__(
        self, options: Options, now: Callable[[], float], unix_ns: int, report: Callable[[str], None]
    ) -> None:
        if options.camera in ("zenoh", "both") and options.zenoh is None:
            raise LinkError("images over Zenoh need an endpoint; or choose --camera mavlink or none")
        check_vehicle(options.vehicle)
        self.images = self.frames = 0  # sent so far
        self._options, self._now, self._report = options, now, report
        self._vehicle = options.scenario.vehicle
        boot_ns = boot_ns_of(options.scenario)
        self._clock = BootClock(now, boot_ns, options.speed)
        self._epoch_ns = unix_ns - boot_ns
        follow = options.scenario.follow
        self._follow = None if follow is None else FollowMode(follow)  # the follower flies on FOLLOW_TARGETs
        self._session = self._make_session(stream=False)
        self._vision = MavlinkEncoder(self._vehicle.system, CAMERA_COMPONENT)
        self._traffic: dict[tuple[int, int], MavlinkEncoder] = {}  # by system and component
        self._painter: Painter | None = None
        self._painting: asyncio.Task[None] | None = None  # the picture that is being drawn
        if options.scenario.camera.pictures != "none":
            flown = drawn(options.scenario, options.seed)
            gimbal = make_gimbal(flown.camera, options.seed)
            mount = None if gimbal is None else gimbal.mount
            self._painter = Painter(flown.camera, true_size(flown, options.seed), options.seed, mount)
        self._zenoh: ZenohPublisher | None = None
        self.udp: UdpLink | None = None
        self.camera: UdpLink | None = None
        self.tcp: TcpServer | None = None
        if options.mavlink is not None:
            self.udp = UdpLink(parse_udp(options.mavlink), self._answer)
        if options.camera in ("mavlink", "both"):
            self.camera = UdpLink(parse_udp(options.camera_mavlink), lambda _: ())
        if options.tcp_port is not None:
            session = partial(self._make_session, stream=True)
            self.tcp = TcpServer(options.tcp_host, options.tcp_port, session, self._clock.ns)

    async def run(self, stop: asyncio.Event) -> None:
        """Fly until the duration is over or `stop` is set. Raises LinkError when a link cannot be opened."""
        try:
            await self._open()
            await self._wait_for_peer(stop)
            await self._fly(stop)
        finally:
            await self._close()

    async def _open(self) -> None:
        for link in (self.udp, self.camera, self.tcp):
            if link is not None:
                await link.open()
        o = self._options
        if o.zenoh is not None:
            arguments = (o.zenoh, o.vehicle, o.scenario.camera.name, o.scenario.traffic.radar.name)
            self._zenoh = await asyncio.to_thread(ZenohPublisher.open, *arguments)
        tcp = "no TCP" if self.tcp is None else f"TCP {o.tcp_host}:{self.tcp.port}"
        images = {"mavlink": o.camera_mavlink, "both": f"{o.zenoh} and {o.camera_mavlink}", "none": "nowhere"}
        self._report(
            f"{o.scenario.name}, seed {o.seed}: MAVLink {o.mavlink or 'not by UDP'}, {tcp}; "
            f"images {images.get(o.camera, o.zenoh)}; truth {o.zenoh or 'nowhere'}"
        )

    async def _close(self) -> None:
        for link in (self.udp, self.camera):
            if link is not None:
                link.close()
        if self.tcp is not None:
            await self.tcp.close()
        if self._zenoh is not None:
            await asyncio.to_thread(self._zenoh.close)
        await asyncio.sleep(0)  # asyncio closes sockets on its next turn

    async def _wait_for_peer(self, stop: asyncio.Event) -> None:
        """Send heartbeats only, until a peer has sent something and the images have a subscriber, or `wait` is
        over."""
        o = self._options
        deadline = self._now() + o.wait
        if o.wait > 0:
            self._report(f"waiting up to {o.wait:g} s for a peer")
        while not stop.is_set() and self._now() < deadline and not self._peer_is_there():
            self._send_frames(self._clock.ns(), None)
            await asyncio.sleep(WAIT_POLL)

    def _peer_is_there(self) -> bool:
        links = [link for link in (self.udp, self.tcp) if link is not None]
        has_peer = not links or any(link.has_peer for link in links)
        if self._zenoh is None or self._options.camera not in ("zenoh", "both"):
            return has_peer
        return has_peer and self._zenoh.has_viewer()

    async def _fly(self, stop: asyncio.Event) -> None:
        o = self._options
        boot_ns = -(-self._clock.ns() // STEP_NS) * STEP_NS
        end_ns = None if o.duration is None else boot_ns + round(o.duration * 1e9)
        self._report("flying" + (" until stopped" if o.duration is None else f" for {o.duration:g} s"))
        t_ns = boot_ns
        world = None
        if self._follow is not None:
            self._follow.begin_ns = boot_ns
            world = following_states(o.scenario, o.seed, self._follow)
        for tick in ticks(o.scenario, o.seed, boot_ns, world):
            await self._until(tick.t_ns, stop)
            if stop.is_set() or (end_ns is not None and tick.t_ns > end_ns):
                break
            t_ns = tick.t_ns
            self._send(tick)
        if self._painting is not None:
            await self._painting  # so that the last picture is counted
        self._status(t_ns, finished=True)
        self._report(
            f"sent {self.frames} MAVLink frames and {self.images} images in {(t_ns - boot_ns) * 1e-9:.1f} s"
        )
        if self._zenoh is not None:
            await asyncio.sleep(FLUSH)

    async def _until(self, t_ns: int, stop: asyncio.Event) -> None:
        """Sleep until the boot clock shows `t_ns`; the event loop serves the sockets at least once."""
        # waiting for the event with a time limit would make and cancel a task 200 times a second
        while (ahead := self._clock.wait_for(t_ns)) > 0 and not stop.is_set():  # noqa: ASYNC110
            await asyncio.sleep(min(ahead, LONGEST_SLEEP))
        await asyncio.sleep(0)

    def _send(self, tick: Tick) -> None:
        """Send the messages and records of one tick."""
        self._send_frames(tick.t_ns, tick.reading)
        for image in tick.images if self._painter is None else ():
            self._send_image(image)
        if tick.truth is not None and self._painter is not None and (not self._painting or self._painting.done()):
            self._painting = asyncio.create_task(self._send_picture(self._painter, tick))
        if tick.truth is not None:
            self._publish(tick.truth)
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
        """Reports of traffic, the gimbal's and the rangefinder's go out on the autopilot's link, which forwards
        them; pseudoranges, scans and truth go out over Zenoh."""
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
                self._publish(record)

    def _send_image(self, image: Image) -> None:
        camera = self._options.scenario.camera
        if self._options.camera in ("zenoh", "both"):
            self._publish(camera_points(image, camera))
        if self.camera is not None:
            self.camera.send(self._vision.encode(target_points(image, camera)))
        self.images += self._options.camera != "none"

    async def _send_picture(self, painter: Painter, tick: Tick) -> None:
        """Draw and publish what the camera sees; while it takes too long, exposures are left out."""
        self._publish(await asyncio.to_thread(painter.picture, tick.state, tick.t_ns))
        self.images += 1

    def _status(self, t_ns: int, *, finished: bool) -> None:
        self._publish(SimStatus(t_ns=t_ns, images=self.images, frames=self.frames, finished=finished))

    def _publish(self, record: Published) -> None:
        """Publish a record over Zenoh, if there is a session."""
        if self._zenoh is not None:
            self._zenoh.put(record)

    def _answer(self, data: bytes) -> list[bytes]:
        """Replies to a datagram from the UDP peer; they are counted in `frames`."""
        replies = self._session.receive(data, self._clock.ns())
        self.frames += len(replies)
        return replies

    def _make_session(self, *, stream: bool) -> AutopilotLink:
        return AutopilotLink(self._vehicle, self._epoch_ns, stream=stream, follow=self._follow)


async def serve(server: Server) -> None:
    """Run until the flight ends or a signal arrives: SIGINT, SIGTERM, and unless `nohup` ignores it SIGHUP. Raises
    LinkError."""
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
