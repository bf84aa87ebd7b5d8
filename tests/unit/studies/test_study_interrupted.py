"""A study that is stopped while it computes: it ends at once, and so do the processes that it started."""

import gc
import math
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

import psutil
import pytest

from onboard.analysis.parallel.processes import processes
from onboard.analysis.parallel.workers import Part, compute

ROOT = Path(__file__).parents[3]
AT_WORK_S = 1.0  # of computing after the start


def test_an_interruption_does_not_wait_for_the_parts() -> None:
    others = set(multiprocessing.active_children())
    parts: list[Future[None]] = []
    with pytest.raises(KeyboardInterrupt), processes(1) as pool:
        _interrupt_at_work(pool, parts)
    assert isinstance(parts[0].exception(), BrokenProcessPool)
    assert set(multiprocessing.active_children()) <= others


@pytest.mark.filterwarnings("error::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_part_that_raises_ends_the_others_and_nothing_is_printed() -> None:
    parts = [Part(math.sqrt, (-1.0,)), *(Part(time.sleep, (10.0,)) for _ in range(20))]
    with pytest.raises(ValueError, match="domain"):
        compute(parts, jobs=2)
    gc.collect()


def _interrupt_at_work(pool: ProcessPoolExecutor, parts: list[Future[None]]) -> None:
    pool.submit(os.getpid).result()  # it has begun
    parts += [pool.submit(time.sleep, 10.0) for _ in range(5)]
    while not parts[0].running():  # the test has a time limit
        time.sleep(0.01)
    raise KeyboardInterrupt


@pytest.mark.parametrize(
    ("what", "number"),
    [
        pytest.param("encounters", signal.SIGTERM, marks=pytest.mark.slow),
        pytest.param("--all", signal.SIGTERM, marks=pytest.mark.slow),
        pytest.param("--all", signal.SIGINT, marks=pytest.mark.slow),
        pytest.param("--all", signal.SIGHUP, marks=pytest.mark.slow),
        pytest.param("--all", signal.SIGKILL, marks=pytest.mark.slow),
    ],
)
def test_a_study_that_is_stopped_leaves_no_process_behind(
    what: str, number: signal.Signals, tmp_path: Path
) -> None:
    command = [sys.executable, "-c", INTERRUPTIBLE, "study", what, "--out", str(tmp_path)]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as it:
        started: list[psutil.Process] = []
        while not _at_work(started):  # the test has a time limit
            assert it.poll() is None
            time.sleep(0.05)
            started = psutil.Process(it.pid).children(recursive=True)
        it.send_signal(number)
        assert it.wait() == (-signal.SIGKILL if number is signal.SIGKILL else 130)
        left = psutil.wait_procs(started, timeout=30.0)[1]
        for process in left:
            process.kill()
        assert it.stderr is not None
        assert "Traceback" not in it.stderr.read()
    assert left == []


COMPUTING = """
import sys, time
from onboard.analysis.parallel.workers import Part, compute
compute([Part(time.sleep, (600.0,))] * 2, jobs=2)
"""


def test_a_killed_program_leaves_no_process_of_its_pool_behind() -> None:
    with subprocess.Popen([sys.executable, "-c", COMPUTING], cwd=ROOT) as it:
        started: list[psutil.Process] = []
        while len(started) < 3:  # two and Python's own; the test has a time limit
            time.sleep(0.05)
            started = psutil.Process(it.pid).children(recursive=True)
        it.kill()
        left = psutil.wait_procs(started, timeout=60.0)[1]
    assert left == []


# as in a terminal: what a shell starts in the background ignores interruptions
INTERRUPTIBLE = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)
from onboard.commands.cli import main
sys.exit(main())
"""


def _at_work(processes: list[psutil.Process]) -> bool:
    """Whether two workers are past their start."""
    try:
        seconds = sorted(p.cpu_times().user for p in processes)
    except psutil.NoSuchProcess:
        return False
    return len(seconds) > 1 and seconds[-2] > AT_WORK_S
