"""How long a fresh Python takes to its first estimate, and what of it is for which part."""

import statistics
import subprocess
import sys
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
    """Seconds: from the process's start to its end after one prediction and update; and the import of the pipeline
    alone."""

    warm_s: float
    import_pipeline_s: float


def measure(runs: int = 5) -> StartUp:
    """Medians of `runs` processes one after the other."""
    imports = statistics.median(float(_run(PIPELINE)) for _ in range(runs))
    return StartUp(statistics.median(_seconds(FIRST_ESTIMATE) for _ in range(runs)), imports)


def _seconds(program: str) -> float:
    start = perf_counter()
    _run(program)
    return perf_counter() - start


def _run(program: str) -> str:
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, capture_output=True, text=True, check=True)  # noqa: S603 - ours
    return done.stdout
