"""The packaged desktop viewer: opened on a display, or headless to take a picture."""

import contextlib
import math
import os
import socket
import subprocess
import tempfile
import time
from importlib.util import find_spec
from pathlib import Path
from typing import Final
from urllib.parse import quote

from onboard import UserError
from onboard.units import S_PER_NS
from onboard.view.columns import TIMELINE

STABLE_IMAGES: Final = 5  # equal ones in a row, after which painting is complete
NO_ADAPTER: Final = "No graphics adapter was found"  # in the viewer's log
NO_DRIVER: Final = (
    "no Vulkan driver is installed; `apt install mesa-vulkan-drivers` draws in software, without a graphics card"
)
RETRY_PERIOD_S: Final = 0.2
SERVING_TIMEOUT_S: Final = 15.0  # until a page is served
PAINTING_TIMEOUT_S: Final = 15.0  # a live view never stops changing


class ViewerError(UserError, RuntimeError):
    """The viewer could not be started, or could not draw."""


def free_port(port: int = 0) -> int:
    """Return a free port of 127.0.0.1: `port`, or any for 0.

    Raises `OSError` if it is taken: Rerun itself would only log that and serve nobody.
    """
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", port))
        except OSError as error:
            raise OSError(error.errno, f"cannot serve the view on 127.0.0.1:{port}: {error.strerror}") from error
        return int(probe.getsockname()[1])


def viewer_path() -> Path:
    """Return the viewer in the wheel.

    The `rerun` command is a script: ending it would leave the viewer running.
    """
    spec = find_spec("rerun_cli")
    for folder in (spec.submodule_search_locations or []) if spec else []:
        for name in ("rerun", "rerun.exe"):
            if (path := Path(folder) / name).exists():
                return path
    raise ViewerError("this rerun-sdk comes without its viewer; install the wheel from PyPI")


def has_display() -> bool:
    """Whether a window could be opened here."""
    return os.name == "nt" or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def start_viewer(url: str) -> "subprocess.Popen[bytes] | None":
    """Open the viewer on a server; return None without a display."""
    if not has_display():
        return None
    # by itself the viewer would listen on every interface
    command = [str(viewer_path()), url, "--bind", "127.0.0.1", "--port", str(free_port()), "--hide-welcome-screen"]
    return subprocess.Popen(  # noqa: S603  (a program of our own environment, by its full path)
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True, env=_environment()
    )


def start_web_viewer(source: str) -> "tuple[subprocess.Popen[bytes], str]":
    """Serve the viewer of a recording to browsers of this computer.

    `source` is a file or the URL of a server. Returns the process and the address to open. Raises ViewerError.
    """
    page, port = free_port(), free_port()
    command = [
        *(str(viewer_path()), "--serve-web", "--bind", "127.0.0.1", "--web-viewer-port", str(page)),
        *("--port", str(port), source),
    ]
    process = subprocess.Popen(  # noqa: S603  (as above)
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True, env=_environment()
    )
    url = source if "://" in source else f"rerun+http://127.0.0.1:{port}/proxy"
    deadline = time.monotonic() + SERVING_TIMEOUT_S
    with contextlib.ExitStack() as failing:
        failing.callback(process.kill)
        while process.poll() is None and time.monotonic() < deadline:
            with socket.socket() as probe:
                if probe.connect_ex(("127.0.0.1", page)) == 0:
                    failing.pop_all()
                    look = "theme=dark&persist=0&hide_welcome_screen"  # the colours are made for a dark page
                    return process, f"http://127.0.0.1:{page}/?url={quote(url, safe='')}&{look}"
            time.sleep(RETRY_PERIOD_S)
    raise ViewerError(f"the viewer did not serve its page on 127.0.0.1:{page} within {SERVING_TIMEOUT_S:.0f} s")


def _environment() -> dict[str, str]:
    """Return our environment, with the viewer's question about analytics disabled."""
    return {**os.environ, "RERUN_APP_ONLY": "true"}


