"""Filters in single precision, in Python: no machine code is made for it. The same lines run."""

import os
import re
import subprocess
import sys

from tests.support.programs import ROOT


def test_each_test_of_single_precision_passes_without_the_compiler() -> None:
    files = [
        path for path in (ROOT / "tests").rglob("test_*.py") if "pytest.mark.single" in path.read_text("utf-8")
    ]
    command = [sys.executable, "-m", "pytest", "-q", "-m", "single and not slow", "-p", "no:cacheprovider"]
    done = subprocess.run(
        [*command, "-p", "no:xdist", *files],
        cwd=ROOT,
        env=os.environ | {"WINGLINE_KERNELS": "python", "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-5000:] + done.stderr
    assert int(re.search(r"(\d+) passed", done.stdout)[1]) >= 50
