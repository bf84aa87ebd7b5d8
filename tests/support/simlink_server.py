"""The simulator's server for tests: short, fast, without links."""

import asyncio
import time
from collections.abc import Callable
from typing import Any

from simlink.scenarios.scenario import load_scenario
from simlink.server.server import Options, Server

UNIX_TIME_NS = 1_700_000_000 * 10**9


def options(**changed: Any) -> Options:
    base = {"camera": "none", "zenoh": None, "mavlink": None, "tcp_port": None, "speed": 10.0, "duration": 2.0}
    return Options(scenario=load_scenario("formation"), **(base | changed))


def make(lines: list[str] | None = None, **changed: Any) -> Server:
    report = (lambda _: None) if lines is None else lines.append
    return Server(options(**changed), time.monotonic, UNIX_TIME_NS, report)


def run(main: Callable[[], Any]) -> Any:
    return asyncio.run(asyncio.wait_for(main(), 300))


async def until(condition: Callable[[], bool], turns: int = 1000) -> None:
    """Run the event loop until `condition` holds, for at most `turns` times 10 ms.

    An assertion must follow.
    """
    for _ in range(turns):
        if condition():
            return
        await asyncio.sleep(0.01)
