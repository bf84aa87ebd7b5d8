"""`onboard.client`: a detector that starts before the daemon."""

from typing import Any

import pytest

from onboard import client
from onboard.client import Camera
from onboard.sinks import SinkError
from onboard.sinks.zenoh_session import RouterAbsentError


class Session:
    """What is open once the daemon runs."""

    def close(self) -> None:
        """End it."""


@pytest.fixture
def tries(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """A daemon that answers the third time, at a clock of half a second a look."""
    tries: list[int] = []

    def open_session(_: Any) -> Session:
        tries.append(1)
        if len(tries) < 3:
            raise RouterAbsentError("zenoh: no router answers at tcp/127.0.0.1:7447 (Connection refused)")
        return Session()

    monkeypatch.setattr(client, "open_session", open_session)
    monkeypatch.setattr(client, "RETRY_S", 0.0)
    return tries


def test_a_camera_waits_for_the_daemon_and_says_so_once(
    tries: list[int], capsys: pytest.CaptureFixture[str]
) -> None:
    """A detector that started first ended."""
    with Camera():
        assert len(tries) == 3
    (line,) = capsys.readouterr().err.splitlines()
    assert "no router answers at tcp/127.0.0.1:7447" in line
    assert line.endswith("waiting for it")


def test_it_waits_no_longer_than_it_may(tries: list[int], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SinkError, match="no router answers"):
        Camera(wait_s=0.0)
    assert (len(tries), capsys.readouterr().err) == (1, "")
