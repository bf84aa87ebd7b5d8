"""The wheel with machine code, installed as a user does: nothing is compiled, and the estimates are the same."""

import os
import platform
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

from onboard.commands.compiling import kernel_modules
from onboard.filters import shipped
from simlink import cli as simlink
from tests.support.programs import ROOT, TIMEOUT_S, environment
from tests.support.same_estimates import TOLERANCE, largest_difference, rows

pytestmark = [
    pytest.mark.slow,  # three minutes of a core
    pytest.mark.skipif(platform.machine() not in shipped.PROCESSORS, reason="no processor of this kind is known"),
    pytest.mark.skipif(sys.platform != "linux", reason="wheels are made for Linux"),
]
WATCHED = """
import sys
from onboard.filters.numba_internals import on_compile
compiled = []
assert on_compile(lambda: compiled.append(1))
from onboard.commands.cli import main
code = main(sys.argv[1:])
assert not compiled, f"{len(compiled)} kernels were compiled"
sys.exit(code)
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

    def flies(self, *arguments: str, watched: bool = True) -> str:
        """What a command of ours prints. Compiling is an error, if it is `watched`."""
        here = {k: v for k, v in environment().items() if not k.startswith(("PYTHON", "NUMBA_", "XDG_"))}
        command = [str(self.python), "-P", *(["-c", WATCHED] if watched else ["-m", "onboard"]), *arguments]
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
    return Installed(folder, wheel)


def test_every_kernel_is_loaded_and_none_compiled(installed: Installed) -> None:
    *lines, last = installed.flies("compile").splitlines()
    assert last.startswith("ready in ")
    assert all(" 0 compiled, " in line for line in lines)
    assert len(lines) > 0.7 * len(kernel_modules())
    kept = [path for path in installed.site.rglob("*.nb?") if shipped.FOLDER.name not in path.parts]
    assert not [*kept, *installed.home.rglob("*.nb?")]


def test_a_flight_compiles_nothing_and_estimates_the_same(installed: Installed, tmp_path: Path) -> None:
    """Machine code for a family of processors may round products in other places than this one's own."""
    log, config = tmp_path / "flight.tlog", str(ROOT / "configs" / "demo.toml")
    assert simlink.main(["log", "mission", "--seed", "1", "--duration", "20", "--out", str(log)]) == 0
    tables = [tmp_path / f"{whose}-{what}.csv" for whose in ("wheel", "here") for what in ("leader", "own")]

    def arguments(leader: Path, own: Path) -> list[str]:
        return ["replay", str(log), "--config", config, "--out", str(leader), "--own", str(own)]

    installed.flies(*arguments(*tables[:2]))
    run([sys.executable, "-m", "onboard", *arguments(*tables[2:])], environment())
    for theirs, ours in ((tables[0], tables[2]), (tables[1], tables[3])):
        assert len(rows(theirs)) > 300
        assert largest_difference(theirs, ours) <= TOLERANCE
