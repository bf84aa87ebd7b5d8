"""`onboard view`: the live view as a client of a running daemon, or a recorded view opened again."""

import argparse
import subprocess
import sys
from pathlib import Path
from typing import Final

from onboard.config import load_config
from onboard.errors import UserError
from onboard.view.client import Client
from onboard.view.view import View
from onboard.view.viewer import has_display, screenshot, viewer_path

MAGIC: Final = b"RRF"


def main(arguments: argparse.Namespace) -> int:
    """Watch a daemon, or open a recording. Raises UserError."""
    a = arguments
    if a.recording is not None:
        return open_recording(a.recording, png=a.png, at=a.at)
    return watch(a.connect, a.vehicle, rrd=a.rrd, overrides=tuple(a.set))


def watch(endpoint: str, vehicle: str, *, rrd: Path | None, overrides: tuple[str, ...]) -> int:
    """Show what a daemon publishes, until interrupted. `overrides` give the camera as the daemon has it."""
    if rrd is None and not has_display():
        raise UserError("no display here: record the view with --rrd FILE.rrd")
    config = load_config(None, overrides)
    client = Client(endpoint, vehicle)
    try:
        with View(camera=config.camera_model(), rrd=rrd, spawn=has_display()) as view:
            print(f"watching {endpoint}, vehicle {vehicle}; Ctrl-C ends", file=sys.stderr, flush=True)
            while view.viewer is None or view.viewer.poll() is None:
                received = client.take(0.5)
                if received is not None:
                    view.show(received.record)
    finally:
        client.close()
    return 0


def open_recording(recording: Path, *, png: Path | None, at: float | None) -> int:
    """Open an .rrd in the packaged viewer, or draw it to a picture."""
    if not recording.is_file():
        raise UserError(f"no such recording: {recording}")
    with recording.open("rb") as file:
        if not file.read(3).startswith(MAGIC):
            raise UserError(f"{recording} is no recording of the view (.rrd)")
    if png is not None:
        screenshot(recording, png, at=at)
        return 0
    if not has_display():
        raise UserError("no display here: draw a picture with --png FILE.png")
    return subprocess.call([str(viewer_path()), str(recording)])  # noqa: S603 - our own viewer and the user's file
