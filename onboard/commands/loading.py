"""Load modules without the garbage collector, and let it leave them alone afterwards."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager


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
