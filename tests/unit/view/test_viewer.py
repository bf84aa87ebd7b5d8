"""A viewer that is too slow, or ends, is one line and no traceback."""

from pathlib import Path
from typing import Any

import pytest

from onboard.view import viewer
from onboard.view.viewer import ViewerError


@pytest.fixture
def recording(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A recording, and a program in the viewer's place that only waits."""
    waiting = tmp_path / "viewer"
    waiting.write_text("#!/bin/sh\nexec sleep 60\n")
    waiting.chmod(0o755)
    monkeypatch.setattr(viewer, "viewer_path", lambda: waiting)
    path = tmp_path / "flight.rrd"
    path.write_bytes(b"RRF2")
    return path


@pytest.mark.parametrize(
    "error", [TimeoutError("took 60 s"), ConnectionResetError("gone"), OSError("broken"), RuntimeError("x")]
)
def test_whatever_fails_in_a_picture_is_a_viewer_s_error(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    def fail(*_: Any) -> None:
        raise error

    monkeypatch.setattr(viewer, "_take_screenshot", fail)
    with pytest.raises(ViewerError, match=str(error)):
        viewer.screenshot(recording, tmp_path / "view.png")
