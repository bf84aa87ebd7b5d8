"""A test that computes too long is refused, however busy or slow the computer."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests import conftest
from tests.support import costs


def test_what_computes_too_long_is_refused_and_a_slow_computer_is_no_reason() -> None:
    usual, slow = (lambda: costs.YARDSTICK_TIME_S), (lambda: 3.0 * costs.YARDSTICK_TIME_S)
    assert costs.too_much(costs.LIMIT_S, usual) is None
    assert "13.0 s of a core" in costs.too_much(13.0, usual)
    assert costs.too_much(13.0, slow) is None
    assert costs.too_much(13.0 * 3.0, slow) == costs.too_much(13.0, usual)
    assert 0.0 < costs.yardstick() < 60.0 * costs.YARDSTICK_TIME_S


def test_computing_is_measured_and_neither_waiting_nor_what_other_processes_compute() -> None:
    before = costs.computed()
    code = "import time; begin = time.process_time()\nwhile time.process_time() < begin + 0.5: pass"
    subprocess.run([sys.executable, "-c", code], check=True)
    between = costs.computed()
    while costs.computed() < between + 0.1:
        pass
    assert between - before < 0.4


TESTS = """
import pytest

def test_a(): pass
def test_b(): sum(range(10**6))
@pytest.mark.slow
def test_c(): sum(range(10**6))
"""


class Worker:
    """A process of several, as xdist's plugin and ours make it."""

    pytest_runtest_setup = staticmethod(conftest.pytest_runtest_setup)
    pytest_runtest_call = staticmethod(conftest.pytest_runtest_call)

    def __init__(self) -> None:
        self.failed: dict[str, str] = {}

    def pytest_configure(self, config: pytest.Config) -> None:
        config.addinivalue_line("markers", "slow: long")
        config.workerinput = {}  # type: ignore[attr-defined]  # xdist's

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed:
            self.failed[report.nodeid.partition("::")[2]] = report.longreprtext


def test_a_run_of_several_processes_fails_for_it_unless_it_is_slow(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "test_some_that_are_long.py").write_text(TESTS, encoding="utf-8")
    worker = Worker()
    without = (f"-p no:{plugin}" for plugin in ("xdist", "cacheprovider", "terminal", "timeout"))
    with monkeypatch.context() as patched:  # this test itself has the usual limit
        patched.setattr(costs, "LIMIT_S", 0.005)
        code = pytest.main(["-c", os.devnull, *" ".join(without).split(), str(tmp_path)], [worker])
    assert code == pytest.ExitCode.TESTS_FAILED
    assert list(worker.failed) == ["test_b"]
    assert worker.failed["test_b"].startswith("0."), worker.failed
