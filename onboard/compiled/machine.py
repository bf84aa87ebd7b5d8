"""The extension module with all kernels' machine code: its file, and whether it is valid."""

import hashlib
import platform
from collections.abc import Iterable
from functools import cache
from importlib.machinery import ExtensionFileLoader, ModuleSpec
from importlib.util import module_from_spec
from pathlib import Path
from typing import Any, Final, NamedTuple

from onboard import UserError

ROOT: Final = Path(__file__).parents[2]
FOLDER: Final = ROOT / "onboard" / "machine_code"
OBJECTS: Final = "objects"  # a folder in that one, with what is compiled of each module; no flight needs it
CHECKSUM_SIZE: Final = 32  # bytes
REPAIR: Final = (
    "run `python -m onboard.compiled` (after `pip install 'wingline[build]'`), or install the wheel again"
)


class MachineCodeError(UserError, ImportError):
    """There is no machine code of the kernels for this computer; the message says what to do."""


class Processor(NamedTuple):
    """A target of machine code: LLVM's name and features, and the flags that Linux shows."""

    name: str
    cpu: str
    more: str
    needs: frozenset[str]


PROCESSORS: Final = {
    "x86_64": (
        # Intel from Haswell (2013) on, AMD from Excavator (2015) on; not some Atoms and Celerons
        Processor("x86-64-v3", "x86-64-v3", "", frozenset("avx2 bmi1 bmi2 f16c fma abm movbe xsave".split())),  # noqa: SIM905
        Processor("x86-64", "x86-64", "", frozenset()),
    ),
    "aarch64": (Processor("armv8", "generic", "", frozenset()),),
}


def features() -> frozenset[str]:
    """This processor's features, by the names that Linux shows."""
    try:
        with Path("/proc/cpuinfo").open(encoding="utf-8") as file:
            lines = iter(file.readline, "\n")
            line = next((line for line in lines if line.startswith(("flags", "Features"))), "")
    except OSError:
        return frozenset()
    return frozenset(line.partition(":")[2].split())


def processor(machine: str, can: frozenset[str]) -> Processor:
    """The first target that runs on a machine with these features. Raises MachineCodeError."""
    for one in PROCESSORS.get(machine, ()):
        if one.needs <= can:
            return one
    raise MachineCodeError(f"no machine code can be made for {machine}; WINGLINE_KERNELS=python runs without")


@cache
def machine_code() -> Any:
    """The extension module with all kernels. Raises MachineCodeError."""
    file = str(path())
    loader = ExtensionFileLoader("kernels", file)
    content = path().read_bytes()
    if checksum(content[:-CHECKSUM_SIZE]) != content[-CHECKSUM_SIZE:]:  # the system would kill this process
        raise MachineCodeError(f"the filters' machine code is damaged: {file}; {REPAIR}")
    try:
        module: Any = module_from_spec(ModuleSpec("kernels", loader, origin=file))
        loader.exec_module(module)
    except ImportError as error:
        raise MachineCodeError(f"the filters' machine code cannot be loaded ({error}); {REPAIR}") from error
    if module.digest != digest(module.sources.split()):
        raise MachineCodeError(f"the filters' machine code is of other sources than these; {REPAIR}")
    return module


def checksum(content: bytes) -> bytes:
    """The checksum at the end of an extension module's file."""
    return hashlib.sha256(content).digest()


def path() -> Path:
    """The file of this computer's extension module. Raises MachineCodeError if there is none."""
    chosen = processor(platform.machine(), features())
    found = FOLDER / f"{chosen.name}.so"
    if not found.exists():
        here = ", ".join(sorted(other.stem for other in FOLDER.glob("*.so"))) or "none"
        raise MachineCodeError(
            f"the filters have no machine code for this processor, {chosen.name} (there is: {here}); {REPAIR}"
        )
    return found


def digest(sources: Iterable[str], root: Path = ROOT) -> str:
    """SHA-256 over the paths below `root` and bytes of sources; a missing file is empty."""
    found = hashlib.sha256()
    for name in sources:
        try:
            content = (root / name).read_bytes()
        except FileNotFoundError:
            content = b""
        found.update(f"{name}\0{len(content)}\0".encode() + content)
    return found.hexdigest()
