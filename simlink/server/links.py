"""The simulator's sockets: UDP to a companion computer, TCP for ground stations.

Neither waits for a peer.
"""

import asyncio
import os
from collections.abc import Callable, Iterable
from typing import Any, Final, cast

from onboard.messages import Record
from simlink.autopilot import AutopilotLink
from simlink.sensors.navigation import Reading

MAX_UNSENT_BYTES: Final = 1 << 20  # of one TCP client, which misses frames beyond

MakeSession = Callable[[], AutopilotLink]
Now = Callable[[], int]  # boot clock, ns


class LinkError(Exception):
    """A link cannot be opened; the message is one line with the link and the reason."""


class UdpSpec(Record, frozen=True, kw_only=True):
    """A parsed UDP link.

    `udpout:host:port` sends there and receives on the same socket; `udpin:host:port` listens there and sends to
    the sender of the last datagram.
    """

    out: bool
    host: str
    port: int


def parse_udp(spec: str) -> UdpSpec:
    """Parse a UDP link. Raises LinkError."""
    kind, _, rest = spec.partition(":")
    host, _, port = rest.rpartition(":")
    if kind not in ("udpout", "udpin") or not host or not port.isdecimal() or not int(port) < 65536:
        raise LinkError(f"bad link {spec!r}: expected udpout:HOST:PORT or udpin:HOST:PORT")
    return UdpSpec(out=kind == "udpout", host=host, port=int(port))


class UdpLink(asyncio.DatagramProtocol):
    """One UDP socket; `received` returns the replies to each datagram."""

    def __init__(self, spec: UdpSpec, received: Callable[[bytes], Iterable[bytes]]) -> None:
        self.has_peer = False  # whether a peer has ever sent anything
        self.refused = 0  # datagrams that the peer's host refused
        self._spec = spec
        self._received = received
        self._peer: Any = None
        self._transport: asyncio.DatagramTransport | None = None

    async def open(self) -> None:
        """Bind or connect. Raises LinkError."""
        loop = asyncio.get_running_loop()
        address = (self._spec.host, self._spec.port)
        where = {"remote_addr": address} if self._spec.out else {"local_addr": address}
        try:
            await loop.create_datagram_endpoint(lambda: self, **where)  # type: ignore[arg-type]  # typeshed wants them spelled out
        except OSError as error:
            raise LinkError(f"cannot open UDP {address[0]}:{address[1]}: {reason(error)}") from error

    @property
    def is_open(self) -> bool:
        """Whether `open` is done."""
        return self._transport is not None

    @property
    def address(self) -> tuple[str, int]:
        """The local address, once open."""
        host, port = self._get().get_extra_info("sockname")[:2]
        return str(host), int(port)

    def send(self, data: bytes) -> bool:
        """Send one datagram, without blocking; return False if there is no peer yet."""
        if not self._spec.out and self._peer is None:
            return False
        self._get().sendto(data, self._peer if not self._spec.out else None)
        return True

    def close(self) -> None:
        """Close the socket, if it was opened."""
        if self._transport is not None:
            self._transport.close()

    def _get(self) -> asyncio.DatagramTransport:
        if self._transport is None:
            raise RuntimeError("the link is not open")
        return self._transport

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Called by asyncio."""
        self._transport = cast(asyncio.DatagramTransport, transport)

    def datagram_received(self, data: bytes, addr: Any) -> None:
        """Called by asyncio."""
        self.has_peer, self._peer = True, addr
        for frame in self._received(data):
            self.send(frame)

    def error_received(self, exc: Exception) -> None:  # noqa: ARG002  # asyncio's signature
        """Called by asyncio, on loopback with ECONNREFUSED while the daemon is not running."""
        self.refused += 1


class TcpServer:
    """MAVLink for any number of TCP clients, each with its own session and message intervals."""

    def __init__(self, host: str, port: int, make_session: MakeSession, now: Now) -> None:
        self.has_peer = False
        self.clients: set[TcpClient] = set()
        self.make_session = make_session
        self.now = now
        self._where = (host, port)
        self._server: asyncio.Server | None = None

    async def open(self) -> None:
        """Listen. Raises LinkError."""
        loop = asyncio.get_running_loop()
        try:
            self._server = await loop.create_server(lambda: TcpClient(self), *self._where)
        except OSError as error:
            host, port = self._where
            hint = "; choose another with --tcp PORT, or --tcp none"
            raise LinkError(f"cannot listen on TCP {host}:{port}: {reason(error)}{hint}") from error

    @property
    def is_open(self) -> bool:
        """Whether `open` is done."""
        return self._server is not None

    @property
    def port(self) -> int:
        """The listening port, once open."""
        if self._server is None:
            raise RuntimeError("the server is not open")
        return int(self._server.sockets[0].getsockname()[1])

    def send(self, t_ns: int, reading: Reading | None) -> int:
        """Send each client the frames due at `t_ns`; return the number of frames sent."""
        return sum(client.send(client.session.send(t_ns, reading)) for client in tuple(self.clients))

    async def close(self) -> None:
        """Stop listening and hang up."""
        if self._server is not None:
            self._server.close()
            for client in tuple(self.clients):
                client.hang_up()
            await self._server.wait_closed()


class TcpClient(asyncio.Protocol):
    """One TCP client."""

    def __init__(self, server: TcpServer) -> None:
        self.session = server.make_session()
        self._server = server
        self._transport: asyncio.Transport | None = None

    def send(self, frames: list[bytes]) -> int:
        """Send frames unless the client reads too slowly; return the number sent."""
        transport = self._transport
        if not frames or transport is None or transport.get_write_buffer_size() > MAX_UNSENT_BYTES:
            return 0
        transport.write(b"".join(frames))
        return len(frames)

    def hang_up(self) -> None:
        """Close without waiting for unsent bytes."""
        if self._transport is not None:
            self._transport.abort()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Called by asyncio."""
        self._transport = cast(asyncio.Transport, transport)
        self._server.clients.add(self)

    def data_received(self, data: bytes) -> None:
        """Called by asyncio."""
        self._server.has_peer = True
        self.send(self.session.receive(data, self._server.now()))

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002  # asyncio's signature
        """Called by asyncio."""
        self._server.clients.discard(self)


def reason(error: OSError) -> str:
    """Return the reason of an OSError in a few words, without the known address."""
    number = error.errno or 0
    return (os.strerror(number) if number > 0 else error.strerror or str(error)).lower()
