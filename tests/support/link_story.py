"""A link that runs while a story is told, and peers for it."""

import asyncio
import socket
import time
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import Any

from onboard.links import parse_link
from onboard.messages import Datagram

TIMEOUT_S = 10.0


async def until(condition: Callable[[], Any]) -> None:
    async with asyncio.timeout(TIMEOUT_S):
        while not condition():  # noqa: ASYNC110 - what is awaited is a counter
            await asyncio.sleep(0.005)


def with_link(spec: str, story: Callable[[Any, list[Datagram]], Awaitable[None]], **options: Any) -> None:
    """Open and run a link while `story` happens to it, then cancel it."""

    async def main() -> None:
        link = parse_link(spec, "autopilot", **options)
        await link.open()
        heard: list[Datagram] = []
        task = asyncio.create_task(link.run(heard.append, time.time_ns))
        await asyncio.sleep(0)
        try:
            await story(link, heard)
        finally:
            task.cancel()
            with suppress(asyncio.CancelledError):
                await task

    asyncio.run(main())


def free_port(kind: socket.SocketKind = socket.SOCK_STREAM) -> int:
    with socket.socket(socket.AF_INET, kind) as s:
        s.bind(("127.0.0.1", 0))
        return int(s.getsockname()[1])
