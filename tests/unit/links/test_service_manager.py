"""What systemd is told: that we run, and that the pipeline makes progress."""

import asyncio
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from onboard.daemon import Daemon
from onboard.links.service_manager import ServiceManager
from onboard.messages import Datagram, Encoding
from onboard.pipeline import Pipeline
from tests.support.streams import make_config

S = 1_000_000_000


@contextmanager
def manager(path: Path) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as receiver:
        receiver.bind(str(path))
        receiver.setblocking(False)
        yield receiver


def heard(receiver: socket.socket) -> list[str]:
    found = []
    while True:
        try:
            found.append(receiver.recv(100).decode())
        except BlockingIOError:
            return found


def test_without_a_manager_nothing_is_sent(tmp_path: Path) -> None:
    for environ in ({}, {"NOTIFY_SOCKET": ""}, {"NOTIFY_SOCKET": str(tmp_path / "nobody")}):
        ServiceManager(environ).notify("READY=1")


def test_an_abstract_address_begins_with_an_at() -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as receiver:
        receiver.bind("\0onboard-test")
        ServiceManager({"NOTIFY_SOCKET": "@onboard-test"}).notify("READY=1")
        assert receiver.recv(100) == b"READY=1"


def test_the_daemon_is_ready_and_ends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
    with manager(tmp_path / "notify") as receiver:
        daemon = Daemon(make_config("zenoh.enabled=false", "link=[]"), report=lambda _: None)

        async def run() -> None:
            task = asyncio.create_task(daemon.run(()))
            assert await asyncio.get_running_loop().sock_recv(receiver, 100) == b"READY=1"
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)

        asyncio.run(run())
        assert heard(receiver)[-1] == "STOPPING=1"


@pytest.mark.parametrize("fails", ["", "decode", "advance", "tick"])
def test_the_watchdog_is_fed_by_the_pipelines_progress(
    fails: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A program whose loop turns while its pipeline fails was alive for ever."""
    monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))

    def fail(*_: object) -> None:
        raise RuntimeError("stuck")

    with manager(tmp_path / "notify") as receiver:
        daemon = Daemon(make_config("zenoh.enabled=false", "link=[]"), report=lambda _: None)
        daemon._tick(0)
        assert heard(receiver) == ["WATCHDOG=1"]
        if fails:
            monkeypatch.setattr(Pipeline, fails, fail)
        for k in range(1, 4):
            daemon._deliver(Datagram(channel="a", encoding=Encoding.MAVLINK, t_recv_ns=k * S, data=b"x"))
            if fails == "tick":
                with pytest.raises(RuntimeError, match="stuck"):
                    daemon._tick(k * S)
            else:
                daemon._tick(k * S)
        assert heard(receiver) == [] if fails else ["WATCHDOG=1"] * 3
