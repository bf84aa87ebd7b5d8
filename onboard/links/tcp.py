"""MAVLink over TCP, a stream of bytes in arbitrary pieces.

`tcp` connects (ArduPilot SITL listens on 5760), `tcpin` listens. A peer of `tcpin` whose bytes contain messages
keeps its connection: others are refused, and named.
"""

import asyncio
import socket
from collections.abc import Callable
from functools import partial
from typing import Any, Final, cast

from onboard.links.link import (
    OPENING,
    Deliver,
    Link,
    LinkError,
    NowNs,
    bind,
    guarded,
    keep_connected,
    opened,
    reason_of,
    resolve,
    until_lost,
)
from onboard.messages import Datagram, Encoding, LinkHealth
from onboard.messages.causes import NO_REASON
from onboard.units import NS_PER_S

CONNECT_TIMEOUT_S: Final = 3.0
SEND_LIMIT: Final = 65_536  # bytes in the send buffer, beyond which data are dropped: seconds of our traffic
READ_BYTES: Final = 8192  # a flood takes a few milliseconds before other links have their turn
OWNER_TIMEOUT_NS: Final = 3 * NS_PER_S  # after a peer's last message: three heartbeats
KEEPALIVE: Final = {"TCP_KEEPIDLE": 5, "TCP_KEEPINTVL": 2, "TCP_KEEPCNT": 3, "TCP_USER_TIMEOUT": 10_000}


