"""The time of a new Python process to its first estimate, with and without compiled code."""

import os
import statistics
import subprocess
import sys
import tempfile
from time import perf_counter
from typing import NamedTuple

FIRST_ESTIMATE = """
from onboard.commands.loading import loading
with loading():  # as `onboard run` does
    import numpy as np
    import onboard.pipeline
    from onboard.estimators.leader.config import Config
    from onboard.estimators.leader.hypotheses.belief import make_filter
    from onboard.estimators.leader.image.camera_pose import CameraPose
    from onboard.estimators.leader.image.measurement import measure_wing
    from onboard.ownship import Step
points, still = [(0.0, 0.0), (-0.05, 0.0), (0.05, 0.0)], np.zeros(3)
filter_, pose = make_filter(Config()), CameraPose(np.eye(3), still, still, still)
seen = measure_wing(points, [1e-3] * 3)
state = filter_.advance(filter_.start(seen, pose, None), Step(0.02, still, still, still))
filter_.fuse(filter_.compare(filter_.predict(state), seen, pose))
"""
PIPELINE = """
from time import perf_counter
start = perf_counter()
import onboard.pipeline
print(perf_counter() - start)
"""


class StartUp(NamedTuple):
    """Times in seconds to the end of the process after one prediction and update."""

    cold_s: float  # with kernels still to be compiled
    warm_s: float  # with compiled kernels on disk
    import_pipeline_s: float  # the import of the pipeline alone


def measure(runs: int = 5) -> StartUp:
    """Measure one cold run, then medians of `runs` processes, one after the other."""
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "NUMBA_CACHE_DIR": folder}
        cold = _seconds(FIRST_ESTIMATE, environment)
        warm = statistics.median(_seconds(FIRST_ESTIMATE, environment) for _ in range(runs))
        imports = statistics.median(float(_run(PIPELINE, environment)) for _ in range(runs))
    return StartUp(cold, warm, imports)


def _seconds(program: str, environment: dict[str, str]) -> float:
    start = perf_counter()
    _run(program, environment)
    return perf_counter() - start


def _run(program: str, environment: dict[str, str]) -> str:
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)  # noqa: S603 - ours
    return done.stdout
