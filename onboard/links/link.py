"""The interface of all links, their error, and functions that several of them use."""

import asyncio
import errno
import os
import socket
import termios
from collections.abc import Awaitable, Callable
from typing import Any, Final, Protocol

from onboard import UserError
from onboard.messages import Datagram, LinkHealth
from onboard.messages.causes import NO_REASON, Cause, Reason
from onboard.units import NS_PER_S

Deliver = Callable[[Datagram], bool | None]  # whether its sender may be answered
NowNs = Callable[[], int]

# What opening a port, a device or a name may raise: UnicodeError, of a name, is a ValueError, and termios has an
# error of its own.
OPENING: Final = (OSError, ValueError, OverflowError, termios.error)
DEVICE_ABSENT: Final = (errno.ENOENT, errno.ENODEV, errno.ENXIO)  # of a device
UNKNOWN_NAME: Final = (socket.EAI_NONAME, socket.EAI_AGAIN, socket.EAI_NODATA)
MIN_RECONNECT_DELAY_S: Final = 0.1
MAX_RECONNECT_DELAY_S: Final = 1.0  # a peer that returns must not wait


class LinkError(UserError):
    """A link cannot be opened or has ended; the message names the link, cause and remedy."""


class AbsentError(LinkError):
    """A device or a host name is not there yet and may appear later."""


class Backlog:
    """Rejection of datagrams that have waited in this program for too long.

    Once one has waited longer than `longest_s`, all are skipped until one has waited less than half of that, so
    that those that follow are new. `skipped` counts them.
    """

    def __init__(self, longest_s: float) -> None:
        self.skipped = 0
        self._longest_ns = longest_s * NS_PER_S
        self._is_skipping = False

    def skips(self, waited_ns: int) -> bool:
        """Whether to skip the next datagram, which has waited this long."""
        self._is_skipping = waited_ns > self._longest_ns / (2 if self._is_skipping else 1)
        self.skipped += self._is_skipping
        return self._is_skipping


class Link(Protocol):
    """One connection to the outside, for receiving and mostly for sending.

    `channel` is its name in recordings; a link with several named sources (Zenoh keys) uses one channel per
    source. `received` and `sent` count datagrams (or pieces of a stream), `errors` failed sends and reads.
    `trouble`: why a link that connects by itself is not connected; NO_REASON while it is, or has not tried.
    """

    channel: str
    received: int = 0
    sent: int = 0
    errors: int = 0
    trouble: Reason = NO_REASON

    async def open(self) -> None:
        """Claim the port or device. Raises LinkError with one line that names a remedy."""

    async def run(self, deliver: Deliver, now_ns: NowNs) -> None:
        """Call `deliver` with each datagram until cancelled; its exception ends the link."""

    def send(self, data: bytes) -> None:
        """Send; without a peer or room in the buffer, drop and count in `errors`. Never blocks."""

    def health(self) -> LinkHealth:
        """The link's counts, with the kernel's drops for a datagram socket."""
        cause, error = self.trouble
        return LinkHealth(received=self.received, sent=self.sent, errors=self.errors, cause=cause, error=error)


def guarded(deliver: Deliver, failed: "asyncio.Future[None]") -> Deliver:
    """Wrap a callback of the event loop so that its exception is set in `failed`."""

    def safe(datagram: Datagram) -> bool | None:
        if failed.done():
            return False
        try:
            return deliver(datagram)
        except Exception as error:  # of any kind: it must reach run()
            failed.set_exception(error)
            return False

    return safe


async def keep_connected(
    link: Link,
    converse: Callable[[Deliver, "asyncio.Future[None]"], Awaitable[None]],
    deliver: Deliver,
    *,
    retry: bool,
) -> None:
    """Call `converse` (one connection) repeatedly, with growing delays without received data.

    Without `retry`, raises its first LinkError; an exception of `deliver` is always raised.
    """
    failed: asyncio.Future[None] = asyncio.get_running_loop().create_future()
    delay_s = MIN_RECONNECT_DELAY_S
    while True:
        received = link.received
        try:
            await converse(guarded(deliver, failed), failed)
        except LinkError as error:
            if not retry:
                raise
            link.errors += 1
            link.trouble = Reason(Cause.UNREACHABLE, str(error))
        if link.received > received:  # a server that accepts and closes at once does not reset the delay
            delay_s = MIN_RECONNECT_DELAY_S
        await asyncio.sleep(delay_s)
        delay_s = min(2 * delay_s, MAX_RECONNECT_DELAY_S)


async def until_lost(lost: "asyncio.Future[Any]", failed: "asyncio.Future[None]") -> None:
    """Wait for either future; raise the exception of `failed`."""
    await asyncio.wait({lost, failed}, return_when=asyncio.FIRST_COMPLETED)
    if failed.done():
        failed.result()


def reason_of(error: BaseException) -> str:
    """The reason of an error of `OPENING`, in words."""
    number = error.args[0] if isinstance(error, termios.error) and error.args else getattr(error, "errno", None)
    return os.strerror(number) if isinstance(number, int) and number > 0 else str(error)


async def resolve(spec: str, host: str, port: int, kind: socket.SocketKind) -> list[tuple[int, Any]]:
    """Return (address family, socket address) of each address of a host.

    Raises AbsentError if the name is unknown, LinkError if it is invalid.
    """
    loop = asyncio.get_running_loop()
    try:
        found = await loop.getaddrinfo(host, port, type=kind)
    except socket.gaierror as error:
        kind_of = AbsentError if error.errno in UNKNOWN_NAME else LinkError
        raise kind_of(f"{spec}: no such host {host!r} ({error.strerror})") from error
    except OPENING as error:
        raise LinkError(f"{spec}: {host!r} is not a host name ({error})") from error
    return [(family, address) for family, _, _, _, address in found]


async def opened(
    spec: str, host: str, port: int, kind: socket.SocketKind, use: Callable[[socket.socket, Any], None]
) -> list[socket.socket]:
    """Open sockets of all addresses that `use(socket, address)` accepts; of port 0, the first.

    Raises LinkError if it refuses all of them, or one because its port is in use.
    """
    sockets: list[socket.socket] = []
    refusal: LinkError | None = None
    for family, address in await resolve(spec, host, port, kind):
        try:
            sock = socket.socket(family, kind)
        except OSError as error:  # this machine has no such family
            refusal = refusal or LinkError(f"{spec}: {address[0]}: {error.strerror}")
            continue
        try:
            use(sock, address)
        except LinkError as error:
            sock.close()
            refusal = refusal or error
            if getattr(error.__cause__, "errno", None) == errno.EADDRINUSE:
                refusal = error
                close_all(sockets)
                break
        else:
            sockets.append(sock)
            if port == 0:
                break
    if not sockets:
        raise refusal or LinkError(f"{spec}: {host!r} has no address")
    return sockets


def close_all(sockets: list[socket.socket]) -> None:
    """Close sockets, and forget them."""
    for sock in sockets:
        sock.close()
    sockets.clear()


def bind(spec: str, sock: socket.socket, address: Any) -> None:
    """Bind the socket. If the port is in use or the address is not local: raises LinkError."""
    try:
        sock.bind(address)
    except OSError as error:
        hint = "is another program, or another onboard, listening there?"
        raise LinkError(f"{spec}: cannot listen ({error.strerror}); {hint}") from error