class TcpConnection(asyncio.Protocol):
    """One TCP connection to `peer`; `on_made` is called at its start, `lost` done at its end."""

    def __init__(
        self,
        link: Link,
        deliver: Deliver,
        now_ns: NowNs,
        on_made: "Callable[[TcpConnection], None]" = lambda _: None,
    ) -> None:
        self.lost: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self.peer = ""
        self._message_ns: int | None = None  # when bytes gave a message for the last time
        self._link, self._deliver, self._now_ns, self._on_made = link, deliver, now_ns, on_made
        self._transport: asyncio.Transport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Enable keep-alive, which detects within 15 s that a peer has lost power."""
        self._transport = cast(asyncio.Transport, transport)
        self._transport.max_size = READ_BYTES  # type: ignore[attr-defined]  # of asyncio's socket transports
        sock = transport.get_extra_info("socket")
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        for name, value in KEEPALIVE.items():
            if hasattr(socket, name):
                sock.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)
        host, port, *_ = transport.get_extra_info("peername") or ("nobody", 0)  # who has left already
        self.peer = f"{host}:{port}"
        self._on_made(self)

    def data_received(self, data: bytes) -> None:
        """Deliver one piece of the stream."""
        t_recv_ns = self._now_ns()
        link = self._link
        link.received += 1
        encoding = Encoding.MAVLINK_STREAM
        if self._deliver(Datagram(channel=link.channel, encoding=encoding, t_recv_ns=t_recv_ns, data=data)):
            self._message_ns = t_recv_ns

    def sends(self) -> bool:
        """Whether it stands, and gave a message lately."""
        lately = self._message_ns is not None and 0 <= self._now_ns() - self._message_ns < OWNER_TIMEOUT_NS
        return lately and not self.lost.done()

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002 - asyncio's signature
        """The connection has ended, for any reason."""
        if not self.lost.done():
            self.lost.set_result(None)

    def write(self, data: bytes) -> bool:
        """Send data; False without a connection or without room in its buffer."""
        transport = self._transport
        if transport is None or transport.is_closing():
            return False
        if transport.get_write_buffer_size() + len(data) > SEND_LIMIT:
            return False
        transport.write(data)
        return True

    def abort(self) -> None:
        """Close at once."""
        if self._transport is not None:
            self._transport.abort()


class _StreamLink(Link):
    """A link with one TCP stream at a time."""

    _stream: TcpConnection | None = None

    def send(self, data: bytes) -> None:
        """Put data into the send buffer, if connected and the buffer has room; else drop it."""
        if self._stream is not None and self._stream.write(data):
            self.sent += 1
        else:
            self.errors += 1


class TcpClientLink(_StreamLink):
    """A TCP client. With `retry` it reconnects, and an absent peer is no error."""

    def __init__(self, spec: str, channel: str, host: str, port: int, *, retry: bool = True) -> None:
        self.channel = channel
        self._spec, self._host, self._port, self._retry = spec, host, port, retry
        self._socket: socket.socket | None = None

    async def open(self) -> None:
        """Resolve the host and, without `retry`, connect. Raises LinkError."""
        if self._retry:
            await resolve(self._spec, self._host, self._port, socket.SOCK_STREAM)
        else:
            self._socket = await self._connect()

    async def run(self, deliver: Deliver, now_ns: NowNs) -> None:
        """Call `deliver` with each piece until cancelled.

        Without `retry`, raises LinkError when the connection ends.
        """
        await keep_connected(self, partial(self._converse, now_ns), deliver, retry=self._retry)

    async def _converse(self, now_ns: NowNs, deliver: Deliver, failed: "asyncio.Future[None]") -> None:
        """One connection until it ends, which raises LinkError."""
        sock, self._socket = self._socket or await self._connect(), None
        loop = asyncio.get_running_loop()
        _, stream = await loop.create_connection(lambda: TcpConnection(self, deliver, now_ns), sock=sock)
        self._stream = stream
        self.trouble = NO_REASON
        try:
            await until_lost(stream.lost, failed)
        finally:
            self._stream = None
            stream.abort()
        raise LinkError(f"{self._spec}: the other end closed the connection")

    async def _connect(self) -> socket.socket:
        """A connection to the first address of the host that answers. Raises LinkError."""
        reasons: dict[str, None] = {}
        for family, address in await resolve(self._spec, self._host, self._port, socket.SOCK_STREAM):
            sock = socket.socket(family, socket.SOCK_STREAM)
            sock.setblocking(False)
            try:
                async with asyncio.timeout(CONNECT_TIMEOUT_S):
                    await asyncio.get_running_loop().sock_connect(sock, address)
            except OPENING as error:  # TimeoutError is an OSError, and asyncio's own names no reason
                sock.close()
                reasons[reason_of(error) or "no answer"] = None
            except BaseException:
                sock.close()
                raise
            else:
                return sock
        raise LinkError(f"{self._spec}: cannot connect ({', '.join(reasons)})")


class TcpServerLink(_StreamLink):
    """A TCP server for one peer at a time; `address` is the listening address once open.

    A new connection replaces one without recent messages, so that a peer whose connection broke unnoticed can
    return; otherwise it is refused.
    """

    def __init__(self, spec: str, channel: str, host: str, port: int) -> None:
        self.channel = channel
        self.refused = 0
        self.refused_from = ""
        self.address: Any = None
        self._spec, self._host, self._port = spec, host, port
        self._sockets: list[socket.socket] = []

    def health(self) -> LinkHealth:
        """The link's counts, and the last refused peer."""
        return LinkHealth(
            received=self.received,
            sent=self.sent,
            errors=self.errors,
            refused=self.refused,
            refused_from=self.refused_from,
        )

    async def open(self) -> None:
        """Bind and listen, on each address of the host. Raises LinkError."""
        self._sockets = await opened(self._spec, self._host, self._port, socket.SOCK_STREAM, self._listen)
        self.address = self._sockets[0].getsockname()

    def _listen(self, sock: socket.socket, address: Any) -> None:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # else a restart would wait for TIME_WAIT
        bind(self._spec, sock, address)
        try:
            sock.listen(4)
        except OSError as error:  # with SO_REUSEADDR a port in use may be noticed only here
            raise LinkError(f"{self._spec}: cannot listen ({error.strerror})") from error
        sock.setblocking(False)

    async def run(self, deliver: Deliver, now_ns: NowNs) -> None:
        """Call `deliver` with each piece until cancelled."""
        if not self._sockets:
            await self.open()
        loop = asyncio.get_running_loop()
        failed: asyncio.Future[None] = loop.create_future()
        safe = guarded(deliver, failed)

        def accept() -> TcpConnection:
            return TcpConnection(self, safe, now_ns, self._accept)

        servers = [await loop.create_server(accept, sock=sock) for sock in self._sockets]
        try:
            await failed
        finally:
            for server in servers:
                server.close()
            self._sockets = []
            if self._stream is not None:
                self._stream.abort()
                self._stream = None

    def _accept(self, stream: TcpConnection) -> None:
        """Take a new connection, or refuse it."""
        if self._stream is not None and self._stream.sends():
            self.refused += 1
            self.refused_from = stream.peer
            stream.abort()
            return
        if self._stream is not None:
            self._stream.abort()
        self._stream = stream
