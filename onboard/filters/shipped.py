"""Machine code that a wheel carries, so that nothing is compiled on the computer that flies.

`make wheel` lays it into `onboard/machine_code`: a folder for each processor that it is made for, in it one for
each module with kernels, in it Numba's files. `made.json` tells by which versions it was made, and of which
sources the code of each module is. It is used while Numba, LLVM and Python are of these versions, and while these
sources have the same bytes: their digest is the code's stamp. When files were written does not matter.

Code for a processor is used on each that can do all that it needs. Where there is none, or it is damaged, or Numba
is set to compile for another processor (`NUMBA_CPU_NAME`), kernels are compiled as without it.
"""

import hashlib
import json
import platform
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Final, NamedTuple

from onboard.filters import numba_internals
from onboard.filters.numba_internals import CodeFolder, Made

PACKAGES: Final = Path(__file__).parents[2]  # in which `onboard` is
FOLDER: Final = PACKAGES / "onboard" / "machine_code"
CONTENTS: Final = "made.json"


class Processor(NamedTuple):
    """What code is made for: the name of its folder, the options of the compiler, and what it needs, by LLVM's
    names."""

    name: str
    made: Made
    needs: frozenset[str]


PROCESSORS: Final = {
    "x86_64": (
        Processor(  # Intel from Haswell (2013) on, AMD from Excavator (2015) on; not some Atoms and Celerons
            "x86-64-v3",
            Made("x86-64-v3", ""),
            frozenset(
                "avx avx2 bmi bmi2 cx16 f16c fma lzcnt movbe popcnt sahf sse3 sse4.1 sse4.2 ssse3 xsave".split()  # noqa: SIM905
            ),
        ),
    ),
    "aarch64": (
        # of ARMv8.2 what Linux tells and the compiler uses: Cortex-A55 and A76 (Raspberry Pi 5), not A72 (Pi 4)
        Processor("armv8.2", Made("generic", "+crc,+lse"), frozenset({"crc", "fp-armv8", "lse", "neon"})),
        Processor("armv8", Made("generic", ""), frozenset({"fp-armv8", "neon"})),
    ),
}


class Code:
    """The machine code in a folder, made for one processor, with the `sources` of each module by paths below
    `packages`."""

    def __init__(
        self, folder: Path, processor: Processor, sources: Mapping[str, Sequence[str]], packages: Path = PACKAGES
    ) -> None:
        self._folder, self._packages = folder / processor.name, packages
        self._sources = sources
        self._stamps: dict[str, str] = {}

    def place(self, source: Path) -> CodeFolder | None:
        """Where the code of a source is; None for one that it has no code of."""
        if not source.is_relative_to(self._packages):
            return None
        name = source.relative_to(self._packages).as_posix()
        if name not in self._sources:
            return None
        if name not in self._stamps:
            self._stamps[name] = digest(self._packages, self._sources[name])
        return CodeFolder(self._folder / name.removesuffix(".py").replace("/", "."), self._stamps[name])


def made_with() -> dict[str, str]:
    """The versions, and the kind of computer, that machine code depends on."""
    return numba_internals.compiler_versions() | {"machine": platform.machine()}


def digest(packages: Path, sources: Iterable[str]) -> str:
    """SHA-256 over the names and bytes of sources, by their paths below `packages`. One that is missing counts as
    such."""
    found = hashlib.sha256()
    for name in sources:
        found.update(f"{name}\0".encode() + _hashed(packages / name))
    return found.hexdigest()


@cache
def _hashed(path: Path) -> bytes:
    return hashlib.sha256(path.read_bytes()).digest() if path.is_file() else b"missing"


def chosen(
    machine: str, can: frozenset[str], asked: tuple[str | None, str | None] = (None, None)
) -> Processor | None:
    """The processor whose code runs on a machine (`platform.machine`) that can do these: the first of which all
    that it needs is there, or the one that Numba was asked to compile for."""
    for one in PROCESSORS.get(machine, ()):
        if one.needs <= can if asked == (None, None) else asked == one.made:
            return one
    return None


def use(folder: Path = FOLDER) -> bool:
    """Let Numba take machine code from here before it looks elsewhere; whether there is any that fits."""
    if not folder.is_dir():
        return False
    processor = chosen(platform.machine(), numba_internals.processor_features(), numba_internals.asked_for())
    if processor is None:
        return False
    sources = sources_of(folder)
    if sources is None or not (folder / processor.name).is_dir():
        return False
    return numba_internals.look_first(Code(folder, processor, sources).place, processor.made)


def write_contents(folder: Path, sources: Mapping[str, Sequence[str]]) -> None:
    """Write what a folder with machine code holds, once all of it is there."""
    text = json.dumps({"made_with": made_with(), "sources": sources}, indent=1, sort_keys=True)
    (folder / CONTENTS).write_text(text, encoding="utf-8")


def sources_of(folder: Path) -> dict[str, list[str]] | None:
    """The sources of each module with code in a folder; None if it is not all there, or is for other versions."""
    try:
        contents = json.loads((folder / CONTENTS).read_text(encoding="utf-8"))
        sources: dict[str, list[str]] = contents["sources"]
        return sources if contents["made_with"] == made_with() else None
    except (KeyError, OSError, TypeError, ValueError):  # as from an installation that was interrupted
        return None
