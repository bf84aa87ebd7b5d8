"""Compile all kernels for one processor into the folder of a wheel.

`python -m release.machine_code PROCESSOR` is started in the tree that becomes the wheel, so that the machine code
names no other place, with Numba set for this processor (`release.wheel`).
"""

import platform
import sys
from pathlib import Path

from onboard.commands import compiling
from onboard.commands.ready import Module
from onboard.filters import shipped
from onboard.filters.shipped import Code


def main(name: str) -> int:
    """Compile, and print the progress."""
    (processor,) = (one for one in shipped.PROCESSORS[platform.machine()] if one.name == name)

    def on_progress(done: int, total: int, _: Module | None) -> None:
        print(f"\r{name}: {done} of {total} modules", end="" if done < total else "\n", flush=True)

    sources = compiling.sources()
    made = compiling.compile_all(into=Code(Path(shipped.FOLDER), processor, sources), on_progress=on_progress)
    loaded = [module.name for module in made if module.loaded and not module.compiled]
    if loaded:
        print(f"already there: {', '.join(loaded)}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
