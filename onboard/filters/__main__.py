"""`python -m onboard.filters`: compile all filters now, with progress, so that no first call waits for it.

`python -m onboard.filters unscented` compiles one family, and what it needs. The machine code stays on disk.
"""

import sys
from importlib import import_module
from itertools import count
from pkgutil import iter_modules
from typing import Final

from onboard import filters
from onboard.filters import kernels
from onboard.filters.numba_internals import on_compile

FUNCTIONS_A_DOT: Final = 10


def main(names: list[str]) -> int:
    """Import the named modules of the package, or all, and so compile them; exit code 2 for any other."""
    known = [found.name for found in iter_modules(filters.__path__) if not found.name.startswith("_")]
    unknown = [name for name in names if name not in known]
    if unknown:
        print(f"no family named {', '.join(unknown)}; there are: {', '.join(known)}", file=sys.stderr)
        return 2
    # kernels first: they take nearly all the time, and each family then only loads them
    inner = [] if names else [f"kernels.{found.name}" for found in iter_modules(kernels.__path__)]
    wanted = [*inner, *(names or known)]
    print("compiling the filters for this computer, once; all take one to three minutes of a core", flush=True)
    functions = count(1)

    def dot() -> None:
        if not next(functions) % FUNCTIONS_A_DOT:
            print(end=".", flush=True)

    on_compile(dot)
    for k, name in enumerate(wanted, 1):
        print(end=f"{k:3} of {len(wanted)}  {name} ", flush=True)
        import_module(f"{filters.__name__}.{name}")
        print()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
