"""`python -m onboard.filters`: compile all filters now, with progress, so that no first call waits for it.

`python -m onboard.filters unscented` compiles one family, and what it needs. The machine code stays on disk.
"""

import sys
from importlib import import_module
from pkgutil import iter_modules

from onboard import filters
from onboard.filters import kernels


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
    for k, name in enumerate(wanted, 1):
        print(f"{k:3} of {len(wanted)}  {name}", flush=True)
        import_module(f"{filters.__name__}.{name}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
