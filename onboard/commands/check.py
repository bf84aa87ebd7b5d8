"""`onboard check`: whether this computer, the autopilot and the camera are ready for a flight, one line each.

This file loads nothing with kernels: what is not compiled yet must be noticed, not compiled for minutes."""

import argparse

from onboard import UserError
from onboard.filters.numba_internals import on_compile
from onboard.terminal.output import show

READY, NOT_READY = 0, 1


class NotCompiledError(UserError):
    """A filter that would fly is not compiled for this computer."""


def main(arguments: argparse.Namespace) -> int:
    """Print a line for each thing that a flight needs. Exit code 0: all is there. Raises UserError."""
    watch = _Refusing()
    on_compile(watch)
    try:
        from onboard.commands.readiness import Finding, check, load  # noqa: PLC0415 - after `on_compile`

        config = load(arguments.config, tuple(arguments.set))
    except NotCompiledError:
        named = f" {arguments.config}" if arguments.config is not None else ""
        show("FAIL compiled    the filters are not compiled for this computer, so nothing else was tried")
        show(f"                 -> onboard compile{named}")
        return NOT_READY
    finally:
        watch.is_active = False
    show(str(Finding.fine("compiled", "the filters' machine code is there")))
    return READY if check(config, arguments.wait, show) else NOT_READY


class _Refusing:
    """Ends what begins to compile, while it is active."""

    is_active = True

    def __call__(self) -> None:
        if self.is_active:
            raise NotCompiledError
