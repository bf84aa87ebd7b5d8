"""A plugin of pytest for `tests.mutants.matrix`: runs the chosen tests and writes what became of each at once.

`-p tests.mutants.observed`. The file `CHOSEN` in the working directory names the tests, one a line, in their
order; without it all run. `OBSERVED` gets one line of JSON when a test begins and one when a part of it ends.
"""

import json
from pathlib import Path
from typing import Final

import pytest

CHOSEN: Final = Path(".chosen")
OBSERVED: Final = Path(".observed")


def _write(test: str, outcome: str, seconds: float) -> None:
    with OBSERVED.open("a", encoding="utf-8") as file:
        file.write(json.dumps([test, outcome, seconds]) + "\n")


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    if CHOSEN.exists():
        place = {test: k for k, test in enumerate(CHOSEN.read_text(encoding="utf-8").splitlines())}
        items[:] = sorted((i for i in items if i.nodeid in place), key=lambda item: place[item.nodeid])


def pytest_collectreport(report: pytest.CollectReport) -> None:
    if report.failed:
        _write(report.nodeid, "failed", 0.0)


def pytest_runtest_logstart(nodeid: str) -> None:
    _write(nodeid, "begun", 0.0)


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    _write(report.nodeid, report.outcome, report.duration)
