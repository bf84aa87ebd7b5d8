"""A test that computes too long is refused, however busy or slow the computer."""

import os
import subprocess
import sys
from pathlib import Path

from tests.support import costs
from tests.support.programs import ROOT


def test_what_computes_too_long_is_refused_and_a_slow_computer_is_no_reason() -> None:
    usual, slow = (lambda: costs.YARDSTICK_S), (lambda: 3.0 * costs.YARDSTICK_S)
    assert costs.too_much(costs.LIMIT_S, usual) is None
    assert "13.0 s of a core" in costs.too_much(13.0, usual)
    assert costs.too_much(13.0, slow) is None
    assert costs.too_much(13.0 * 3.0, slow) == costs.too_much(13.0, usual)
    assert 0.0 < costs.yardstick() < 60.0 * costs.YARDSTICK_S


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
from tests.support import costs

@pytest.fixture(scope="module")
def prepared():
    costs.LIMIT_S = 0.02

def test_a(prepared): pass
def test_b(): sum(range(10**7))
@pytest.mark.slow
def test_c(): sum(range(10**7))
"""


def test_a_run_of_several_processes_fails_for_it_unless_it_is_slow(tmp_path: Path) -> None:
    (tmp_path / "test_long.py").write_text(TESTS, encoding="utf-8")
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-n", "1", "--rootdir", str(ROOT)]
    environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTEST")}
    done = subprocess.run(
        [*command, "-c", str(ROOT / "pyproject.toml"), "-p", "tests.conftest", str(tmp_path)],
        cwd=ROOT,
        env=environment | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert "1 failed, 2 passed" in done.stdout, done.stdout + done.stderr
    assert "FAILED test_long.py::test_b - Failed: 0." in done.stdout
