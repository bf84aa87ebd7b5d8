"""Load modules without the garbage collector, and let it leave them alone afterwards; give the compiler's memory
back."""

import ctypes
import gc
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

# a mapping of the compiler's library that nobody writes to, and how much of it this process has for itself
MAPPED: Final = re.compile(
    r"^([0-9a-f]+)-([0-9a-f]+) r-.p .*/libllvmlite\b.*\n(?:\w+:.*\n)*?Anonymous: +(\d+) kB", re.MULTILINE
)
MADV_DONTNEED: Final = 4


@contextmanager
def loading() -> Iterator[None]:
    """Whatever is made in this block is taken to stay until the process ends.

    The collector would run some three hundred times while the modules of a flight load, an eighth of that time; in
    flight it would go through all of them now and then, for as long as two images last; and again at the end.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        if was_enabled:
            gc.enable()


def release_compiler(smaps: Path = Path("/proc/self/smaps")) -> int:
    """Give back the memory that holds code of LLVM: 65 MB that were needed to load the kernels, and are not in
    flight. Linux reads what is needed again from the file. The number of bytes, 0 on another system."""
    try:
        maps, library = smaps.read_text(encoding="utf-8"), ctypes.CDLL(None)
    except OSError:
        return 0
    released = 0
    for begin, end, own in MAPPED.findall(maps):
        size = int(end, 16) - int(begin, 16)
        # where the process has pages of its own (relocated addresses), the file does not hold what is in them
        if own == "0" and not library.madvise(
            ctypes.c_void_p(int(begin, 16)), ctypes.c_size_t(size), MADV_DONTNEED
        ):
            released += size
    return released
