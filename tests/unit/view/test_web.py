"""The view in a browser: served to this computer alone, and drawn there."""

import time
from pathlib import Path

import numpy as np
import pytest

from tests.support.browser import CHROMIUM, NO_CHROMIUM, page
from tests.support.view_flight import CAMERA, NEEDS_RERUN, flight

BANNER = (slice(4, 34), slice(20, 820))  # px: the headline, in the colour of the leader's state
DRAWN_S = 240.0  # without a graphics card, on a busy computer


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason=NO_CHROMIUM)
def test_a_browser_draws_the_view_and_nobody_else_can(tmp_path: Path) -> None:
    view_module = pytest.importorskip("onboard.view.view", reason=NEEDS_RERUN, exc_type=ImportError)
    image = pytest.importorskip("PIL.Image", reason="Pillow reads the picture")
    with view_module.View(camera=CAMERA, web=True) as view:
        assert view.page.startswith("http://127.0.0.1:")
        for record in flight(6.0):
            view.show(record)
        with page(view.page) as shown:
            end, green = time.monotonic() + DRAWN_S, 0.0
            while time.monotonic() < end and green < 0.5:
                shown.wait(3.0)
                (tmp_path / "web.png").write_bytes(shown.picture())
                pixels = np.asarray(image.open(tmp_path / "web.png").convert("RGB"), dtype=float)[BANNER]
                green = float((pixels[..., 1] > 1.3 * pixels[..., 0] + 10.0).mean())
            assert green >= 0.5
        process = view.viewer
    assert process.poll() is not None


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
