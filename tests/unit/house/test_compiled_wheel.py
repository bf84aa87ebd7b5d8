"""The wheel with machine code, installed as a user does, flies without Numba, and estimates the same."""

import os
import platform
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

from onboard.compiled.machine import PROCESSORS
from simlink import cli as simlink
from tests.support.programs import ROOT, TIMEOUT_S, environment

pytestmark = [
    pytest.mark.slow,  # three minutes of a core
    pytest.mark.skipif(platform.machine() not in PROCESSORS, reason="no processor of this kind is known"),
    pytest.mark.skipif(sys.platform != "linux", reason="wheels are made for Linux"),
]
WITHOUT_NUMBA = """
import sys
sys.modules.update(numba=None, llvmlite=None)  # to import them is an error
from onboard.commands.cli import main
sys.exit(main(sys.argv[1:]))
"""


class Installed:
    """An environment with the wheel, and the packages of this one."""

    def __init__(self, folder: Path, wheel: Path) -> None:
        self.site, self.home = folder / "venv", folder / "home"
        run([sys.executable, "-m", "venv", "--without-pip", str(self.site)])
        self.python = self.site / "bin" / "python"
        pip = [sys.executable, "-m", "pip", "--python", str(self.python), "--disable-pip-version-check"]
        run([*pip, "install", "-qq", "--no-index", "--no-deps", "--no-compile", str(wheel)])
        own = next(self.site.glob("lib/python*/site-packages"))
        (own / "packages.pth").write_text(f"{sysconfig.get_path('purelib')}\n", encoding="utf-8")
        self.home.mkdir()

    def flies(self, *arguments: str) -> str:
        """What a command of ours prints."""
        here = {k: v for k, v in environment().items() if not k.startswith(("PYTHON", "WINGLINE_", "XDG_"))}
        command = [str(self.python), "-P", "-c", WITHOUT_NUMBA, *arguments]
        return run(command, here | {"HOME": str(self.home)}, self.home)


def run(command: list[str], env: dict[str, str] | None = None, cwd: Path = ROOT) -> str:
    done = subprocess.run(
        command, env=env, cwd=cwd, capture_output=True, text=True, check=False, timeout=4 * TIMEOUT_S
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Installed:
    """`WINGLINE_WHEEL` names one that is there already."""
    folder = tmp_path_factory.mktemp("compiled")
    given = os.environ.get("WINGLINE_WHEEL")
    if given is None:
        run([sys.executable, "-m", "release.wheel", str(folder)])
    (wheel,) = [Path(given)] if given else folder.glob("*.whl")
    assert wheel.stat().st_size <= 20e6
    return Installed(folder, wheel)


def test_a_flight_without_numba_estimates_the_same(installed: Installed, tmp_path: Path) -> None:
    log, config = tmp_path / "flight.tlog", str(ROOT / "configs" / "demo.toml")
    assert simlink.main(["log", "mission", "--seed", "1", "--duration", "20", "--out", str(log)]) == 0
    tables = [tmp_path / f"{whose}-{what}.csv" for whose in ("wheel", "here") for what in ("leader", "own")]

    def arguments(leader: Path, own: Path) -> list[str]:
        return ["replay", str(log), "--config", config, "--out", str(leader), "--own", str(own)]

    installed.flies(*arguments(*tables[:2]))
    run([sys.executable, "-m", "onboard", *arguments(*tables[2:])], environment())
    for theirs, ours in ((tables[0], tables[2]), (tables[1], tables[3])):
        assert theirs.read_text(encoding="utf-8").count("\n") > 300
        assert theirs.read_bytes() == ours.read_bytes()
    assert not [*installed.home.rglob("*.so")]