def screenshot(
    source: str | Path,
    png: Path,
    *,
    at: float | None = None,
    size: tuple[int, int] = (1400, 900),
    timeout: float = 90.0,
) -> None:
    """Take a picture of a recording (a file, or the URL of a server) without a screen.

    `at` is the time shown, s from the recording's start; None is the end. It needs Vulkan, which mesa's software
    driver provides. Raises `FileNotFoundError` if the file does not exist, `UserError` if `at` lies outside the
    recording, `ViewerError` with the end of the viewer's log if it cannot draw.
    """
    is_url = "://" in str(source)
    if not is_url and not Path(source).is_file():
        raise FileNotFoundError(f"no such recording: {source}")
    target = str(source) if is_url else str(Path(source).resolve())
    port = free_port()
    command = [
        str(viewer_path()), "--headless", "--bind", "127.0.0.1", "--port", str(port), "--hide-welcome-screen",
        "--window-size", f"{size[0]}x{size[1]}", target,
    ]  # fmt: skip
    deadline = time.monotonic() + timeout
    with tempfile.TemporaryFile() as log:
        process = subprocess.Popen(  # noqa: S603  (as above)
            command, stdout=log, stderr=log, env=_environment()
        )
        try:
            _take_screenshot(process, port, png.resolve(), at, deadline)
        except (RuntimeError, OSError) as error:  # a ViewerError too; a busy machine's is TimeoutError
            log.seek(0)
            text = log.read().decode(errors="replace")
            why = NO_DRIVER if NO_ADAPTER in text else f"{error}\n{_end_of_log(text)}"
            raise ViewerError(f"no picture of {source}: {why}") from error
        finally:
            process.terminate()
            try:
                process.wait(5)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait(5)


def time_shown(at: float, start_ns: int, end_ns: int) -> float:
    """Return the time since boot, s, that is `at` seconds after the start of a recording.

    Raises `UserError` if that is outside `start_ns` to `end_ns`: the viewer would show an empty picture.
    """
    length = (end_ns - start_ns) * S_PER_NS
    if not 0.0 <= at <= length:
        # rounded down, so that the time named is one that the recording holds
        raise UserError(f"no picture at {at:g} s: the recording holds 0 to {math.floor(10.0 * length) / 10.0:g} s")
    return start_ns * S_PER_NS + at


def _end_of_log(log: str) -> str:
    """Return a viewer's panic without its stack trace, else its last lines."""
    lines = [line for line in log.splitlines() if line.strip()]
    panics = [i for i, line in enumerate(lines) if "panicked at" in line]
    return "\n".join(lines[panics[0] : panics[0] + 2] if panics else lines[-5:])


def _take_screenshot(
    process: "subprocess.Popen[bytes]", port: int, png: Path, at: float | None, deadline: float
) -> None:
    """Wait until the viewer has loaded and painted the recording, then write its picture.

    It paints until the picture no longer changes: the first painting lays out, views appear in the second, plots
    come to rest.
    """
    from rerun.experimental import ViewerClient  # noqa: PLC0415  (drags in a query engine)

    def wait(what: str) -> None:
        try:
            code = process.wait(RETRY_PERIOD_S)
        except subprocess.TimeoutExpired:
            if time.monotonic() > deadline:
                raise ViewerError(f"gave up while {what}") from None
        else:
            raise ViewerError(f"the viewer ended with code {code} while {what}")

    while True:
        with socket.socket() as probe:
            if probe.connect_ex(("127.0.0.1", port)) == 0:
                break
        wait("waiting for the viewer to listen")
    client = ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy")
    while True:
        try:
            state = client.get_state()
            loaded = not state.loading and any(r.timelines for r in state.recordings)
        except RuntimeError:
            loaded = False
        if loaded:
            break
        wait("loading the recording")
    if at is not None:
        times = [t for r in state.recordings for t in r.timelines if t.name == TIMELINE]
        starts, ends = [t.start for t in times if t.start is not None], [t.end for t in times if t.end is not None]
        shown = time_shown(at, min(starts, default=0), max(ends, default=0))
        client.set_time(TIMELINE, duration=shown, play_state="paused")
    picture, equal, begun = b"", 0, time.monotonic()
    while equal < STABLE_IMAGES and time.monotonic() < begun + PAINTING_TIMEOUT_S:
        newest = client.take_screenshot()  # once it is painted
        picture, equal = newest, equal + 1 if newest == picture else 1
        wait("painting")
    png.parent.mkdir(parents=True, exist_ok=True)
    png.write_bytes(picture)
