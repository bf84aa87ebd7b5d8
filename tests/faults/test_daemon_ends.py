"""How the daemon ends: by a signal at any time, and by an exception that is nobody's fault but ours."""

import asyncio
import subprocess
import sys
from typing import Any

import pytest

from onboard.daemon import Daemon
from onboard.links import LinkError
from tests.support.programs import ROOT, environment
from tests.support.streams import make_config

STOPPED_WHILE_LOADING = """
import signal, sys
import onboard.config

def load_config(*_):
    signal.raise_signal(signal.SIGTERM)
    raise AssertionError("the signal changed nothing")

onboard.config.load_config = load_config
from onboard.commands.cli import main
sys.exit(main(["run"]))
"""


def test_sigterm_while_the_daemon_still_loads_ends_it_properly() -> None:
    command = [sys.executable, "-c", STOPPED_WHILE_LOADING]
    done = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, timeout=60, check=False, env=environment()
    )
    assert done.returncode == 0, done.stderr
    assert "stopped" in done.stderr
    assert "Traceback" not in done.stderr


def test_signals_are_heeded_before_anything_is_loaded_that_takes_long() -> None:
    """What remains is the start of Python itself, 0.05 s."""
    command = [sys.executable, "-c", "import sys; import onboard.__main__; print(*sys.modules)"]
    done = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, timeout=60, check=True, env=environment()
    )
    loaded = set(done.stdout.split())
    assert "onboard.terminal.output" in loaded
    slow = {"argparse", "asyncio", "msgspec", "numba", "numpy", "pymavlink", "zenoh", "onboard.commands.cli"}
    assert not slow & loaded


class Broken:
    """A link that ends with an exception."""

    channel = "broken"

    def __init__(self, error: Exception) -> None:
        self._error = error

    async def run(self, *_: Any) -> None:
        raise self._error

    def send(self, _data: bytes) -> None:
        pass


@pytest.mark.parametrize("error", [ZeroDivisionError("a mistake of ours"), LinkError("a link has ended")])
def test_an_exception_of_a_link_is_raised_as_itself(error: Exception) -> None:
    daemon = Daemon(make_config("link=[]", "zenoh.enabled=false"), report=lambda _line: None)
    daemon._links = [Broken(error), Broken(error)]  # type: ignore[list-item]

    async def fly() -> None:
        await asyncio.wait_for(daemon._fly(asyncio.Event()), 10)

    with pytest.raises(type(error)) as raised:
        asyncio.run(fly())
    assert raised.value is error
