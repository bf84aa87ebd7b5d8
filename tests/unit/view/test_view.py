"""The live view: its targets, its server, its dependency and its end."""

import socket
import subprocess
import sys
import time
from datetime import timedelta
from pathlib import Path

import pytest
from msgspec.structs import replace

from onboard.messages import Estimate, Verdict
from tests.support.view_flight import CAMERA, NEEDS_RERUN, flight, record_flight, rows_of


@pytest.mark.parametrize("name", [None, "flight of today"])
def test_a_recording_has_the_name_that_it_was_given(tmp_path: Path, name: str | None) -> None:
    view_module = pytest.importorskip("onboard.view.view", reason=NEEDS_RERUN, exc_type=ImportError)
    chunk = pytest.importorskip("rerun.chunk", reason=NEEDS_RERUN)
    with view_module.View(camera=CAMERA, rrd=tmp_path / "named.rrd", name=name):
        pass
    chunks = chunk.RrdReader(tmp_path / "named.rrd").stream().to_chunks()
    batches = [one.to_record_batch().to_pydict() for one in chunks if one.entity_path == "/__properties"]
    names = [value for batch in batches for (value,) in batch.get("RecordingInfo:name", [])]
    assert names == ([] if name is None else [name])


def test_the_server_listens_on_loopback_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    psutil = pytest.importorskip("psutil")
    view_module = pytest.importorskip("onboard.view.view", reason=NEEDS_RERUN, exc_type=ImportError)
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with view_module.View(camera=CAMERA, rrd=tmp_path / "both.rrd", grpc_port=0, spawn=True) as view:
        assert view.viewer is None  # no display, no window
        port = int(view.url.split(":")[-1].split("/")[0])
        deadline = time.monotonic() + 300
        addresses: set[str] = set()
        while not addresses and time.monotonic() < deadline:
            listening = [c for c in psutil.Process().net_connections("tcp") if c.status == psutil.CONN_LISTEN]
            addresses = {c.laddr.ip for c in listening if c.laddr.port == port}
            time.sleep(0.05)
        for record in flight(0.5):
            view.show(record)
    assert addresses == {"127.0.0.1"}
    assert rows_of(tmp_path / "both.rrd")["/scene/leader_truth"] >= 12


def test_a_port_that_is_taken_is_an_error() -> None:
    view_module = pytest.importorskip("onboard.view.view", reason=NEEDS_RERUN, exc_type=ImportError)
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        with pytest.raises(OSError, match="cannot serve the view"):
            view_module.View(camera=CAMERA, grpc_port=other.getsockname()[1])


def test_without_rerun_the_package_imports_and_the_view_says_what_to_install() -> None:
    code = (
        "import sys; sys.modules['rerun'] = None\n"
        "import onboard.view\n"
        "try:\n    import onboard.view.view\n"
        "except ImportError as error:\n    print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300, check=False)
    assert "pip install '.[view]'" in done.stdout, done.stderr


def test_an_image_that_is_stamped_ahead_does_not_stay_on_the_strip(tmp_path: Path) -> None:
    """The strip says what the last image was, whatever time it claims."""
    records = list(flight(3.0))
    images = [k for k, r in enumerate(records) if isinstance(r, Estimate) and r.measurement is not None]
    ahead = records[images[20]]
    assert isinstance(ahead, Estimate)
    assert ahead.measurement is not None
    wrong = replace(ahead.measurement, verdict=Verdict.TOO_NEW, t_ns=ahead.t_ns + 60 * 10**9)
    records[images[20]] = replace(ahead, measurement=wrong)
    record_flight(tmp_path / "ahead.rrd", records)
    chunk = pytest.importorskip("rerun.chunk", reason=NEEDS_RERUN)
    chunks = chunk.RrdReader(tmp_path / "ahead.rrd").stream().to_chunks()
    strips = [one.to_record_batch().to_pydict() for one in chunks if one.entity_path == "/images"]
    times = [time for strip in strips for time in strip.get("boot_time", [])]
    assert len(times) >= 3
    assert max(time / timedelta(seconds=1) for time in times) <= max(r.t_ns for r in records) * 1e-9
