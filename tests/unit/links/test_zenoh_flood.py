"""Floods over Zenoh: each kind of sensor has room of its own in front of the event loop, our camera the first."""

import asyncio
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from types import SimpleNamespace
from typing import Any

from onboard.links.zenoh import ZenohLink
from onboard.messages import NO_REASON, Datagram, Reason

PREFIX = "onboard/1"
CAMERA, RADAR, GNSS = (
    f"{PREFIX}/{key}" for key in ("camera/{}/points", "radar/{}/detections", "gnss/{}/pseudoranges")
)


class Session:
    """A session whose samples a test sends itself."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self.callbacks: dict[str, Callable[[Any], None]] = {}
        self.subscribed = asyncio.Event()
        self._loop = loop

    def is_closed(self) -> bool:
        return False

    def declare_subscriber(self, key: str, callback: Callable[[Any], None]) -> Any:
        self.callbacks[key] = callback
        if len(self.callbacks) == 5:
            self._loop.call_soon_threadsafe(self.subscribed.set)
        return SimpleNamespace(undeclare=lambda: None)

    def declare_standing(self, *_: Any) -> Any:
        return SimpleNamespace(undeclare=lambda: None)

    def find_rivals(self, _: str) -> dict[str, Any]:
        return {}

    def age_s(self) -> float:
        return 0.0

    def trouble(self) -> Reason:
        return NO_REASON

    def send(self, key: str, data: bytes) -> None:
        kind = key.split("/")[2::2]
        (callback,) = [c for pattern, c in self.callbacks.items() if pattern.split("/")[2::2] == kind]
        callback(SimpleNamespace(payload=SimpleNamespace(to_bytes=lambda: data), key_expr=key))


def delivered(flood: Callable[[int], str]) -> tuple[Counter[str], int]:
    """What arrives of one sample of each sensor, sent in the midst of a flood that finds the event loop busy; and
    how many were dropped."""
    found: list[Datagram] = []

    async def main() -> int:
        session = Session(asyncio.get_running_loop())
        link = ZenohLink(session, PREFIX, camera="front")
        task = asyncio.create_task(link.run(found.append, lambda: 1))
        await session.subscribed.wait()
        for n in range(5_000):
            session.send(flood(n), b"flood")
        for key in (CAMERA.format("front"), RADAR.format("nose"), GNSS.format("2")):
            session.send(key, b"wanted")
        await asyncio.sleep(0.01)
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task
        return link.errors

    errors = asyncio.run(main())
    return Counter(d.channel for d in found if d.data == b"wanted"), errors


def test_other_cameras_never_take_our_camera_s_room() -> None:
    found, errors = delivered(lambda n: CAMERA.format(f"x{n}"))
    assert set(found) == {CAMERA.format("front"), RADAR.format("nose"), GNSS.format("2")}
    assert 4_000 < errors < 5_000


def test_a_radar_never_takes_a_camera_s_room() -> None:
    found, errors = delivered(lambda _: RADAR.format("nose"))
    assert set(found) == {CAMERA.format("front"), GNSS.format("2")}
    assert 4_000 < errors <= 5_001
