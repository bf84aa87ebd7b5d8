"""Machine code for the tests: none is used that may have been made from other sources than those that stand here.

Numba compiles a function again when its own file changes, but not when a function that it calls stands in another
file and changes there. So machine code is kept only if all of it was made, or used, by tests of these sources.
A file in onboard/__pycache__ holds the digest of the sources, and is as new as the newest machine code that the
tests made. Code that is newer was made by another program, perhaps while a source was another.
"""

import hashlib
import os
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

from onboard.commands import compiling
from tests.support.programs import ROOT

STAMP = ROOT / "onboard" / "__pycache__" / "kernels-tested"


def sources() -> list[Path]:
    """Every file whose functions or constants may stand in machine code."""
    return [compiling._source(name) for name in sorted(compiling.needed_by(compiling.kernel_modules()))]


def digest() -> str:
    """SHA-256 of all sources."""
    return hashlib.sha256(b"\0".join(path.read_bytes() for path in sources())).hexdigest()


def machine_code() -> list[Path]:
    """The index and code files of all modules with kernels, wherever Numba keeps them."""
    folders = {compiling.cache_folder(compiling._source(name)) for name in compiling.kernel_modules()}
    assert None not in folders, "this Numba does not say where its machine code is"
    return [path for folder in folders if folder is not None for path in folder.glob("*.nb[ic]")]


def is_known(stamp: Path, of_sources: str, code: Iterable[Path]) -> bool:
    """Whether the stamp is `of_sources` (a digest), and no code is newer than it."""
    if not stamp.exists() or stamp.read_text(encoding="utf-8") != of_sources:
        return False
    return all(path.stat().st_mtime_ns <= stamp.stat().st_mtime_ns for path in code)


def prepare(*, all_at_once: bool) -> None:
    """Delete machine code unless it is known. Then compile all kernels if `all_at_once`: several processes are to
    run tests, and must not write the same index at the same time."""
    before = digest()
    if is_known(STAMP, before, machine_code()):
        return
    for path in machine_code():
        path.unlink(missing_ok=True)
    STAMP.unlink(missing_ok=True)
    if all_at_once:
        command = [sys.executable, "-m", "onboard", "compile"]
        subprocess.run(command, cwd=ROOT, env=os.environ | {"PYTHONPATH": str(ROOT)}, check=True)
    keep(before)


def keep(before: str) -> None:
    """Stamp the machine code of now, unless the sources are no longer those whose digest is `before`."""
    if digest() == before:
        STAMP.parent.mkdir(exist_ok=True)
        STAMP.write_text(before, encoding="utf-8")
