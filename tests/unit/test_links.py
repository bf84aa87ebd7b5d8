"""Links over real loopback sockets and a pty: what arrives, what is answered, what happens when the peer goes."""

import asyncio
import os
import socket
import time
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import Any

import pytest

from onboard.links import Link, LinkError, parse_link
from onboard.messages import Datagram, Encoding

FRAME = bytes.fromhex("fe0009010100000000000000")
TIMEOUT_S = 10.0


async def until(condition: Callable[[], Any]) -> None:
    async with asyncio.timeout(TIMEOUT_S):
        while not condition():  # noqa: ASYNC110 - what is awaited is a counter
            await asyncio.sleep(0.005)


def with_link(spec: str, story: Callable[[Any, list[Datagram]], Awaitable[None]], **options: Any) -> None:
    """Open and run a link while `story` happens to it, then cancel it."""

    async def main() -> None:
        link = parse_link(spec, "autopilot", **options)
        await link.open()
        heard: list[Datagram] = []
        task = asyncio.create_task(link.run(heard.append, time.time_ns))
        await asyncio.sleep(0)
        try:
            await story(link, heard)
        finally:
            task.cancel()
            with suppress(asyncio.CancelledError):
                await task

    asyncio.run(main())


def free_port(kind: socket.SocketKind = socket.SOCK_STREAM) -> int:
    with socket.socket(socket.AF_INET, kind) as s:
        s.bind(("127.0.0.1", 0))
        return int(s.getsockname()[1])


def udp_peer() -> socket.socket:
    peer = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    peer.bind(("127.0.0.1", 0))
    peer.settimeout(TIMEOUT_S)
    return peer


@pytest.mark.parametrize(
    ("spec", "says"),
    [
        ("", "udpin:HOST:PORT"),
        ("udp:127.0.0.1:14550", "udpin:HOST:PORT"),
        ("udpin:14550", "host and port"),
        ("udpin:::1:14550", "host and port"),
        ("udpin:127.0.0.1:", "no port"),
        ("udpin:127.0.0.1:65536", "no port"),
        ("udpin:127.0.0.1:-1", "no port"),
        ("udpin:127.0.0.1:²", "no port"),
        ("tcp:127.0.0.1:0", "no port"),
        ("serial:/dev/ttyAMA0", "serial:DEVICE:BAUD"),
        ("serial:/dev/ttyAMA0:fast", "serial:DEVICE:BAUD"),
        ("serial:/dev/ttyAMA0:0", "serial:DEVICE:BAUD"),
    ],
)
def test_a_bad_link_string_is_named_with_what_would_be_right(spec: str, says: str) -> None:
    with pytest.raises(LinkError, match=says) as caught:
        parse_link(spec, "x")
    assert repr(spec) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "spec",
    [
        "udpin:no-such-host.invalid:14550",
        "tcp:no-such-host.invalid:5760",
        "udpin:192.0.2.1:14550",  # an address, but not ours
        "tcpin:192.0.2.1:5760",
        "serial:/dev/no-such-device:57600",
        "serial:/dev/null:57600",
    ],
)
def test_what_cannot_be_opened_says_so_before_anything_runs(spec: str) -> None:
    with pytest.raises(LinkError) as caught:
        asyncio.run(parse_link(spec, "x").open())
    assert str(caught.value).startswith(spec)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("kind", ["udpin", "tcpin"])
def test_a_port_in_use_is_a_link_error(kind: str) -> None:
    async def story(link: Any, _: list[Datagram]) -> None:
        other: Link = parse_link(f"{kind}:127.0.0.1:{link.address[1]}", "other")
        with pytest.raises(LinkError, match="another onboard"):
            await other.open()

    with_link(f"{kind}:127.0.0.1:0", story)


def test_a_tcp_client_that_may_not_retry_fails_at_once() -> None:
    link = parse_link(f"tcp:127.0.0.1:{free_port()}", "x", retry=False)
    with pytest.raises(LinkError, match="cannot connect"):
        asyncio.run(link.open())


def test_udpin_keeps_datagrams_whole_and_in_order_garbage_included() -> None:
    pieces = [FRAME, b"\x00", FRAME[:5], os.urandom(300), b"\xfd" * 60_000, FRAME]

    async def story(link: Any, heard: list[Datagram]) -> None:
        with udp_peer() as peer:
            for piece in pieces:
                peer.sendto(piece, link.address)
            await until(lambda: len(heard) == len(pieces))
        assert [d.data for d in heard] == pieces
        assert {(d.channel, d.encoding) for d in heard} == {("autopilot", Encoding.MAVLINK)}
        assert link.received == len(pieces)

    with_link("udpin:127.0.0.1:0", story)


def test_udpin_has_nobody_to_answer_until_a_mavlink_frame_came_and_then_follows_its_sender() -> None:
    async def story(link: Any, heard: list[Datagram]) -> None:
        with udp_peer() as stray, udp_peer() as first, udp_peer() as second:
            stray.sendto(b"GET / HTTP/1.1", link.address)
            await until(lambda: len(heard) == 1)
            link.send(b"to nobody")
            assert (link.sent, link.errors) == (0, 1)
            for n, peer in enumerate((first, second), 2):
                peer.sendto(FRAME, link.address)
                stray.sendto(b"\xfe", link.address)
                await until(lambda n=n: len(heard) == 2 * n - 1)
                link.send(b"to %d" % n)
                assert await asyncio.to_thread(peer.recv, 100) == b"to %d" % n
            assert link.sent == 2

    with_link("udpin:127.0.0.1:0", story)


