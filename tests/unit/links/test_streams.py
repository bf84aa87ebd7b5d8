"""Links that are streams: TCP and serial, lost and found again."""

import asyncio
import os
import socket
import time
from contextlib import suppress
from typing import Any

import pytest

from onboard.config import Config
from onboard.links import LinkError, parse_link, tcp
from onboard.messages import Datagram, Encoding, LinkHealth
from onboard.pipeline import Pipeline, Rim
from onboard.sinks.console import ConsoleLines
from onboard.wire.mavlink.encode import MavlinkEncoder
from tests.support.programs import free_ports
from tests.support.running_link import TIMEOUT_S, until, with_link
from tests.support.streams import heartbeat

SHORT_S = 20.0  # what takes longer hangs
BEAT = MavlinkEncoder(1, 1).encode(heartbeat(0))


def test_a_tcp_client_connects_again_after_the_server_restarted() -> None:
    port = free_ports(socket.SOCK_STREAM)[0]

    async def serve(data: bytes) -> tuple[asyncio.Server, list[bytes]]:
        got: list[bytes] = []

        async def talk(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            writer.write(data)
            got.append(await reader.read(100))
            writer.close()

        return await asyncio.start_server(talk, "127.0.0.1", port), got

    async def check(link: Any, received: list[Datagram]) -> None:
        link.send(b"too early")
        assert (link.sent, link.errors) == (0, 1)
        await asyncio.sleep(0.15)  # its first attempt fails
        for greeting in (b"first", b"second"):
            server, got = await serve(greeting)
            await until(lambda greeting=greeting: b"".join(d.data for d in received).endswith(greeting))
            link.send(b"reply")
            await until(lambda got=got: got == [b"reply"])
            server.close()
            await server.wait_closed()
        assert {d.encoding for d in received} == {Encoding.MAVLINK_STREAM}

    with_link(f"tcp:127.0.0.1:{port}", check)


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


def test_tcpin_talks_to_the_newest_peer_where_none_gives_messages() -> None:
    async def check(link: Any, received: list[Datagram]) -> None:
        reader1, writer1 = await asyncio.open_connection(*link.address)
        writer1.write(b"one")
        await until(lambda: received)
        _, writer2 = await asyncio.open_connection(*link.address)
        with suppress(ConnectionError):
            assert await asyncio.wait_for(reader1.read(), SHORT_S) == b""  # the older one was closed
        writer2.write(b"two")
        await until(lambda: len(received) == 2)
        link.send(b"x")
        assert link.sent == 1
        assert [d.data for d in received] == [b"one", b"two"]
        assert link.health().refused == 0
        writer1.close()
        writer2.close()

    with_link("tcpin:127.0.0.1:0", check)


def test_tcpin_keeps_a_peer_that_gives_messages_and_names_who_else_knocks() -> None:
    async def check(link: Any, received: list[Datagram]) -> None:
        reader, writer = await asyncio.open_connection(*link.address)
        writer.write(BEAT)
        await until(lambda: received)
        for count in (1, 2):
            stranger, knocking = await asyncio.open_connection(*link.address)
            host, port, *_ = knocking.get_extra_info("sockname")
            with suppress(ConnectionError):
                knocking.write(BEAT)
                assert await asyncio.wait_for(stranger.read(), SHORT_S) == b""  # closed
            health = link.health()
            assert (health.refused, health.refused_from) == (count, f"{host}:{port}")
            knocking.close()
        link.send(b"for the owner")
        assert await reader.read(100) == b"for the owner"
        assert len(received) == 1
        writer.close()

    with_link("tcpin:127.0.0.1:0", check)


def test_tcpin_is_free_again_once_its_peer_has_left_or_is_silent(monkeypatch: pytest.MonkeyPatch) -> None:
    async def check(link: Any, received: list[Datagram]) -> None:
        monkeypatch.setattr(tcp, "OWNER_TIMEOUT_NS", 10**18)  # however long ago its last message was
        _, first = await asyncio.open_connection(*link.address)
        first.write(BEAT)
        await until(lambda: len(received) == 1)
        first.close()
        async with asyncio.timeout(SHORT_S):
            await until(lambda: not link._stream.sends())  # it has left
        reader, second = await asyncio.open_connection(*link.address)
        second.write(BEAT)
        await until(lambda: len(received) == 2)
        monkeypatch.setattr(tcp, "OWNER_TIMEOUT_NS", 0)  # that long ago: its connection broke unnoticed
        _, third = await asyncio.open_connection(*link.address)
        third.write(BEAT)
        with suppress(ConnectionError):
            assert await asyncio.wait_for(reader.read(), SHORT_S) == b""
        await until(lambda: len(received) == 3)
        assert link.health().refused == 0
        second.close()
        third.close()

    with_link("tcpin:127.0.0.1:0", check)


def test_who_knocks_is_reported_seldom() -> None:
    lines: list[str] = []
    console, pipeline = ConsoleLines(lines.append, pilot=lambda _: None), Pipeline(Config())
    for k in range(100):
        links = {"autopilot": LinkHealth(refused=k, refused_from=f"192.0.2.{k}:1000")}
        console.show_health(pipeline.health(k * 10**9, Rim(links=links)))
    lines = [line for line in lines if "refused a connection" in line]
    assert lines[0].startswith(
        "link autopilot: refused a connection from 192.0.2.1:1000: another peer still sends"
    )
    assert len(lines) <= 5


def test_serial_reads_writes_and_drops_when_full() -> None:
    master, slave = os.openpty()

    async def check(link: Any, received: list[Datagram]) -> None:
        os.write(master, b"\xfd\x00\x0a\x11\x13\x03\x7f")  # a raw port: no line discipline may eat these
        await until(lambda: sum(len(d.data) for d in received) == 7)
        assert b"".join(d.data for d in received) == b"\xfd\x00\x0a\x11\x13\x03\x7f"
        assert received[0].encoding == Encoding.MAVLINK_STREAM
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
        with_link(f"serial:{os.ttyname(slave)}:115200", check)
    finally:
        os.close(master)
        os.close(slave)


def test_a_serial_port_in_use_is_a_link_error() -> None:
    master, slave = os.openpty()
    spec = f"serial:{os.ttyname(slave)}:57600"

    async def check(_: Any, __: list[Datagram]) -> None:
        with pytest.raises(LinkError, match="free"):
            await parse_link(spec, "other").open()

    try:
        with_link(spec, check)
    finally:
        os.close(master)
        os.close(slave)


def test_a_serial_port_unplugged_and_plugged_in_again_goes_on(tmp_path: Any) -> None:
    device = tmp_path / "ttyUSB0"
    first = os.openpty()
    device.symlink_to(os.ttyname(first[1]))

    async def check(link: Any, received: list[Datagram]) -> None:
        os.write(first[0], b"one")
        await until(lambda: received)
        for fd in first:
            os.close(fd)
        device.unlink()
        await until(lambda: link.errors > 0)
        second = os.openpty()
        try:
            device.symlink_to(os.ttyname(second[1]))
            os.write(second[0], b"two")
            await until(lambda: b"two" in received[-1].data or os.write(second[0], b"two") == 0)
        finally:
            for fd in second:
                os.close(fd)

    with_link(f"serial:{device}:57600", check)


def test_a_tcp_client_says_why_it_is_not_connected_and_stops_saying_so_once_it_is() -> None:
    """The port is bound, so that nobody else takes it, but does not listen at first."""
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listener.bind(("127.0.0.1", 0))
    port = listener.getsockname()[1]

    async def check(link: Any, _: list[Datagram]) -> None:
        assert link.health().error == ""
        await until(lambda: link.trouble.words)
        assert link.health().error == f"tcp:127.0.0.1:{port}: cannot connect (Connection refused)"
        writers: list[asyncio.StreamWriter] = []  # a connection that is kept: "no trouble" stays, too
        server = await asyncio.start_server(lambda _, writer: writers.append(writer), sock=listener)
        async with server:
            await until(lambda: not link.trouble.words)
            assert link.health().error == ""
            for writer in writers:
                writer.close()
                await writer.wait_closed()

    with listener:
        with_link(f"tcp:127.0.0.1:{port}", check)
