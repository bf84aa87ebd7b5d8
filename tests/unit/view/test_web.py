"""The view in a browser: served to this computer alone, and drawn there."""

from pathlib import Path

import pytest

from tests.support.view_flight import CAMERA, NEEDS_RERUN, flight


def test_a_file_can_be_served_too(tmp_path: Path) -> None:
    viewer = pytest.importorskip("onboard.view.viewer", reason=NEEDS_RERUN, exc_type=ImportError)
    recording = tmp_path / "none.rrd"
    view_module = pytest.importorskip("onboard.view.view", reason=NEEDS_RERUN, exc_type=ImportError)
    with view_module.View(camera=CAMERA, rrd=recording) as view:
        for record in flight(2.0):
            view.show(record)
    process, address = viewer.start_web_viewer(str(recording))
    try:
        assert "theme=dark" in address
        assert listening(process.pid) <= {"127.0.0.1"}
    finally:
        process.kill()
        process.wait()


def listening(pid: int) -> set[str]:
    """The addresses (IPv4) on which a process of Linux listens for TCP."""
    opened = {str(f.readlink()) for f in Path(f"/proc/{pid}/fd").iterdir() if f.is_symlink()}
    found = set()
    for words in map(str.split, Path("/proc/net/tcp").read_text(encoding="ascii").splitlines()[1:]):
        if words[3] == "0A" and f"socket:[{words[9]}]" in opened:
            number = bytes.fromhex(words[1].partition(":")[0])[::-1]
            found.add(".".join(map(str, number)))
    return found
