"""Machine code for the tests that was made from the present sources only.

Numba compiles a function again when its own file changes, but not when a function that it calls stands in another
file and changes there. A module's machine code is therefore kept only if all of it was made, or used, by tests of
the present sources of the module and its imports. A file in onboard/__pycache__ holds the digests of the sources,
module by module, and has the time of the newest machine code of the tests. Newer code was made by another program,
perhaps from other sources, if one of them has been written since.

Single precision, two fifths of all machine code, is compiled only with `WINGLINE_PRECISION=both`, as in `make
test-all`. Otherwise its tests (marked `single`) run without the compiler, in a separate process
(tests/unit/filters/test_single_precision.py).

`python -m tests.support.kernels` compiles all kernels for the tests, as `make install` does.
"""

import hashlib
import json
import os
import subprocess
import sys
from collections.abc import Container, Iterable, Mapping
from pathlib import Path

from onboard.commands import compiling

ROOT = Path(__file__).parents[2]
STAMP = ROOT / "onboard" / "__pycache__" / "kernels-tested.json"


def choose_precision() -> None:
    """Choose the compiled precision for this process and all that start from it."""
    os.environ.setdefault("WINGLINE_PRECISION", "double")


def both_precisions() -> bool:
    """Whether kernels are compiled for single precision, too."""
    return os.environ["WINGLINE_PRECISION"] == "both"


def sources(name: str) -> list[Path]:
    """Every file whose functions or constants may stand in a module's machine code."""
    return [compiling._source(other) for other in sorted(compiling.needed_by([name]))]


def digests() -> dict[str, str]:
    """SHA-256 of all sources of each module with kernels."""
    return {name: _digest(sources(name)) for name in sorted(compiling.kernel_modules())}


def unknown(
    stamp: Path,
    of_sources: Mapping[str, str],
    code: Mapping[str, Iterable[Path]],
    files: Mapping[str, Iterable[Path]],
) -> list[str]:
    """Return the modules with outdated machine code.

    Their digest is not the stamp's, or some of their code and source `files` are newer than it.
    """
    if not stamp.exists():
        return [*of_sources]
    known, time_ns = json.loads(stamp.read_text(encoding="utf-8")), stamp.stat().st_mtime_ns

    def is_newer(paths: Iterable[Path]) -> bool:
        return any(path.stat().st_mtime_ns > time_ns for path in paths)

    return [
        name
        for name, digest in of_sources.items()
        if known.get(name) != digest or (is_newer(code[name]) and is_newer(files[name]))
    ]


def older(files: Iterable[Path], code: Iterable[Path]) -> bool:
    """Whether machine code is older than a source.

    Numba then compiles it again, also if the source is the same: each process on its own.
    """
    newest = max(path.stat().st_mtime_ns for path in files)
    return any(path.stat().st_mtime_ns < newest for path in code)


def prepare(*, all_at_once: bool) -> None:
    """Delete machine code unless it is known.

    Then compile all kernels if `all_at_once`: several processes are to run tests, must not write the same index at
    the same time, and would each compile what is missing. A stamp says nothing about precisions: where both are
    wanted, what is missing of the second is compiled each time.
    """
    before = digests()
    assert compiling.knows_folders(), "this Numba does not say where its machine code is"
    code = {name: compiling.machine_code(name) for name in before}
    files = {name: sources(name) for name in before}
    stale = {*unknown(STAMP, before, code, files), *(name for name in before if older(files[name], code[name]))}
    if not stale and not (all_at_once and both_precisions()):
        return
    _stamp({name: digest for name, digest in before.items() if name not in stale})
    for path in (path for name in stale for path in code[name]):
        path.unlink(missing_ok=True)
    if all_at_once:
        command = [sys.executable, "-m", "onboard", "compile"]
        subprocess.run(command, cwd=ROOT, env=os.environ | {"PYTHONPATH": str(ROOT)}, check=True)
        keep(before, made=before)


def keep(before: Mapping[str, str], made: Container[str]) -> None:
    """Stamp the machine code of now: of modules that are stamped, and of those `made`.

    None if the sources are no longer those whose digests are `before`.
    """
    if digests() == before:
        stamped = json.loads(STAMP.read_text(encoding="utf-8")) if STAMP.exists() else {}
        _stamp({name: digest for name, digest in before.items() if name in made or name in stamped})


def _stamp(of_sources: Mapping[str, str]) -> None:
    STAMP.parent.mkdir(exist_ok=True)
    STAMP.write_text(json.dumps(of_sources), encoding="utf-8")


def _digest(files: Iterable[Path]) -> str:
    return hashlib.sha256(b"\0".join(path.read_bytes() for path in files)).hexdigest()


if __name__ == "__main__":
    choose_precision()
    prepare(all_at_once=True)
