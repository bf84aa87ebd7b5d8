"""MAVLink over TCP: a stream of bytes, cut anywhere. `tcp` connects (ArduPilot SITL listens on 5760), `tcpin`
waits to be connected to."""

import asyncio
import socket
from typing import Any, Final, cast

from onboard.links.link import (
    FIRST_RETRY_S,
    LONGEST_RETRY_S,
    Deliver,
    LinkError,
    NowNs,
    bind,
    guarded,
    resolve,
    until_lost,
)
from onboard.messages import Datagram, Encoding

CONNECT_TIMEOUT_S: Final = 3.0
SEND_LIMIT: Final = 65_536  # bytes waiting to be sent beyond which we drop: seconds of what we ever say
KEEPALIVE: Final = {"TCP_KEEPIDLE": 5, "TCP_KEEPINTVL": 2, "TCP_KEEPCNT": 3, "TCP_USER_TIMEOUT": 10_000}


class Stream(asyncio.Protocol):
    """One TCP connection. `lost` is done when it is over."""

    def __init__(self, link: "TcpClientLink | TcpServerLink", deliver: Deliver, now_ns: NowNs) -> None:
        self.lost: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._link, self._deliver, self._now_ns = link, deliver, now_ns
        self._transport: asyncio.Transport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Notice within 15 s that the other end lost power: it closes nothing when it does."""
        self._transport = cast(asyncio.Transport, transport)
        sock = transport.get_extra_info("socket")
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        for name, value in KEEPALIVE.items():
            if hasattr(socket, name):
                sock.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)

    def data_received(self, data: bytes) -> None:
        """Hand it on."""
        t_recv_ns = self._now_ns()
        link = self._link
        link.received += 1
        self._deliver(
            Datagram(channel=link.channel, encoding=Encoding.MAVLINK_STREAM, t_recv_ns=t_recv_ns, data=data)
        )

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002 - asyncio's signature
        """Over, whatever the reason."""
        if not self.lost.done():
            self.lost.set_result(None)

    def write(self, data: bytes) -> bool:
        """Whether there was a connection with room for it."""
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


class TcpClientLink:
    """Connects, and connects again. With `retry` a peer that is not there yet is no error."""

    def __init__(self, spec: str, channel: str, host: str, port: int, *, retry: bool = True) -> None:
        self.channel = channel
        self.received = 0
        self.sent = 0
        self.errors = 0
        self._spec, self._host, self._port, self._retry = spec, host, port, retry
        self._socket: socket.socket | None = None
        self._stream: Stream | None = None

    async def open(self) -> None:
        """Look the host up and, without `retry`, connect. Raises LinkError."""
        if self._retry:
            await resolve(self._spec, self._host, self._port, socket.SOCK_STREAM)
        else:
            self._socket = await self._connect()

    async def run(self, deliver: Deliver, now_ns: NowNs) -> None:
        """Hand on what arrives until cancelled. Without `retry`: LinkError when the connection ends."""
        failed: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        delay_s = FIRST_RETRY_S
        while True:
            received = self.received
            try:
                await self._converse(guarded(deliver, failed), now_ns, failed)
            except LinkError:
                if not self._retry:
                    raise
                self.errors += 1
            if self.received > received:  # a server that accepts and hangs up does not count as there
                delay_s = FIRST_RETRY_S
            await asyncio.sleep(delay_s)
            delay_s = min(2 * delay_s, LONGEST_RETRY_S)

    def send(self, data: bytes) -> None:
        """Queue for sending if connected and not congested."""
        if self._stream is not None and self._stream.write(data):
            self.sent += 1
        else:
            self.errors += 1

    async def _converse(self, deliver: Deliver, now_ns: NowNs, failed: "asyncio.Future[None]") -> None:
        """One connection from beginning to end, which is a LinkError."""
        sock, self._socket = self._socket or await self._connect(), None
        loop = asyncio.get_running_loop()
        _, stream = await loop.create_connection(lambda: Stream(self, deliver, now_ns), sock=sock)
        self._stream = stream
        try:
            await until_lost(stream.lost, failed)
        finally:
            self._stream = None
            stream.abort()
        raise LinkError(f"{self._spec}: the other end closed the connection")

    async def _connect(self) -> socket.socket:
        family, address = await resolve(self._spec, self._host, self._port, socket.SOCK_STREAM)
        sock = socket.socket(family, socket.SOCK_STREAM)
        sock.setblocking(False)
        try:
            async with asyncio.timeout(CONNECT_TIMEOUT_S):
                await asyncio.get_running_loop().sock_connect(sock, address)
        except OSError as error:  # TimeoutError is one
            sock.close()
            raise LinkError(f"{self._spec}: cannot connect ({error.strerror or 'no answer'})") from error
        except BaseException:
            sock.close()
            raise
        return sock


class TcpServerLink:
    """Waits to be connected to, by one peer at a time: the newest, so that one whose old connection died
    unnoticed is not locked out. `address` is what it listens on, once open."""

    def __init__(self, spec: str, channel: str, host: str, port: int) -> None:
        self.channel = channel
        self.received = 0
        self.sent = 0
        self.errors = 0
        self.address: Any = None
        self._spec, self._host, self._port = spec, host, port
        self._socket: socket.socket | None = None
        self._stream: Stream | None = None

    async def open(self) -> None:
        """Bind and listen. Raises LinkError."""
        family, address = await resolve(self._spec, self._host, self._port, socket.SOCK_STREAM)
        sock = socket.socket(family, socket.SOCK_STREAM)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # a restart need not wait for TIME_WAIT
        bind(self._spec, sock, address)
        try:
            sock.listen(4)
        except OSError as error:  # with SO_REUSEADDR a taken port can show only here
            sock.close()
            raise LinkError(f"{self._spec}: cannot listen ({error.strerror})") from error
        sock.setblocking(False)
        self._socket = sock
        self.address = sock.getsockname()

    async def run(self, deliver: Deliver, now_ns: NowNs) -> None:
        """Hand on what arrives until cancelled."""
        if self._socket is None:
            await self.open()
        sock = self._socket
        assert sock is not None  # noqa: S101 - open() raises otherwise
        loop = asyncio.get_running_loop()
        failed: asyncio.Future[None] = loop.create_future()
        safe = guarded(deliver, failed)

        def accept() -> Stream:
            if self._stream is not None:
                self._stream.abort()
            self._stream = Stream(self, safe, now_ns)
            return self._stream

        server = await loop.create_server(accept, sock=sock)
        try:
            await failed
        finally:
            server.close()
            self._socket = None
            if self._stream is not None:
                self._stream.abort()
                self._stream = None

    def send(self, data: bytes) -> None:
        """Queue for sending if someone is connected and not congested."""
        if self._stream is not None and self._stream.write(data):
            self.sent += 1
        else:
            self.errors += 1
