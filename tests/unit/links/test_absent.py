"""What is absent at the start, or goes away: names, devices, addresses. One line each, and tried again."""

import asyncio
import errno
import os
import pty
import socket
from pathlib import Path
from typing import Any

import pytest

from onboard.links import AbsentError, LinkError, parse_link
from onboard.messages import NO_REASON, Datagram
from tests.support.programs import free_ports
from tests.support.running_link import until, with_link

FRAME = bytes.fromhex("fe0009010100000000000000")
REAL = socket.getaddrinfo


def names(monkeypatch: pytest.MonkeyPatch, known: list[str]) -> None:
    """The name `sitl` has these addresses."""

    def getaddrinfo(host: Any, port: Any, family: int = 0, type: int = 0, proto: int = 0, flags: int = 0) -> Any:  # noqa: A002 - as the real one
        if host != "sitl":
            return REAL(host, port, family, type, proto, flags)
        if not known:
            raise socket.gaierror(socket.EAI_NONAME, "Name or service not known")
        return [x for a in known for x in REAL(a, port, family, type, proto, flags)]

    monkeypatch.setattr(socket, "getaddrinfo", getaddrinfo)


@pytest.mark.parametrize("kind", ["udpin", "udpout", "tcp", "tcpin"])
@pytest.mark.parametrize("host", ["192.168..5", "x" * 70 + ".local", "a\udc80b"], ids=["typo", "long", "bytes"])
def test_what_can_be_no_name_is_one_line(kind: str, host: str) -> None:
    with pytest.raises(LinkError, match="is not a host name") as caught:
        asyncio.run(parse_link(f"{kind}:{host}:5760", "x").open())
    assert not isinstance(caught.value, AbsentError)
    assert "\n" not in str(caught.value)


def test_each_address_of_a_name_is_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    names(monkeypatch, ["127.0.0.2", "127.0.0.1"])
    with socket.create_server(("127.0.0.1", 0)) as server:

        async def check(_: Any, received: list[Datagram]) -> None:
            peer = (await asyncio.to_thread(server.accept))[0]
            peer.sendall(FRAME)
            await until(lambda: received)
            peer.close()

        with_link(f"tcp:sitl:{server.getsockname()[1]}", check)


@pytest.mark.parametrize("host", ["127.0.0.1", "127.0.0.2"])
def test_udpin_listens_on_each_address_of_a_name(monkeypatch: pytest.MonkeyPatch, host: str) -> None:
    names(monkeypatch, ["127.0.0.2", "127.0.0.1"])
    (port,) = free_ports(1)

    async def check(link: Any, received: list[Datagram]) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer:
            peer.sendto(FRAME, (host, port))
            await until(lambda: received)
            link.send(b"back")
            peer.settimeout(5.0)
            assert peer.recvfrom(10) == (b"back", (host, port))

    with_link(f"udpin:sitl:{port}", check, passes=lambda _: True)


def test_udpout_sends_to_each_address_of_a_name_until_one_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    names(monkeypatch, ["127.0.0.2", "127.0.0.1"])
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer:
        peer.bind(("127.0.0.1", 0))
        peer.settimeout(5.0)

        async def check(link: Any, received: list[Datagram]) -> None:
            link.send(b"hello")
            data, sender = peer.recvfrom(10)
            assert data == b"hello"
            peer.sendto(FRAME, sender)
            await until(lambda: received)
            sent = link.sent
            link.send(b"again")
            assert peer.recv(10) == b"again"
            assert link.sent == sent + 1

        with_link(f"udpout:sitl:{peer.getsockname()[1]}", check, passes=lambda _: True)


@pytest.mark.parametrize("host", ["127.0.0.1", "127.0.0.2"])
def test_tcpin_listens_on_each_address_of_a_name(monkeypatch: pytest.MonkeyPatch, host: str) -> None:
    names(monkeypatch, ["127.0.0.2", "127.0.0.1"])
    (port,) = free_ports(1)

    async def check(_: Any, received: list[Datagram]) -> None:
        _, writer = await asyncio.open_connection(host, port)
        writer.write(FRAME)
        await until(lambda: received)
        writer.close()

    with_link(f"tcpin:sitl:{port}", check)


@pytest.mark.parametrize("kind", ["udpin", "tcpin"])
def test_a_port_that_is_in_use_on_one_address_is_named(monkeypatch: pytest.MonkeyPatch, kind: str) -> None:
    names(monkeypatch, ["127.0.0.2", "127.0.0.1"])
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM if kind == "udpin" else socket.SOCK_STREAM) as other:
        other.bind(("127.0.0.1", 0))
        if kind == "tcpin":
            other.listen(1)
        with pytest.raises(LinkError, match="Address already in use"):
            asyncio.run(parse_link(f"{kind}:sitl:{other.getsockname()[1]}", "x").open())


@pytest.mark.parametrize("kind", ["udpin", "udpout"])
def test_a_udp_link_waits_for_its_name(monkeypatch: pytest.MonkeyPatch, kind: str) -> None:
    known: list[str] = []
    names(monkeypatch, known)
    (port,) = free_ports(1)

    async def main() -> None:
        link: Any = parse_link(f"{kind}:sitl:{port}", "x")
        task = asyncio.create_task(link.run(lambda _: None, lambda: 0))
        await until(lambda: "no such host" in link.health().error)
        known.append("127.0.0.1")
        await until(lambda: link.address is not None and not link.health().error)
        task.cancel()
        await asyncio.wait({task})

    asyncio.run(main())


def test_udpout_opens_its_socket_anew_when_its_address_is_gone() -> None:
    (port,) = free_ports(1)

    async def check(link: Any, _: list[Datagram]) -> None:
        real, address = link._sockets[:], link.address
        link._sockets[:] = [Gone()]
        link.send(FRAME)
        link._sockets[:] = real
        await until(lambda: "cannot send to it (Invalid argument)" in link.health().error)
        await until(lambda: link.health().error == "" and link._sockets[:1] not in ([], real))
        assert link.address == address, "an autopilot answers the port that it has heard first"
        link.send(FRAME)
        assert link.sent == 1

    class Gone:
        """As Linux answers when the address that a socket sends from has been taken away."""

        def send(self, _: bytes) -> None:
            raise OSError(errno.EINVAL, "Invalid argument")

    with_link(f"udpout:127.0.0.1:{port}", check)


def test_a_serial_device_that_comes_later_is_opened(tmp_path: Path) -> None:
    device = tmp_path / "ttyACM0"

    async def main() -> None:
        link: Any = parse_link(f"serial:{device}:57600", "x")
        received: list[Datagram] = []
        task = asyncio.create_task(link.run(received.append, lambda: 0))
        await until(lambda: "No such file" in link.trouble.words)
        master, slave = pty.openpty()
        device.symlink_to(os.ttyname(slave))
        await until(lambda: link.trouble == NO_REASON)
        os.write(master, FRAME)
        await until(lambda: received)
        task.cancel()
        await asyncio.wait({task})
        os.close(master)
        os.close(slave)

    asyncio.run(main())
