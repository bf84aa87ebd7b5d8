"""A study on a Dask cluster: a scheduler and two workers as processes of their own, on loopback, of which one is
killed in mid-study."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from onboard.analysis.parallel import cluster
from onboard.analysis.parallel.cluster import ClusterError, fingerprint
from onboard.analysis.parallel.workers import Computers, Part, compute
from tests.support.programs import ROOT

pytest.importorskip("distributed", reason="needs Dask: the extra `cluster`")
PARTS = 60
ENVIRONMENT = os.environ | {"PYTHONPATH": str(ROOT), "DASK_DISTRIBUTED__DASHBOARD__LINK": ""}


def drawn(seed: int, seconds: float = 0.05) -> list[float]:
    """Some work that a seed decides."""
    time.sleep(seconds)
    return np.random.default_rng(seed).normal(size=3).tolist()


class Running(NamedTuple):
    """A cluster: its scheduler's address, and its workers."""

    address: str
    workers: list["subprocess.Popen[bytes]"]


def start(*arguments: str) -> "subprocess.Popen[bytes]":
    return subprocess.Popen(
        [sys.executable, "-m", "distributed.cli." + arguments[0], *arguments[1:]],
        env=ENVIRONMENT,
        cwd=ROOT,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


@contextmanager
def running(folder: Path, count: int) -> Iterator[Running]:
    file = folder / "scheduler.json"
    scheduler = start(
        "dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(file)
    )
    workers: list[subprocess.Popen[bytes]] = []
    try:
        end = time.monotonic() + 60
        while not (file.exists() and file.read_text("utf-8").strip().endswith("}")) and time.monotonic() < end:
            time.sleep(0.1)
        (address,) = [line.split('"')[3] for line in file.read_text("utf-8").splitlines() if '"address"' in line][
            :1
        ]
        common = (address, "--host", "127.0.0.1", "--no-nanny", "--nthreads", "1", "--no-dashboard")
        workers += [start("dask_worker", *common, "--local-directory", str(folder)) for _ in range(count)]
        yield Running(address, workers)
    finally:
        for process in (*workers, scheduler):
            process.kill()
            process.wait()


def test_a_lost_worker_s_parts_are_computed_again_and_all_is_the_same(tmp_path: Path) -> None:
    parts = [Part(drawn, (seed,)) for seed in range(PARTS)]
    alone = compute(parts, Computers(jobs=1, rows=tmp_path / "alone.parquet"))
    killed: list[int] = []

    with running(tmp_path, 2) as found:

        def on_progress(done: int, _total: int) -> None:
            if done >= PARTS // 3 and not killed:
                killed.append(done)
                found.workers[0].send_signal(signal.SIGKILL)

        together = compute(parts, Computers(cluster=found.address, rows=tmp_path / "cluster.parquet"), on_progress)
        assert found.workers[0].wait(10) == -signal.SIGKILL
        assert found.workers[1].poll() is None
    assert killed
    assert together == alone
    assert (tmp_path / "cluster.parquet").read_bytes() == (tmp_path / "alone.parquet").read_bytes()


def test_an_address_without_a_scheduler_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "SCHEDULER_TIMEOUT_S", 1.0)
    with pytest.raises(ClusterError, match=r"there is no Dask scheduler at tcp://127\.0\.0\.1:1\b"):
        compute([Part(drawn, (1,))], Computers(cluster="tcp://127.0.0.1:1"))


def test_the_sources_decide_the_fingerprint(tmp_path: Path) -> None:
    package = tmp_path / "onboard"
    package.mkdir()
    (package / "a.py").write_text("x = 1\n", encoding="utf-8")
    before = fingerprint(["onboard"], tmp_path)
    assert before == fingerprint(["onboard"], tmp_path)
    (package / "a.py").write_text("x = 2\n", encoding="utf-8")
    assert fingerprint(["onboard"], tmp_path) != before
    with pytest.raises(FileNotFoundError, match=r"no studies/ in .*: it is in the source tree only"):
        fingerprint(["onboard", "studies"], tmp_path)
