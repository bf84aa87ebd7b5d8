"""`python -m onboard` is the `onboard` command, and so is the program of that name."""

import sys

from onboard.terminal.output import end_at_once

RUNS_FOR_HOURS = ("run", "router")  # for a service manager, which may stop them while they still load


def main() -> int:
    """Heed signals first, then load the command line and run it; the exit code."""
    if sys.argv[1:2] and sys.argv[1] in RUNS_FOR_HOURS:
        end_at_once()
    from onboard.commands import cli  # noqa: PLC0415 - loading takes longer than all before it

    return cli.main()


if __name__ == "__main__":
    sys.exit(main())