def test_a_datagram_is_stamped_when_it_arrived_not_when_the_loop_got_to_it() -> None:
    """The kernel's stamp: a loop busy for 200 ms makes the datagram no younger."""

    async def story(link: Any, heard: list[Datagram]) -> None:
        with udp_peer() as peer:
            before = time.time_ns()
            peer.sendto(FRAME, link.address)
            time.sleep(0.2)  # noqa: ASYNC251 - the loop is to be late
            await until(lambda: heard)
        assert before - 1_000_000 <= heard[0].t_recv_ns < before + 100_000_000

    with_link("udpin:127.0.0.1:0", story)


def test_udpout_speaks_first_hears_only_its_peer_and_survives_its_absence() -> None:
    port = free_port(socket.SOCK_DGRAM)

    async def story(link: Any, heard: list[Datagram]) -> None:
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
            await until(lambda: heard)
        assert [d.data for d in heard] == [FRAME]

    with_link(f"udpout:127.0.0.1:{port}", story)


def test_what_deliver_raises_ends_the_link_and_is_not_swallowed() -> None:
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


def test_a_tcp_client_connects_again_after_the_server_restarted() -> None:
    port = free_port()

    async def serve(data: bytes) -> tuple[asyncio.Server, list[bytes]]:
        got: list[bytes] = []

        async def talk(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            writer.write(data)
            got.append(await reader.read(100))
            writer.close()

        return await asyncio.start_server(talk, "127.0.0.1", port), got

    async def story(link: Any, heard: list[Datagram]) -> None:
        link.send(b"too early")
        assert (link.sent, link.errors) == (0, 1)
        await asyncio.sleep(0.15)  # its first attempt fails
        for greeting in (b"first", b"second"):
            server, got = await serve(greeting)
            await until(lambda greeting=greeting: b"".join(d.data for d in heard).endswith(greeting))
            link.send(b"reply")
            await until(lambda got=got: got == [b"reply"])
            server.close()
            await server.wait_closed()
        assert {d.encoding for d in heard} == {Encoding.MAVLINK_STREAM}

    with_link(f"tcp:127.0.0.1:{port}", story)


def test_a_tcp_client_drops_when_its_peer_does_not_read() -> None:
    async def main() -> None:
        with socket.create_server(("127.0.0.1", 0)) as server:
            link = parse_link(f"tcp:127.0.0.1:{server.getsockname()[1]}", "x")
            task = asyncio.create_task(link.run(lambda _: None, time.time_ns))
            peer, _ = await asyncio.to_thread(server.accept)
            async with asyncio.timeout(TIMEOUT_S):
                while link.errors < 100:
                    link.send(bytes(4096))
                    await asyncio.sleep(0)
            task.cancel()
            with suppress(asyncio.CancelledError):
                await task
            peer.close()

    asyncio.run(main())


def test_tcpin_talks_to_the_newest_peer() -> None:
    async def story(link: Any, heard: list[Datagram]) -> None:
        reader1, writer1 = await asyncio.open_connection(*link.address)
        writer1.write(b"one")
        await until(lambda: heard)
        _, writer2 = await asyncio.open_connection(*link.address)
        with suppress(ConnectionError):
            assert await reader1.read() == b""  # the older one was closed
        writer2.write(b"two")
        await until(lambda: len(heard) == 2)
        link.send(b"x")
        assert link.sent == 1
        assert [d.data for d in heard] == [b"one", b"two"]
        writer1.close()
        writer2.close()

    with_link("tcpin:127.0.0.1:0", story)


def test_serial_reads_writes_and_drops_when_full() -> None:
    master, slave = os.openpty()

    async def story(link: Any, heard: list[Datagram]) -> None:
        os.write(master, b"\xfd\x00\x0a\x11\x13\x03\x7f")  # a raw port: no line discipline may eat these
        await until(lambda: sum(len(d.data) for d in heard) == 7)
        assert b"".join(d.data for d in heard) == b"\xfd\x00\x0a\x11\x13\x03\x7f"
        assert heard[0].encoding == Encoding.MAVLINK_STREAM
        link.send(b"\n\xfe\x00")
        assert await asyncio.to_thread(os.read, master, 100) == b"\n\xfe\x00"
        while link.errors == 0:  # nobody reads now: the kernel fills, then we do
            link.send(bytes(1000))
        accepted, got = (link.sent - 1) * 1000, 0
        async with asyncio.timeout(TIMEOUT_S):
            while got < accepted:  # what was accepted arrives whole
                got += len(await asyncio.to_thread(os.read, master, 65536))
        assert got == accepted

    try:
        with_link(f"serial:{os.ttyname(slave)}:115200", story)
    finally:
        os.close(master)
        os.close(slave)


def test_a_serial_port_in_use_is_a_link_error() -> None:
    master, slave = os.openpty()
    spec = f"serial:{os.ttyname(slave)}:57600"

    async def story(_: Any, __: list[Datagram]) -> None:
        with pytest.raises(LinkError, match="free"):
            await parse_link(spec, "other").open()

    try:
        with_link(spec, story)
    finally:
        os.close(master)
        os.close(slave)


def test_a_serial_port_unplugged_and_plugged_in_again_goes_on(tmp_path: Any) -> None:
    device = tmp_path / "ttyUSB0"
    first = os.openpty()
    device.symlink_to(os.ttyname(first[1]))

    async def story(link: Any, heard: list[Datagram]) -> None:
        os.write(first[0], b"one")
        await until(lambda: heard)
        for fd in first:
            os.close(fd)
        device.unlink()
        await until(lambda: link.errors > 0)
        second = os.openpty()
        try:
            device.symlink_to(os.ttyname(second[1]))
            os.write(second[0], b"two")
            await until(lambda: b"two" in heard[-1].data or os.write(second[0], b"two") == 0)
        finally:
            for fd in second:
                os.close(fd)

    with_link(f"serial:{device}:57600", story)
