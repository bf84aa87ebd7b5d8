"""`onboard check`: whether this computer, the autopilot and the camera are ready for a flight, one line each."""

import argparse

from onboard.compiled.machine import MachineCodeError
from onboard.terminal.output import show

READY, NOT_READY = 0, 1


def main(arguments: argparse.Namespace) -> int:
    """Print a line for each thing that a flight needs. Exit code 0: all is there. Raises UserError."""
    try:
        from onboard.commands.readiness import Finding, check, load  # noqa: PLC0415 - it loads the filters

        config = load(arguments.config, tuple(arguments.set))
    except MachineCodeError as error:
        show(f"FAIL filters     {error}")
        return NOT_READY
    show(str(Finding.fine("filters", "their machine code is there")))
    return READY if check(config, arguments.wait, show) else NOT_READY
