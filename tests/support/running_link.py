"""A link that runs during a test."""

import asyncio
import time
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import Any

from onboard.links import parse_link
from onboard.messages import Datagram
from onboard.wire.datagrams import DatagramDecoder

TIMEOUT_S = 300.0  # what takes longer hangs


async def until(condition: Callable[[], Any]) -> None:
    """Wait until `condition` holds; TimeoutError after TIMEOUT_S."""
    async with asyncio.timeout(TIMEOUT_S):
        while not condition():  # noqa: ASYNC110 - the condition is no event
            await asyncio.sleep(0.005)


def with_link(
    spec: str,
    test: Callable[[Any, list[Datagram]], Awaitable[None]],
    *,
    passes: Callable[[Datagram], bool] | None = None,
    **options: Any,
) -> None:
    """Open and run a link during `test(link, received)`, then cancel it.

    `passes`: whether a datagram's sender may be answered; by default, if it gives a message.
    """
    decoder = DatagramDecoder()
    passes = passes or (lambda datagram: bool(decoder.decode(datagram)))

    async def main() -> None:
        link = parse_link(spec, "autopilot", **options)
        await link.open()
        received: list[Datagram] = []

        def deliver(datagram: Datagram) -> bool:
            received.append(datagram)
            return passes(datagram)

        task = asyncio.create_task(link.run(deliver, time.time_ns))
        await asyncio.sleep(0)
        try:
            await test(link, received)
        finally:
            task.cancel()
            with suppress(asyncio.CancelledError):
                await task

    asyncio.run(main())
