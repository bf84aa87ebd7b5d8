"""`python -m onboard.compiled`: compile all kernels for this kind of processor.

It needs Numba (`pip install 'wingline[build]'`) and a C compiler. Processors may be named, or `all` of this kind
of computer. The object file of each module is kept under a digest of the code that it depends on, without comments
and docstrings, and is not made twice.
"""

import os
import platform
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from importlib.metadata import PackageNotFoundError, version
from multiprocessing import get_context
from pathlib import Path
from typing import Final

import msgspec

from onboard import UserError
from onboard.compiled.machine import (
    FOLDER,
    OBJECTS,
    PROCESSORS,
    ROOT,
    Processor,
    checksum,
    digest,
    features,
    processor,
)
from onboard.compiled.parts import Part
from onboard.compiled.sources import code_digest, kernel_modules, sources

C_SOURCES: Final = ("boundary.c", "linear_algebra.c")
MADE_BY: Final = ("onboard/compiled/native.py", "onboard/compiled/numba_types.py")
COMPILERS: Final = ("numba", "llvmlite", "numpy")  # whose versions object files depend on
FLAGS: Final = (
    *("-O2", "-fPIC", "-shared", "-s", "-fvisibility=hidden", "-fno-strict-aliasing", "-fno-builtin"),
    "-nostdlib",  # and no headers: a compiler alone is enough, and `LIBRARIES` are there wherever Python is
)
LIBRARIES: Final = ("-l:libm.so.6", "-l:libc.so.6")


class BuildError(UserError):
    """The machine code cannot be made; the message says why."""


def build(target: Processor, folder: Path = FOLDER) -> Path:
    """The extension module for a processor, in a folder. Raises BuildError."""
    compiler = _compiler()
    (folder / OBJECTS).mkdir(parents=True, exist_ok=True)
    modules = kernel_modules()
    files = {name: folder / OBJECTS / _object_name(name, target) for name in modules}
    missing = [name for name in modules if not files[name].exists()]
    if missing:
        _compile(missing, files, target)
    for old in {*(folder / OBJECTS).glob(f"{target.name}@*")} - {*files.values()}:
        old.unlink()
    parts = [msgspec.msgpack.decode(files[name].read_bytes(), type=Part) for name in modules]
    path = folder / f"{target.name}.so"
    _link(compiler, parts, path, sources(modules))
    return path


def _object_name(module: str, target: Processor) -> str:
    try:
        made_with = "-".join(version(package) for package in COMPILERS)
    except PackageNotFoundError as error:
        raise BuildError(f"compiling: {error.name} is missing; pip install 'wingline[build]'") from error
    return f"{target.name}@{module}@{made_with}@{code_digest([*sources([module]), *MADE_BY])[:24]}"


def _compile(names: Sequence[str], files: Mapping[str, Path], target: Processor) -> None:
    """Make object files, in as many processes as there are cores."""
    from onboard.compiled import native  # noqa: PLC0415 - it imports Numba

    os.environ["WINGLINE_KERNELS"] = "build"  # of the processes
    count = min(len(os.sched_getaffinity(0)), len(names))
    with ProcessPoolExecutor(count, get_context("spawn"), native.aim, (target,)) as pool:
        futures = {pool.submit(native.module_part, name): name for name in sorted(names, key=_cost, reverse=True)}
        for done, future in enumerate(as_completed(futures), start=1):
            whole = files[futures[future]].with_suffix(f".{os.getpid()}")
            whole.write_bytes(msgspec.msgpack.encode(future.result()))
            whole.replace(files[futures[future]])
            print(f"\rcompiling the filters: {done} of {len(names)} modules", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)


def _cost(module: str) -> int:
    """Estimate a module's build time by its kernels, so that the longest begin first."""
    texts = ((ROOT / file).read_text(encoding="utf-8") for file in sources([module]))
    return sum(text.count("@kernel(") for text in texts)


def _link(compiler: str, parts: Sequence[Part], path: Path, made_of: Sequence[str]) -> None:
    with tempfile.TemporaryDirectory() as temporary:
        source, library = Path(temporary) / "kernels.c", Path(temporary) / "kernels.so"
        source.write_text(_source(parts, made_of), encoding="utf-8")
        objects = []
        for k, part in enumerate(part for part in parts if part.entries):
            objects.append(Path(temporary) / f"{k}.o")
            objects[-1].write_bytes(part.object_file)
        command = [compiler, *FLAGS, "-o", *map(str, (library, source, *objects)), *LIBRARIES]
        done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603 - our own files
        if done.returncode:
            raise BuildError(f"compiling: {compiler} failed: {done.stderr.strip()}")
        content = library.read_bytes()
    whole = path.with_suffix(f".{os.getpid()}")
    whole.write_bytes(content + checksum(content))
    whole.replace(path)


def _source(parts: Sequence[Part], made_of: Sequence[str]) -> str:
    """The C code of the extension module, with its table of kernels."""
    entries = [entry for part in parts for entry in part.entries]
    rows = (
        f'{{"{e.name}", "{e.takes}", "{e.gives}", "{e.class_names}", {e.symbol}, {int(e.releases_lock)}}},'
        for e in entries
    )
    return "\n".join(
        [
            *(Path(__file__).with_name(name).read_text(encoding="utf-8") for name in C_SOURCES),
            *(f"int {entry.symbol}(i64 *, i64 *);" for entry in entries),
            *("Kernel kernels[] = {", *rows, "};", f"const int kernel_count = {len(entries)};"),
            f'const char digest[] = "{digest(made_of)}", sources[] = "{" ".join(made_of)}";\n',
        ]
    )


def _compiler() -> str:
    for name in (os.environ.get("CC"), "cc", "gcc", "clang"):
        if name and shutil.which(name):
            return name
    raise BuildError("compiling: there is no C compiler; on Debian and Ubuntu: apt install gcc, or set CC")


def targets(names: Sequence[str], machine: str, can: frozenset[str]) -> list[Processor]:
    """Return the processors of these names, or this machine's by default. Raises UserError."""
    known = {one.name: one for one in PROCESSORS.get(machine, ())}
    if not names:
        return [processor(machine, can)]
    unknown = sorted({*names} - {*known, "all"})
    if unknown:
        raise BuildError(f"compiling: {', '.join(unknown)}: no such processor; there are: {', '.join(known)}, all")
    return [*known.values()] if "all" in names else [known[name] for name in names]


def main(names: Sequence[str]) -> int:
    """Build for processors by their names, and say how large the files are."""
    try:
        for target in targets(names, platform.machine(), features()):
            began = time.monotonic()
            path = build(target)
            print(f"{path}: {path.stat().st_size / 1e6:.1f} MB, in {time.monotonic() - began:.0f} s")
    except UserError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
