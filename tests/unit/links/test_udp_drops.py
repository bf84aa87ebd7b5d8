"""Datagrams that the kernel drops are counted: what comes while nobody reads does not vanish silently."""

import asyncio
import socket
import struct
from contextlib import suppress

import pytest

from onboard.links import udp
from onboard.links.udp import UdpLink
from onboard.messages import Datagram
from tests.support.running_link import until

SENT = 20_000


def flooded() -> tuple[UdpLink, int]:
    """A link after a flood while the event loop was busy, and how many datagrams arrived."""
    found: list[Datagram] = []

    async def main() -> UdpLink:
        link = UdpLink("udpin:127.0.0.1:0", "a", "127.0.0.1", 0, listening=True)
        await link.open()
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            for _ in range(SENT):  # nobody reads meanwhile
                sender.sendto(bytes(200), link.address)
            task = asyncio.create_task(link.run(found.append, lambda: 1))
            await until(lambda: link.received > 0)
            await asyncio.sleep(0.1)
            sender.sendto(bytes(200), link.address)  # a count comes with the next datagram
            before = link.received
            await until(lambda: link.received > before)
            task.cancel()
            with suppress(asyncio.CancelledError):
                await task
        return link

    return asyncio.run(main()), len(found)


def test_what_the_kernel_drops_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(udp, "RECEIVE_BUFFER_BYTES", 200_000)
    link, arrived = flooded()
    assert arrived < SENT
    assert link.dropped == SENT + 1 - arrived
    assert link.health().dropped == link.dropped
    assert link.health().received == arrived


def test_the_buffer_that_the_kernel_grants_is_known() -> None:
    link, _ = flooded()
    assert link.health().buffer_bytes >= 200_000


def test_a_count_that_wraps_around_goes_on() -> None:
    def ancillary(count: int) -> list[tuple[int, int, bytes]]:
        return [(socket.SOL_SOCKET, udp.Option.SO_RXQ_OVFL, struct.pack("I", count))]

    before = 2**32 - 5
    assert udp._dropped_count(ancillary(3), before) == 2**32 + 3
    assert udp._dropped_count(ancillary(before), before) == before
    assert udp._dropped_count([], before) == before
