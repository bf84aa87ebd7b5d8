"""What every link has in common: its shape, its error, and how it looks up an address."""

import asyncio
import socket
from collections.abc import Callable
from typing import Any, Final, Protocol

from onboard.errors import UserError
from onboard.messages import Datagram

Deliver = Callable[[Datagram], None]
NowNs = Callable[[], int]

FIRST_RETRY_S: Final = 0.1
LONGEST_RETRY_S: Final = 5.0


class LinkError(UserError):
    """A link cannot be opened or has ended for good; the message says which one, why, and what to do."""


class Link(Protocol):
    """One place where bytes come in and, mostly, go out.

    `channel` names it in recordings; a link that hears several sources with names of their own (Zenoh keys)
    gives each its own channel. `received` and `sent` count datagrams (pieces of a stream), `errors` what
    could not be sent or read.
    """

    channel: str
    received: int
    sent: int
    errors: int

    async def open(self) -> None:
        """Claim the port or device. Raises LinkError with one line that says what to do."""

    async def run(self, deliver: Deliver, now_ns: NowNs) -> None:
        """Hand on what arrives until cancelled. What `deliver` raises ends the link and comes out of here."""

    def send(self, data: bytes) -> None:
        """Send, or drop and count in `errors` if there is nowhere to send to or no room. Never blocks."""


def guarded(deliver: Deliver, failed: "asyncio.Future[None]") -> Deliver:
    """`deliver` for use in event-loop callbacks, where an exception would otherwise be logged and forgotten:
    it ends up in `failed`, which `run` awaits."""

    def safe(datagram: Datagram) -> None:
        if failed.done():
            return
        try:
            deliver(datagram)
        except Exception as error:  # whatever it is, it must reach run()
            failed.set_exception(error)

    return safe


async def until_lost(lost: "asyncio.Future[None]", failed: "asyncio.Future[None]") -> None:
    """Wait for either; raise what `failed` holds."""
    await asyncio.wait({lost, failed}, return_when=asyncio.FIRST_COMPLETED)
    if failed.done():
        failed.result()


async def resolve(spec: str, host: str, port: int, kind: socket.SocketKind) -> tuple[int, Any]:
    """(address family, socket address) of a host. Raises LinkError when the name is not known."""
    loop = asyncio.get_running_loop()
    try:
        found = await loop.getaddrinfo(host, port, type=kind)
    except OSError as error:
        raise LinkError(f"{spec}: no such host {host!r} ({error.strerror})") from error
    family, _, _, _, address = found[0]
    return family, address


def bind(spec: str, sock: socket.socket, address: Any) -> None:
    """Bind, closing the socket and raising LinkError if the port is taken or the address is not ours."""
    try:
        sock.bind(address)
    except OSError as error:
        sock.close()
        hint = "is another program, or another onboard, listening there?"
        raise LinkError(f"{spec}: cannot listen ({error.strerror}); {hint}") from error
