"""`make wheel`: a wheel for this kind of computer and this Python, with compiled kernels.

It is built from a copy of the installed files. Its tag names Python and system, and it requires the exact version
of Numba that made the code. `pip install .` and the source distribution remain without machine code, for every
computer.
"""

import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from onboard.filters import shipped
from release import man

ROOT: Final = Path(__file__).parents[1]
INSTALLED: Final = ("onboard", "simlink", "configs", "examples", "release")
FILES: Final = ("pyproject.toml", "README.md", "LICENSE")
BUILD: Final = """
import sys
from setuptools import build_meta
build, out, *options = sys.argv[1:]
print(getattr(build_meta, f"build_{build}")(out, {"--build-option": options} if options else None))
"""
# Machine code calls the mathematical functions of the C library by name, at whichever version: the oldest that the
# wheels of Numba, NumPy and Zenoh are for bounds it.
SYSTEM: Final = "manylinux_2_28"
NUMBA: Final = re.compile(r'"numba\b[^"]*"')
PAGES: Final = """
[tool.setuptools.data-files]
"share/man/man1" = ["man/*.1"]
"""


def main(arguments: Sequence[str] = ()) -> int:
    """Build the wheel with machine code into a folder, `dist` by default, and print its size."""
    out = Path(arguments[0] if arguments else "dist").resolve()
    if platform.system() != "Linux" or platform.machine() not in shipped.PROCESSORS:
        print(f"wheel: no processor of {platform.system()} on {platform.machine()} is known here", file=sys.stderr)
        return 1
    began = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="wingline-") as folder:
        made = build_compiled(copy_tree(Path(folder) / "wingline"), out)
    print(f"{made}: {made.stat().st_size / 1e6:.1f} MB, in {time.monotonic() - began:.0f} s")
    return 0


def build_all(out: Path) -> list[Path]:
    """Build the wheel with machine code, the one without, and the source distribution.

    Raises CalledProcessError.
    """
    with tempfile.TemporaryDirectory(prefix="wingline-") as folder:
        tree = copy_tree(Path(folder) / "wingline")
        plain = [build("sdist", tree, out), build("wheel", tree, out)]
        return [build_compiled(tree, out), *plain]


def build_compiled(tree: Path, out: Path) -> Path:
    """Build the wheel for this kind of computer, to which the tree is adapted.

    Raises CalledProcessError.
    """
    compile_into(tree)
    require_numba(tree, shipped.made_with()["numba"])
    return build("wheel", tree, out, "--python-tag", tag(), "--plat-name", f"{SYSTEM}_{platform.machine()}")


def copy_tree(tree: Path) -> Path:
    """Copy the installed files, the files of links, and the man pages into a new folder."""
    for folder in INSTALLED:
        ignore = shutil.ignore_patterns("__pycache__", "*.egg-info", shipped.FOLDER.name)
        shutil.copytree(ROOT / folder, tree / folder, ignore=ignore)
    for name in FILES:
        shutil.copy(ROOT / name, tree)
    man.write(tree / "man")
    with (tree / "pyproject.toml").open("a", encoding="utf-8") as project:
        project.write(PAGES)
    return tree


def compile_into(tree: Path) -> None:
    """Compile machine code for each kind of processor of this architecture into a tree.

    Raises CalledProcessError.
    """
    for one in shipped.PROCESSORS[platform.machine()]:
        options = {"NUMBA_CPU_NAME": one.made.name, "NUMBA_CPU_FEATURES": one.made.features}
        run([sys.executable, "-m", "release.machine_code", one.name], tree, options)
    finish = "from onboard.commands import compiling; from onboard.filters import shipped; "
    run([sys.executable, "-c", f"{finish}shipped.write_contents(shipped.FOLDER, compiling.sources())"], tree)


def require_numba(tree: Path, version: str) -> None:
    """Make the tree's wheel require this version only, as its machine code needs it.

    Raises ValueError.
    """
    project = tree / "pyproject.toml"
    text, count = NUMBA.subn(f'"numba=={version}"', project.read_text(encoding="utf-8"), count=1)
    if count != 1:
        raise ValueError(f"{project}: no requirement of Numba")
    project.write_text(text, encoding="utf-8")


def build(kind: str, tree: Path, out: Path, *options: str) -> Path:
    """Build the "wheel" or "sdist" of a tree with the installed tools.

    Raises CalledProcessError.
    """
    out.mkdir(parents=True, exist_ok=True)
    shutil.rmtree(tree / "build", ignore_errors=True)
    done = run([sys.executable, "-c", BUILD, kind, str(out), *options], tree, capture=True)
    return out / done.splitlines()[-1]


def run(command: Sequence[str], tree: Path, more: dict[str, str] | None = None, *, capture: bool = False) -> str:
    """Run a program of a tree; return its output if it is captured. Raises CalledProcessError."""
    environment = os.environ | {"PYTHONPATH": str(tree), "PYTHONDONTWRITEBYTECODE": "1"} | (more or {})
    to = subprocess.PIPE if capture else None
    try:
        done = subprocess.run(command, cwd=tree, env=environment, check=True, text=True, stdout=to, stderr=to)  # noqa: S603
    except subprocess.CalledProcessError as error:
        print(error.stderr or "", end="", file=sys.stderr)
        raise
    return done.stdout or ""


def tag() -> str:
    """Return the tag of this Python in the names of wheels."""
    return f"cp{sys.version_info.major}{sys.version_info.minor}"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
