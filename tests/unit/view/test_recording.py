"""The recording that the live view writes, and pictures made of one."""

import math
import re
import subprocess
from pathlib import Path

import pytest

from onboard import UserError
from tests.support.view_flight import (
    NEEDS_RERUN,
    START_TIME_S,
    flight,
    health_of,
    record_flight,
)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record_flight(tmp_path_factory.mktemp("view") / "flight.rrd", list(flight(8.0)))


def test_a_closed_recording_is_whole(recording: Path) -> None:
    viewer = pytest.importorskip("onboard.view.viewer", reason=NEEDS_RERUN, exc_type=ImportError)
    command = [str(viewer.viewer_path()), "rrd", "verify", str(recording)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr


def test_a_picture_of_a_missing_recording(tmp_path: Path) -> None:
    viewer = pytest.importorskip("onboard.view.viewer", reason=NEEDS_RERUN, exc_type=ImportError)
    with pytest.raises(FileNotFoundError, match="no such recording"):
        viewer.screenshot(tmp_path / "none.rrd", tmp_path / "none.png")


def has_vulkan() -> bool:
    """Whether a driver is installed: with OpenGL alone the viewer finds an adapter, and then cannot draw."""
    return any(any(Path(folder).glob("*.json")) for folder in ("/usr/share/vulkan/icd.d", "/etc/vulkan/icd.d"))


@pytest.mark.parametrize("at", [0.0, 6.0, 8.0])
def test_a_time_in_the_recording_counts_from_its_start(at: float) -> None:
    viewer = pytest.importorskip("onboard.view.viewer", reason=NEEDS_RERUN, exc_type=ImportError)
    assert viewer.time_shown(at, 12_000_000_000, 20_000_000_000) == 12.0 + at


@pytest.mark.parametrize("at", [-0.1, 8.2, START_TIME_S + 6.0, math.nan])
def test_no_picture_of_a_time_outside_the_recording(at: float) -> None:
    viewer = pytest.importorskip("onboard.view.viewer", reason=NEEDS_RERUN, exc_type=ImportError)
    with pytest.raises(UserError, match=r"no picture at .* s: the recording holds 0 to 8\.1 s"):
        viewer.time_shown(at, 12_000_000_000, 20_190_000_000)


def test_a_picture_of_a_time_outside_the_recording(recording: Path, tmp_path: Path) -> None:
    viewer = pytest.importorskip("onboard.view.viewer", reason=NEEDS_RERUN, exc_type=ImportError)
    png = tmp_path / "view.png"
    with pytest.raises(UserError) as raised:
        viewer.screenshot(recording, png, at=60.0, size=(400, 300), timeout=300)
    if "no Vulkan driver" in str(raised.value) or not has_vulkan():
        pytest.skip("no Vulkan driver here: Debian's mesa-vulkan-drivers has one in software")
    assert re.fullmatch(r"no picture at 60 s: the recording holds 0 to [78](\.\d)? s", str(raised.value))
    assert not png.exists()


def test_a_picture_without_a_screen(recording: Path, tmp_path: Path) -> None:
    viewer = pytest.importorskip("onboard.view.viewer", reason=NEEDS_RERUN, exc_type=ImportError)
    psutil = pytest.importorskip("psutil")
    png = tmp_path / "view.png"
    try:
        viewer.screenshot(recording, png, at=6.0, size=(1000, 700), timeout=300)
    except viewer.ViewerError as error:
        if "no Vulkan driver" in str(error) or not has_vulkan():
            pytest.skip("no Vulkan driver here: Debian's mesa-vulkan-drivers has one in software")
        raise
    assert png.read_bytes().startswith(b"\x89PNG")
    assert png.stat().st_size > 30_000  # an empty window has a tenth of it
    # other tests' worker pools may have left Python's own helper process to this one
    assert not [c for c in psutil.Process().children(recursive=True) if "rerun" in c.name()]


def test_a_recording_begins_with_the_first_boot_time(tmp_path: Path) -> None:
    """Before the autopilot is heard, health has none: the recording does not begin at 0."""
    chunk = pytest.importorskip("rerun.chunk", reason=NEEDS_RERUN)
    path = record_flight(tmp_path / "early.rrd", [health_of(0), *flight(2.0)])
    times = [
        int(t)
        for one in chunk.RrdReader(path).stream().to_chunks()
        if not one.is_static
        for t in one.to_record_batch().column("boot_time").to_numpy(zero_copy_only=False).astype("int64")
    ]
    assert min(times) == round(START_TIME_S * 1e9)
