"""`python -m studies` is `onboard study`."""

import sys

from onboard.commands.cli import main

sys.exit(main(["study", *sys.argv[1:]]))
