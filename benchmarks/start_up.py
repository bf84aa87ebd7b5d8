"""How long a fresh Python needs to import the pipeline."""

import statistics
import subprocess
import sys
from typing import NamedTuple

PROGRAM = """
from time import perf_counter
start = perf_counter()
import numpy
numpy_done = perf_counter()
import onboard.pipeline
print(numpy_done - start, perf_counter() - numpy_done)
"""


class StartUp(NamedTuple):
    """Medians, milliseconds: numpy, which everything needs, and what the pipeline adds to it."""

    numpy_ms: float
    pipeline_ms: float


def measure(runs: int = 7) -> StartUp:
    """Import in `runs` processes, one after the other."""
    rows = [_once() for _ in range(runs)]
    numpy, pipeline = (statistics.median(column) for column in zip(*rows, strict=True))
    return StartUp(1e3 * numpy, 1e3 * pipeline)


def _once() -> tuple[float, float]:
    command = [sys.executable, "-c", PROGRAM]
    output = subprocess.run(command, capture_output=True, text=True, check=True)  # noqa: S603 - our own program
    numpy, pipeline = (float(number) for number in output.stdout.split())
    return numpy, pipeline
