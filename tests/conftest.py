"""What every run of the tests does first: kernels that fit their sources, one thread of linear algebra to each of
several processes, and for them the longest files in front."""

import gc
import os
from collections.abc import Generator

import pytest

from tests.support import costs, kernels, order
from tests.support.programs import STATES


def pytest_configure(config: pytest.Config) -> None:
    os.environ["XDG_STATE_HOME"] = str(STATES)  # not a developer's own
    several = bool(config.getoption("numprocesses", None))
    if several:  # where all cores are busy, the threads of OpenBLAS wait for each other in loops
        os.environ.setdefault("OMP_NUM_THREADS", "1")
    if not hasattr(config, "workerinput") and kernels.are_compiled():  # this process starts the tests
        kernels.prepare()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup(item: pytest.Item) -> Generator[None, None, None]:
    yield from _within_limit(item)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, None, None]:
    yield from _within_limit(item)


def pytest_sessionstart() -> None:
    """Collecting makes objects that stay: to search them for garbage again and again costs a tenth of all time."""
    gc.disable()


def pytest_collection_finish() -> None:
    gc.enable()
    gc.freeze()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if not hasattr(config, "workerinput"):
        return  # one process alone: in the order it was asked for
    items.sort(key=lambda item: order.place(item.nodeid.partition("::")[0]))


def _within_limit(item: pytest.Item) -> Generator[None, None, None]:
    """Refuse what computes too long, where all kernels were compiled before: in a worker. A test's end does not
    count, since there the processes of a whole file end."""
    begin = costs.computed()
    yield
    if hasattr(item.config, "workerinput") and kernels.are_compiled() and not item.get_closest_marker("slow"):
        refused = costs.too_much(costs.computed() - begin)
        if refused:
            pytest.fail(refused, pytrace=False)
