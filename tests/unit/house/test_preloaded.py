"""A program that a test starts as a fork does what a new interpreter does."""

import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.support.preloaded import Preloaded
from tests.support.programs import PATIENCE, argv, environment, started

LINUX = pytest.mark.skipif(sys.platform != "linux", reason="only there do programs fork")
PIPE = subprocess.PIPE


def ended(kind: type["subprocess.Popen[Any]"], *command: str, **how: Any) -> tuple[int, str, str]:
    with kind(argv(*command), stdin=PIPE, stdout=PIPE, stderr=PIPE, text=True, **how) as popen:
        out, err = popen.communicate(timeout=PATIENCE)
        return popen.returncode, out, err


@pytest.mark.parametrize("command", ["onboard --version", "onboard check no.toml", "simlink config formation"])
def test_it_ends_and_writes_as_a_new_interpreter(command: str, tmp_path: Path) -> None:
    how = {"env": environment(), "cwd": tmp_path}
    found = ended(Preloaded, *command.split(), **how)
    assert found == ended(subprocess.Popen, *command.split(), **how)
    assert found[0] == (2 if "no.toml" in command else 0)


@LINUX
def test_it_is_our_child_with_its_own_session_folder_environment_and_end(tmp_path: Path) -> None:
    before = len(os.listdir("/proc/self/fd"))  # noqa: PTH208 - names alone
    settings = ("--set", "zenoh.enabled=false", "link=[]")
    with started(tmp_path / "log", "onboard", "run", *settings, cwd=tmp_path) as program:
        process = program.process
        assert "preloaded" in " ".join(process.cmdline())
        assert (process.ppid(), os.getsid(process.pid)) == (os.getpid(), process.pid)
        assert process.cwd() == str(tmp_path)
        assert program.end(signal.SIGKILL) == -signal.SIGKILL
    assert len(os.listdir("/proc/self/fd")) <= before + 1  # noqa: PTH208 - that to whatever forks


def test_where_variables_differ_that_are_read_while_modules_load_it_is_a_new_interpreter() -> None:
    ended(Preloaded, "onboard", "--version", env=environment())
    with Preloaded(argv("onboard", "--version"), env=environment() | {"NUMBA_OPT": "2"}, stdout=PIPE) as popen:
        assert "preloaded" not in Path(f"/proc/{popen.pid}/cmdline").read_text()
        popen.communicate(timeout=PATIENCE)
