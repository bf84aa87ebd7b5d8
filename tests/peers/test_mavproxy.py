"""Our parameters as MAVProxy lists and sets them, beside a simulated autopilot; they survive a restart."""

import importlib.util
import os
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from onboard.autopilot.parameters import KEYS
from tests.support.programs import TIMEOUT_S, Program, free_ports, started, until

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(importlib.util.find_spec("MAVProxy") is None, reason="MAVProxy is not installed"),
]

CONFIG = """
[[link]]
name = "autopilot"
url = "udpin:127.0.0.1:{autopilot}"
[[link]]
name = "ground"
url = "udpout:127.0.0.1:{ground}"
[parameters]
path = "{stored}"
[zenoh]
enabled = false
"""


class Station:
    """MAVProxy, which takes commands and prints."""

    def __init__(self, port: int, folder: Path) -> None:
        folder.mkdir()
        program = Path(sys.executable).with_name("mavproxy.py")
        arguments = ["--target-system=1", "--target-component=191", "--default-modules=param"]
        self.text = ""
        self.popen = subprocess.Popen(
            [sys.executable, str(program), f"--master=udpin:127.0.0.1:{port}", *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            cwd=folder,
            env={**os.environ, "HOME": str(folder), "PYTHONUNBUFFERED": "1"},
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def end(self) -> None:
        """End the process and its reader."""
        self.popen.kill()
        self.popen.wait(TIMEOUT_S)
        self._reader.join(TIMEOUT_S)
        for pipe in (self.popen.stdin, self.popen.stdout):
            if pipe is not None:
                pipe.close()

    def _read(self) -> None:
        assert self.popen.stdout is not None
        while piece := os.read(self.popen.stdout.fileno(), 4096):
            self.text += piece.decode(errors="replace")

    def command(self, line: str, answer: str) -> None:
        """Type a command, and wait for its answer."""
        assert self.popen.stdin is not None
        before = len(self.text)
        self.popen.stdin.write(f"{line}\n".encode())
        self.popen.stdin.flush()
        until(lambda: answer in self.text[before:], f"{answer!r} after {line!r} in {self.text!r}")


@contextmanager
def station(port: int, folder: Path) -> Iterator[Station]:
    """A station that has received all parameters; it is ended with the block."""
    made = Station(port, folder)
    try:
        until(lambda: f"Received {len(KEYS)} parameters" in made.text, f"all parameters in {made.text!r}")
        yield made
    finally:
        made.end()


@contextmanager
def daemon(folder: Path, log: str) -> Iterator[tuple[Program, int]]:
    """The daemon with a simulated autopilot, and the port where a station is to listen."""
    autopilot, ground = free_ports(socket.SOCK_DGRAM, socket.SOCK_DGRAM)
    config = folder / f"{log}.toml"
    config.write_text(
        CONFIG.format(autopilot=autopilot, ground=ground, stored=folder / "stored.toml"), encoding="utf-8"
    )
    links = ("--tcp", "none", "--zenoh", "none", "--camera", "none", "--mavlink", f"udpout:127.0.0.1:{autopilot}")
    simulator = ("simlink", "run", "formation", "--seed", "1", *links)
    with started(folder / f"{log}.log", "onboard", "run", config) as program:
        program.wait_for("link ground")
        with started(folder / f"{log}-simlink.log", *simulator):
            program.wait_for("autopilot: PX4")
            yield program, ground


def test_mavproxy_lists_our_parameters_and_sets_one_that_survives_a_restart_seed_1(tmp_path: Path) -> None:
    with daemon(tmp_path, "first") as (program, port), station(port, tmp_path / "a") as one:
        one.command("param show LDR_SIZE_M", "LDR_SIZE_M       2.0")
        one.command("param set LDR_SIZE_M 3.25", "")
        until((tmp_path / "stored.toml").exists, "the stored value")
        one.command("param set CAM_F_PX -4", "")
        program.wait_for("refused: CAM_F_PX = ")
    with daemon(tmp_path, "second") as (_, port), station(port, tmp_path / "b") as two:
        two.command("param show LDR_SIZE_M", "LDR_SIZE_M       3.25")
        two.command("param show CAM_F_PX", "CAM_F_PX         554.2")
