"""simlink over real sockets on loopback, against independent peers. Ports are ephemeral; assertions are on the
messages received until the simulator has finished, never on wall-clock time."""

import asyncio
import socket
from collections import Counter
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from simlink.server.server import BootClock
from tests.support.simlink_server import make, run, until


class Peer(asyncio.DatagramProtocol):
    """A companion computer that reads with pymavlink; `first` makes its reply to the first frame."""

    def __init__(self, first: Callable[[dialect.MAVLink], list[bytes]] = lambda _: []) -> None:
        self.frames: list[Any] = []
        self._first: Callable[[dialect.MAVLink], list[bytes]] | None = first
        self._mav = dialect.MAVLink(None, srcSystem=1, srcComponent=191)
        self.transport: asyncio.DatagramTransport

    def connection_made(self, transport: Any) -> None:
        self.transport = transport

    def datagram_received(self, data: bytes, addr: Any) -> None:
        self.frames += self._mav.parse_buffer(data) or []
        if self._first is not None:
            for frame in self._first(self._mav):
                self.transport.sendto(frame, addr)
            self._first = None

    @property
    def names(self) -> Counter[str]:
        return Counter(frame.get_type() for frame in self.frames)

    async def open(self) -> int:
        loop = asyncio.get_running_loop()
        await loop.create_datagram_endpoint(lambda: self, local_addr=("127.0.0.1", 0))
        return int(self.transport.get_extra_info("sockname")[1])


async def settle(peer: Peer, count: Callable[[], int]) -> None:
    """Wait until the peer has received `count()` frames."""
    await until(lambda: len(peer.frames) >= count())


def test_a_pymavlink_peer_gets_every_frame_seed_1() -> None:
    async def main() -> None:
        peer, points = Peer(), Peer()
        to = f"udpout:127.0.0.1:{await peer.open()}"
        camera = f"udpout:127.0.0.1:{await points.open()}"
        server = make(mavlink=to, camera="mavlink", camera_mavlink=camera)
        await server.run(asyncio.Event())
        await settle(peer, lambda: server.frames)
        await settle(points, lambda: 3 * server.images)
        assert len(peer.frames) == server.frames
        assert {k: peer.names[k] for k in ("HEARTBEAT", "ATTITUDE_QUATERNION", "HIGHRES_IMU")} == {
            "HEARTBEAT": 3,
            "ATTITUDE_QUATERNION": 101,
            "HIGHRES_IMU": 201,
        }
        assert "LANDING_TARGET" not in peer.names
        assert points.names == {"LANDING_TARGET": 3 * server.images}
        assert server.images > 40
        assert {f.get_srcComponent() for f in points.frames} == {191}
        stamps = [f.time_boot_ms for f in peer.frames if f.get_type() == "LOCAL_POSITION_NED"]
        assert {b - a for a, b in pairwise(stamps)} == {20}
        peer.transport.close()
        points.transport.close()

    run(main)


def test_a_peer_sets_intervals_and_synchronises_over_udp_seed_1() -> None:
    def first(mav: dialect.MAVLink) -> list[bytes]:
        interval = dialect.MAVLink_command_long_message(1, 1, 511, 0, 31, -1, 0, 0, 0, 0, 0)
        odd = dialect.MAVLink_command_long_message(1, 1, 42, 0, 0, 0, 0, 0, 0, 0, 0)
        return [m.pack(mav) for m in (interval, odd, dialect.MAVLink_timesync_message(0, 77))] + [b"rubbish"]

    async def main() -> None:
        peer = Peer(first)
        server = make(mavlink=f"udpout:127.0.0.1:{await peer.open()}", wait=1000.0)
        await server.run(asyncio.Event())
        await settle(peer, lambda: server.frames)
        assert len(peer.frames) == server.frames
        acks = [(f.command, f.result) for f in peer.frames if f.get_type() == "COMMAND_ACK"]
        assert acks == [(511, 0), (42, 3)]
        (sync,) = (f for f in peer.frames if f.get_type() == "TIMESYNC")
        assert sync.ts1 == 77
        assert sync.tc1 >= 40_000_000_000
        assert peer.names["ATTITUDE_QUATERNION"] == 0
        assert peer.names["LOCAL_POSITION_NED"] == 101
        peer.transport.close()

    run(main)


def test_it_flies_on_when_nobody_listens_seed_1() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as held:
        held.bind(("127.0.0.1", 0))
        nobody = held.getsockname()[1]

    async def main() -> None:
        lines: list[str] = []
        server = make(lines, mavlink=f"udpout:127.0.0.1:{nobody}")
        await server.run(asyncio.Event())
        assert server.udp is not None
        assert server.udp.refused > 0
        assert lines[-1].endswith("in 2.0 s")

    run(main)


def test_tcp_clients_have_sessions_of_their_own_seed_1() -> None:
    async def main() -> None:
        server, stop = make(tcp_port=0, duration=None, speed=4.0), asyncio.Event()
        flight = asyncio.create_task(server.run(stop))
        assert server.tcp is not None
        await until(lambda: server.tcp.is_open)
        streams = [await asyncio.open_connection("127.0.0.1", server.tcp.port) for _ in range(2)]
        mav = dialect.MAVLink(None, srcSystem=255, srcComponent=190)
        quiet = dialect.MAVLink_command_long_message(1, 1, 511, 0, 31, -1, 0, 0, 0, 0, 0)
        streams[0][1].write(quiet.pack(mav))
        names = []
        for reader, _ in streams:
            parser, seen = dialect.MAVLink(None), Counter[str]()
            while seen["LOCAL_POSITION_NED"] < 60:
                seen.update(f.get_type() for f in parser.parse_buffer(await reader.read(500)) or ())
            names.append(seen)
        assert names[0]["COMMAND_ACK"] == 1
        assert names[0]["ATTITUDE_QUATERNION"] < 30 < names[1]["ATTITUDE_QUATERNION"]
        stop.set()
        await flight
        for reader, writer in streams:
            writer.close()
            assert reader.exception() is None or isinstance(reader.exception(), ConnectionError)

    run(main)


def test_udpin_sends_to_its_first_sender_seed_1() -> None:
    async def main() -> None:
        peer, stop = Peer(), asyncio.Event()
        await peer.open()
        server = make(mavlink="udpin:127.0.0.1:0", wait=1000.0)
        flight = asyncio.create_task(server.run(stop))
        assert server.udp is not None
        await until(lambda: server.udp.is_open)
        peer.transport.sendto(b"hello", server.udp.address)
        await flight
        await settle(peer, lambda: server.frames)
        assert peer.names["LOCAL_POSITION_NED"] == 101
        peer.transport.close()

    run(main)


def test_the_boot_clock_slips_rather_than_lie() -> None:
    now = 100.0
    clock = BootClock(lambda: now, 40_000_000_000, 2.0)
    now = 101.0
    assert clock.ns() == 42_000_000_000
    assert clock.wait_for(43_000_000_000) == pytest.approx(0.5)
    assert clock.wait_for(41_800_000_000) == pytest.approx(-0.1)  # late, but it will catch up
    now = 105.0
    assert clock.wait_for(42_000_000_000) == 0.0
    assert clock.ns() == 42_000_000_000
