"""Machine code for the tests is of the sources that stand here; `python -m tests.support.kernels` builds it."""

import os
import subprocess
import sys

from onboard.compiled import MODE
from tests.support.programs import ROOT


def are_compiled() -> bool:
    """Whether the tests run machine code, and not the same kernels in Python."""
    return MODE == "machine"


def prepare() -> None:
    """Build what is missing, or of other sources. Raises CalledProcessError."""
    command = [sys.executable, "-m", "onboard.compiled"]
    subprocess.run(command, cwd=ROOT, env=os.environ | {"PYTHONPATH": str(ROOT)}, check=True)


if __name__ == "__main__":
    prepare()
