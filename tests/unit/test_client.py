"""`onboard.client`: a detector that starts before the daemon."""

from typing import Any

import msgspec
import numpy as np
import pytest

from onboard.client import Camera
from onboard.messages import Box, CameraDetections, Detection
from onboard.sinks import SinkError, zenoh_session
from onboard.sinks.zenoh_session import RouterAbsentError


class Session:
    """What is open once the daemon runs."""

    def __init__(self) -> None:
        self.sent: list[bytes] = []

    def put(self, _key: str, data: bytes) -> None:
        """Take a document."""
        self.sent.append(data)

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

    monkeypatch.setattr(zenoh_session, "open_session", open_session)
    monkeypatch.setattr(zenoh_session, "ROUTER_RETRY_PERIOD_S", 0.0)
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


def test_detections_may_be_made_of_numpys_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    """As a detector's boxes are, in single precision: only `send` took them."""
    session = Session()
    monkeypatch.setattr(zenoh_session, "open_session", lambda _: session)
    u, v, width, height = np.array([320.0, 240.0, 40.0, 20.0], dtype=np.float32)
    box: Any = {"u_px": u, "v_px": v, "width_px": width, "height_px": height}
    found: Any = Detection(box=Box(**box), confidence=np.float32(0.5))
    with Camera() as camera:
        camera.send_all([found], t_ns=np.int64(7))
    document = msgspec.json.decode(session.sent[0], type=CameraDetections)
    assert (document.t_ns, document.detections[0].confidence) == (7, 0.5)
    assert document.detections[0].box == Box(u_px=320.0, v_px=240.0, width_px=40.0, height_px=20.0)
