"""Links over real loopback sockets and a pty: what arrives, what is answered, what happens when the peer goes."""

import asyncio
import os
import socket
import time
from typing import Any

import pytest

from onboard.links import Link, LinkError, parse_link
from onboard.links.link import guarded
from onboard.messages import Datagram, Encoding
from onboard.wire.mavlink.encode import MavlinkEncoder
from tests.support.programs import free_ports
from tests.support.running_link import TIMEOUT_S, until, with_link
from tests.support.streams import heartbeat

FRAME = MavlinkEncoder(1, 1).encode(heartbeat(0))
BROKEN = FRAME[:-1] + bytes([FRAME[-1] ^ 1])  # its checksum is wrong


def udp_peer() -> socket.socket:
    peer = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    peer.bind(("127.0.0.1", 0))
    peer.settimeout(TIMEOUT_S)
    return peer


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("", "udpin:HOST:PORT"),
        ("udp:127.0.0.1:14550", "udpin:HOST:PORT"),
        ("udpin:14550", "host and port"),
        ("udpin:::1:14550", "host and port"),
        ("udpin:127.0.0.1:", "is invalid; use 1 to 65535"),
        ("udpin:127.0.0.1:65536", "is invalid; use 1 to 65535"),
        ("udpin:127.0.0.1:-1", "is invalid; use 1 to 65535"),
        ("udpin:127.0.0.1:²", "is invalid; use 1 to 65535"),
        ("tcp:127.0.0.1:0", "is invalid; use 1 to 65535"),
        ("serial:/dev/ttyAMA0", "serial:DEVICE:BAUD"),
        ("serial:/dev/ttyAMA0:fast", "serial:DEVICE:BAUD"),
        ("serial:/dev/ttyAMA0:0", "serial:DEVICE:BAUD"),
    ],
)
def test_a_bad_link_string_is_named_with_the_valid_forms(spec: str, message: str) -> None:
    with pytest.raises(LinkError, match=message) as caught:
        parse_link(spec, "x")
    assert repr(spec) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("kind", ["udpin", "tcpin"])
def test_a_port_in_use_is_a_link_error(kind: str) -> None:
    async def check(link: Any, _: list[Datagram]) -> None:
        other: Link = parse_link(f"{kind}:127.0.0.1:{link.address[1]}", "other")
        with pytest.raises(LinkError, match="another onboard"):
            await other.open()

    with_link(f"{kind}:127.0.0.1:0", check)


def test_a_tcp_client_that_may_not_retry_fails_at_once() -> None:
    link = parse_link(f"tcp:127.0.0.1:{free_ports(socket.SOCK_STREAM)[0]}", "x", retry=False)
    with pytest.raises(LinkError, match="cannot connect"):
        asyncio.run(link.open())


def test_udpin_keeps_datagrams_whole_and_in_order_garbage_included() -> None:
    pieces = [FRAME, b"\x00", FRAME[:5], os.urandom(300), b"\xfd" * 60_000, FRAME]

    async def check(link: Any, received: list[Datagram]) -> None:
        with udp_peer() as peer:
            for piece in pieces:
                peer.sendto(piece, link.address)
            await until(lambda: len(received) == len(pieces))
        assert [d.data for d in received] == pieces
        assert {(d.channel, d.encoding) for d in received} == {("autopilot", Encoding.MAVLINK)}
        assert link.received == len(pieces)

    with_link("udpin:127.0.0.1:0", check)


def test_udpin_sends_to_nobody_before_a_mavlink_frame_and_then_to_its_sender() -> None:
    async def check(link: Any, received: list[Datagram]) -> None:
        with udp_peer() as stray, udp_peer() as first, udp_peer() as second:
            stray.sendto(b"GET / HTTP/1.1", link.address)
            await until(lambda: len(received) == 1)
            link.send(b"to nobody")
            assert (link.sent, link.errors) == (0, 1)
            encoder = MavlinkEncoder(1, 1)  # a frame that comes twice counts once
            for n, peer in enumerate((first, second), 2):
                peer.sendto(encoder.encode(heartbeat(0)), link.address)
                stray.sendto(BROKEN, link.address)
                await until(lambda n=n: len(received) == 2 * n - 1)
                link.send(b"to %d" % n)
                assert await asyncio.to_thread(peer.recv, 100) == b"to %d" % n
            assert link.sent == 2

    with_link("udpin:127.0.0.1:0", check)


