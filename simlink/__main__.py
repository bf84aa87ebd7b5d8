"""`python -m simlink`."""

import sys

from simlink.cli import main

sys.exit(main())
