"""`make wheel`: a wheel for this kind of computer, with the machine code of all kernels.

It is built of a copy of what is installed. Its tag says for which system it is. It is for each Python, of which
the extension module uses the stable interface alone. `pip install .` and the source distribution stay without
machine code, for every computer.
"""

import os
import platform
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from onboard.compiled.machine import FOLDER, OBJECTS, PROCESSORS
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
# Machine code calls mathematical functions of the C library, some by their version of glibc 2.29; 2.31 is the next
# that a distribution has.
SYSTEM: Final = "manylinux_2_31"
PAGES: Final = """
[tool.setuptools.data-files]
"share/man/man1" = ["man/*.1"]
"""


def main(arguments: Sequence[str] = ()) -> int:
    """Build the wheel with machine code into a folder, `dist` by default, and print its size."""
    out = Path(arguments[0] if arguments else "dist").resolve()
    if platform.system() != "Linux" or platform.machine() not in PROCESSORS:
        print(f"wheel: no processor of {platform.system()} on {platform.machine()} is known here", file=sys.stderr)
        return 1
    began = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="wingline-") as folder:
        made = with_machine_code(copy_tree(Path(folder) / "wingline"), out)
    print(f"{made}: {made.stat().st_size / 1e6:.1f} MB, in {time.monotonic() - began:.0f} s")
    return 0


def build_all(out: Path) -> list[Path]:
    """Build the wheel with machine code, the one without, and the source distribution.

    Raises CalledProcessError.
    """
    with tempfile.TemporaryDirectory(prefix="wingline-") as folder:
        tree = copy_tree(Path(folder) / "wingline")
        plain = [build("sdist", tree, out), build("wheel", tree, out)]
        return [with_machine_code(tree, out), *plain]


def with_machine_code(tree: Path, out: Path) -> Path:
    """The wheel for this computer's kind; the tree is for this one afterwards. Raises CalledProcessError."""
    if (FOLDER / OBJECTS).is_dir():  # what is compiled already, under digests of its sources
        shutil.copytree(FOLDER / OBJECTS, tree / FOLDER.relative_to(ROOT) / OBJECTS)
    run([sys.executable, "-m", "onboard.compiled", "all"], tree)
    return build("wheel", tree, out, "--python-tag", "py3", "--plat-name", f"{SYSTEM}_{platform.machine()}")


def copy_tree(tree: Path) -> Path:
    """Copy the installed files, the files of links, and the man pages into a new folder."""
    for folder in INSTALLED:
        ignore = shutil.ignore_patterns("__pycache__", "*.egg-info", FOLDER.name)
        shutil.copytree(ROOT / folder, tree / folder, ignore=ignore)
    for name in FILES:
        shutil.copy(ROOT / name, tree)
    man.write(tree / "man")
    with (tree / "pyproject.toml").open("a", encoding="utf-8") as project:
        project.write(PAGES)
    return tree


def build(kind: str, tree: Path, out: Path, *options: str) -> Path:
    """Build the "wheel" or "sdist" of a tree with the installed tools.

    Raises CalledProcessError.
    """
    out.mkdir(parents=True, exist_ok=True)
    shutil.rmtree(tree / "build", ignore_errors=True)
    done = run([sys.executable, "-c", BUILD, kind, str(out), *options], tree, capture=True)
    return out / done.splitlines()[-1]


def run(command: Sequence[str], tree: Path, *, capture: bool = False) -> str:
    """A program of a tree, with what it prints if it is captured. Raises CalledProcessError."""
    environment = os.environ | {"PYTHONPATH": str(tree), "PYTHONDONTWRITEBYTECODE": "1"}
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