def test_a_datagram_is_stamped_at_arrival_not_when_the_loop_reads_it() -> None:
    """By the kernel's stamp: a loop that is busy for 200 ms does not change it. The first ones may come before the
    kernel, asked for stamps, begins with them; it then stamps when it is read."""

    async def check(link: Any, received: list[Datagram]) -> None:
        late_ns = []
        with udp_peer() as peer:
            while len(late_ns) < 10 and not (late_ns and late_ns[-1] < 100_000_000):
                before = time.time_ns()
                peer.sendto(FRAME, link.address)
                time.sleep(0.2)  # noqa: ASYNC251 - the loop is to be late
                await until(lambda: len(received) > len(late_ns))
                late_ns.append(received[-1].t_recv_ns - before)
        assert -1_000_000 <= late_ns[-1] < 100_000_000, late_ns

    with_link("udpin:127.0.0.1:0", check)


def test_udpout_sends_first_receives_only_from_its_peer_and_survives_its_absence() -> None:
    port = free_ports(socket.SOCK_DGRAM)[0]

    async def check(link: Any, received: list[Datagram]) -> None:
        for _ in range(3):
            link.send(FRAME)  # nobody is there: the kernel reports it on the next call
            await asyncio.sleep(0.02)
        assert link.errors > 0
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer, udp_peer() as stranger:
            peer.bind(("127.0.0.1", port))
            peer.settimeout(TIMEOUT_S)
            link.send(b"hello")
            data, sender = await asyncio.to_thread(peer.recvfrom, 100)
            assert data == b"hello"
            stranger.sendto(b"spoofed", sender)
            peer.sendto(FRAME, sender)
            await until(lambda: received)
        assert [d.data for d in received] == [FRAME]

    with_link(f"udpout:127.0.0.1:{port}", check)


def test_udpout_sends_from_the_same_port_after_a_restart() -> None:
    """PX4 sends for ever to the first port that it has heard."""
    port, ports = free_ports(socket.SOCK_DGRAM)[0], list[int]()

    async def check(link: Any, _: list[Datagram]) -> None:
        ports.append(link.address[1])

    for _ in range(2):
        with_link(f"udpout:127.0.0.1:{port}", check)
    assert ports[0] == ports[1]


def test_an_exception_of_deliver_ends_the_link_and_is_raised() -> None:
    async def main() -> None:
        link: Any = parse_link("udpin:127.0.0.1:0", "x")
        await link.open()

        def deliver(_: Datagram) -> None:
            raise ZeroDivisionError("a bug")

        with udp_peer() as peer:
            peer.sendto(FRAME, link.address)
            async with asyncio.timeout(TIMEOUT_S):
                with pytest.raises(ZeroDivisionError):
                    await link.run(deliver, time.time_ns)

    asyncio.run(main())


def test_what_cannot_be_sent_over_udp_is_counted_and_the_next_may_be() -> None:
    async def test(link: Any, received: list[Datagram]) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer:
            peer.sendto(MavlinkEncoder(1, 1).encode(heartbeat(0)), link.address)
            await until(lambda: received)
            link.send(bytes(70_000))  # larger than a datagram may be
            assert (link.sent, link.errors) == (0, 1)
            link.send(b"next")
            assert (link.sent, link.errors) == (1, 1)
            peer.settimeout(20.0)
            assert peer.recv(100) == b"next"

    with_link("udpin:127.0.0.1:0", test)


def test_an_error_in_the_delivery_reaches_the_link_and_ends_it() -> None:
    delivered: list[Datagram] = []

    def deliver(datagram: Datagram) -> bool:
        delivered.append(datagram)
        if len(delivered) > 1:
            raise RuntimeError("broken")
        return True

    async def end() -> None:
        failed: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        safe, one = (
            guarded(deliver, failed),
            Datagram(channel="a", encoding=Encoding.MAVLINK, t_recv_ns=0, data=b""),
        )
        assert [safe(one), safe(one), safe(one)] == [True, False, False]
        assert len(delivered) == 2
        with pytest.raises(RuntimeError, match="broken"):
            await failed

    asyncio.run(end())
