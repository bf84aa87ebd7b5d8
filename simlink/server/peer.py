"""The link to a vehicle simulated by another program, over UDP or TCP with reconnection."""

import asyncio
from collections.abc import Callable
from typing import Any, Final

from simlink.server.links import LinkError, UdpLink, parse_udp, reason
from simlink.server.observed import LocalFrame, ObservedVehicle

RETRY_PERIOD_S: Final = 0.5
POLL_PERIOD_S: Final = 0.1


class PeerLink:
    """The link of a URL: tcp:HOST:PORT, udpin:HOST:PORT or udpout:HOST:PORT.

    `name` is the vehicle's in the lines passed to `report`. Raises LinkError for any other URL.
    """

    def __init__(
        self, name: str, url: str, frame: LocalFrame, now_ns: Callable[[], int], report: Callable[[str], None]
    ) -> None:
        self.name, self.url = name, url
        kind, _, rest = url.partition(":")
        host, _, port = rest.rpartition(":")
        self._tcp = (host, int(port)) if kind == "tcp" and host and port.isdecimal() else None
        self.vehicle = ObservedVehicle(frame, stream=self._tcp is not None)
        self._now_ns, self._report = now_ns, report
        self._udp = UdpLink(_spec(url), self._received) if self._tcp is None else None

    def _received(self, data: bytes) -> tuple[bytes, ...]:
        self.vehicle.receive(data, self._now_ns())
        return ()

    async def run(self) -> None:
        """Receive and request until cancelled. Raises LinkError if a UDP port cannot be opened."""
        if self._udp is not None:
            await self._over_udp(self._udp)
        elif self._tcp is not None:
            await self._over_tcp(*self._tcp)

    async def _over_udp(self, link: UdpLink) -> None:
        await link.open()
        try:
            while True:
                for frame in self.vehicle.requests(self._now_ns()):
                    link.send(frame)
                await asyncio.sleep(POLL_PERIOD_S)
        finally:
            link.close()

    async def _over_tcp(self, host: str, port: int) -> None:
        loop = asyncio.get_running_loop()
        reported = ""
        while True:
            try:
                transport, stream = await loop.create_connection(lambda: _Stream(self._received), host, port)
            except OSError as error:
                why = reason(error)
                if why != reported:
                    self._report(f"{self.name} {self.url}: {why}; retrying")
                reported = why
                await asyncio.sleep(RETRY_PERIOD_S)
                continue
            reported = ""
            try:
                while not stream.is_lost:
                    transport.write(b"".join(self.vehicle.requests(self._now_ns())))
                    await asyncio.sleep(POLL_PERIOD_S)
            finally:
                transport.abort()


class _Stream(asyncio.Protocol):
    """The bytes of one TCP connection."""

    def __init__(self, received: Callable[[bytes], Any]) -> None:
        self.is_lost = False
        self._received = received

    def data_received(self, data: bytes) -> None:
        """Called by asyncio."""
        self._received(data)

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002  # asyncio's signature
        """Called by asyncio."""
        self.is_lost = True


def _spec(url: str) -> Any:
    try:
        return parse_udp(url)
    except LinkError as error:
        expected = "tcp:HOST:PORT, udpin:HOST:PORT or udpout:HOST:PORT"
        raise LinkError(f"bad link {url!r}: expected {expected}") from error
