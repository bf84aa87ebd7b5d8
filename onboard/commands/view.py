"""`onboard view`: the live view as a client of a running daemon, or a recorded view opened again."""

import argparse
import subprocess
import sys
from pathlib import Path
from typing import Final

from onboard import UserError
from onboard.config import Config, load_config
from onboard.view.client import Client
from onboard.view.fleet import Views
from onboard.view.viewer import has_display, screenshot, start_web_viewer, viewer_path

MAGIC: Final = b"RRF"
DEFAULT_ENDPOINT: Final = "tcp/127.0.0.1:7447"
ALL: Final = "all"


def main(arguments: argparse.Namespace) -> int:
    """Watch a daemon, or open a recording. Raises UserError."""
    a = arguments
    if a.recording is not None:
        return open_recording(a.recording, png=a.png, at=a.at, web=a.web)
    config = load_config(a.config, tuple(a.set))
    endpoint = a.connect or next(iter(config.zenoh.connect), DEFAULT_ENDPOINT)
    vehicle = a.vehicle or (ALL if a.config is not None else "1")
    of = None if vehicle == ALL else vehicle
    return watch(config, endpoint, of, rrd=a.rrd, web=a.web, wait_s=a.wait)


def watch(
    config: Config, endpoint: str, vehicle: str | None, *, rrd: Path | None, web: bool = False, wait_s: float = 0.0
) -> int:
    """Show what a daemon publishes (None: all vehicles' daemons), until interrupted. `config` has the camera as
    the daemon has it, and what a router asks for. Waits up to `wait_s` for somebody to answer."""
    if rrd is None and not (web or has_display()):
        raise UserError(
            "no display here: record the view with --rrd FILE.rrd, or serve it to a browser with --web"
        )
    client = Client(endpoint, vehicle, config.zenoh, wait_s)
    try:
        camera, rotors = config.camera_model(), config.rotors()
        shown = {"spawn": has_display() and not web, "web": web, "apart": vehicle is None}
        with Views(camera=camera, rotors=rotors, rrd=rrd, **shown) as views:
            page = ""
            whose = "all vehicles" if vehicle is None else f"vehicle {vehicle}"
            print(f"watching {endpoint}, {whose}; Ctrl-C ends", file=sys.stderr, flush=True)
            while not views.is_closed_by_user():
                received = client.take(0.5)
                if views.page != page:
                    page = views.page
                    print(f"open {page}", file=sys.stderr, flush=True)
                if received is not None:
                    views.show(received.vehicle, received.record)
    finally:
        client.close()
    return 0


def open_recording(recording: Path, *, png: Path | None, at: float | None, web: bool = False) -> int:
    """Open an .rrd in the packaged viewer or a browser, or draw it to a picture."""
    if not recording.is_file():
        raise UserError(f"no such recording: {recording}")
    with recording.open("rb") as file:
        if not file.read(3).startswith(MAGIC):
            raise UserError(f"{recording} is no recording of the view (.rrd)")
    if png is not None:
        screenshot(recording, png, at=at)
        return 0
    if web:
        process, page = start_web_viewer(str(recording.resolve()))
        print(f"open {page}; Ctrl-C ends", file=sys.stderr, flush=True)
        try:
            return process.wait()
        finally:
            process.terminate()
    if not has_display():
        raise UserError("no display here: serve it to a browser with --web, or draw a picture with --png FILE.png")
    return subprocess.call([str(viewer_path()), str(recording)])  # noqa: S603 - our own viewer and the user's file
