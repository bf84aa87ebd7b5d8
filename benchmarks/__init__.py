"""Ratios against peers, measured in one run on one thread: `python -m benchmarks`."""

import os

for _library in ("OMP", "OPENBLAS", "MKL", "NUMBA"):  # here, before NumPy is imported: it reads them once
    os.environ[f"{_library}_NUM_THREADS"] = "1"
