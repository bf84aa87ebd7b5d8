"""`python -m onboard` is the `onboard` command."""

import sys

from onboard.commands.cli import main

sys.exit(main())
