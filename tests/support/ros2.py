"""Real ROS 2 for tests, from the wheels in `.venv-ros` that `make test` installs.

Fast DDS uses the loopback interface only.
"""

import json
import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from tests.support.programs import ROOT, TIMEOUT_S, Program

ROS: Final = ROOT / ".venv-ros"
PYTHON: Final = ROS / "bin" / "python"
CLIENT: Final = "tests.support.ros_client"


def environment(domain: int) -> dict[str, str]:
    """Return the environment of a ROS program that is heard only on this computer and in this domain."""
    return {
        "LD_LIBRARY_PATH": str(ROS / "lib"),
        "AMENT_PREFIX_PATH": str(ROS),
        "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_DOMAIN_ID": str(domain),
        "ROS_LOG_DIR": str(ROS / "log"),
    }


def why_absent() -> str:
    """Why no ROS 2 can be run; "" if it can."""
    if not PYTHON.exists():
        return "needs ROS 2: make .venv-ros/.ready"
    code = "import rclpy, vision_msgs.msg, tf2_msgs.msg, apriltag_msgs.msg"
    done = subprocess.run(
        [PYTHON, "-c", code], env={**os.environ, **environment(0)}, capture_output=True, text=True, check=False
    )
    return "" if done.returncode == 0 else f"no ROS 2 runs here: {done.stderr.strip().splitlines()[-1]}"


def domain() -> int:
    """A ROS_DOMAIN_ID of this process's own."""
    return 101 + os.getpid() % 100


@contextmanager
def ros_program(log: Path, *command: str | Path) -> Iterator[Program]:
    """A program run by the Python that has ROS, killed at the end."""
    program = Program(log, *command, python=PYTHON, env=environment(domain()))
    try:
        yield program
    finally:
        program.kill()


def ros_run(*command: str | Path) -> list[dict[str, Any]]:
    """Run the client of `tests.support.ros_client`, and return its output."""
    done = subprocess.run(
        [str(PYTHON), "-m", CLIENT, *map(str, command)],
        env={**os.environ, **environment(domain())},
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
        check=False,
        cwd=ROOT,
    )
    assert done.returncode == 0, done.stderr
    return lines(done.stdout)


def lines(text: str) -> list[dict[str, Any]]:
    """Whole lines of JSON."""
    return [json.loads(line) for line in text.splitlines(keepends=True) if line.endswith("\n")]
