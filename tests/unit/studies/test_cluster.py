"""A study on a Dask cluster: a scheduler and two workers as processes of their own, on loopback, of which one is
killed in mid-study."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

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


@pytest.mark.slow  # beside the following one, whose cluster is none
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


class Future:
    """A part's result, which comes when somebody waits for the second time."""

    def __init__(self, client: "FakeClient", packed: bytes, **options: Any) -> None:
        self.client, self._packed, self._waits = client, packed, 0
        client.asked.append((len(client.waiting), options))
        client.waiting.append(self)

    def result(self, timeout: float) -> Any:
        assert timeout == cluster.WORKER_TIMEOUT_S
        self._waits += 1
        if self._waits == 1 or not self.client.workers:
            raise TimeoutError
        return cluster._run_packed(self._packed)

    def done(self) -> bool:
        return False

    def release(self) -> None:
        self.client.waiting.remove(self)


class FakeClient:
    """Dask's client, as far as it is used: `workers` are threads by worker, `sources` what each has of ours."""

    def __init__(self, workers: dict[str, int], sources: object = None) -> None:
        self.workers, self._sources = workers, sources
        self.waiting: list[Future] = []
        self.asked: list[tuple[int, dict[str, Any]]] = []

    def __call__(self, address: str, **options: Any) -> "FakeClient":
        assert (address, options) == ("tcp://a", {"timeout": cluster.SCHEDULER_TIMEOUT_S, "set_as_default": False})
        return self

    def __enter__(self) -> "FakeClient":
        return self

    def __exit__(self, *_: object) -> None:
        self.left = len(self.waiting)

    def wait_for_workers(self, number: int, timeout: float) -> None:
        if len(self.workers) < number:
            raise TimeoutError(timeout)

    def nthreads(self) -> dict[str, int]:
        return self.workers

    def run(self, function: Callable[..., object], packages: object, on_error: str) -> dict[str, object]:
        assert on_error == "return"
        return {worker: self._sources or function(packages) for worker in self.workers}

    def submit(self, function: object, packed: bytes, **options: Any) -> Future:
        assert function is cluster._run_packed
        return Future(self, packed, **options)


@pytest.mark.parametrize(("threads", "most"), [(1, 16), (5, 40)])
def test_some_parts_wait_at_the_cluster_and_all_come_in_order(
    threads: int, most: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    client = FakeClient({"a": threads, "b": threads})
    monkeypatch.setattr("distributed.Client", client)
    progress: list[tuple[int, int]] = []
    parts = [Part(drawn, (seed, 0.0)) for seed in range(60)]
    found = compute(parts, Computers(cluster="tcp://a"), lambda *counts: progress.append(counts))
    assert found == [drawn(seed, 0.0) for seed in range(60)]
    assert progress == [(done, 60) for done in range(1, 61)]
    assert [waiting for waiting, _ in client.asked] == [min(k, most - 1) for k in range(60)]
    assert all(options == {"pure": False, "retries": 10} for _, options in client.asked)
    assert client.left == 0


@pytest.mark.parametrize(
    ("client", "words"),
    [
        (FakeClient({}), "the scheduler at tcp://a has had no worker for 120 s; start one"),
        (FakeClient({"w": 1}, "0123"), "worker w has other sources of wingline (0123, here .*): install the same"),
        (FakeClient({"w": 1}, FileNotFoundError("none")), "worker w cannot load wingline: none; install the same"),
    ],
)
def test_a_cluster_that_cannot_compute_says_why(
    client: FakeClient, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("distributed.Client", client)
    with pytest.raises(ClusterError, match=words.replace("(0", r"\(0").replace("*)", r"*\)")):
        compute([Part(drawn, (1, 0.0))], Computers(cluster="tcp://a"))


def test_workers_that_are_all_lost_end_the_work(monkeypatch: pytest.MonkeyPatch) -> None:
    client = FakeClient({"w": 1})
    monkeypatch.setattr("distributed.Client", client)

    def lose(*_: int) -> None:
        client.workers = {}

    with pytest.raises(ClusterError, match="the scheduler at tcp://a has lost all its workers; start one"):
        compute([Part(drawn, (seed, 0.0)) for seed in range(20)], Computers(cluster="tcp://a"), lose)


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
