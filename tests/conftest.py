"""What every run of the tests does first: kernels that fit their sources, and the longest files in front."""

import os
from pathlib import Path

import pytest

from tests.support import kernels

# The longest files first, as measured, so that two workers end together. Of no matter but for the time it takes.
LONGEST: tuple[str, ...] = ()


def pytest_configure(config: pytest.Config) -> None:
    if _leads(config):
        kernels.prepare(all_at_once=bool(config.getoption("numprocesses", None)))
        config.stash[SOURCES] = kernels.digest()


def pytest_unconfigure(config: pytest.Config) -> None:
    if SOURCES in config.stash:
        kernels.keep(config.stash[SOURCES])


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    order = {name: k for k, name in enumerate(LONGEST)}
    items.sort(key=lambda item: order.get(Path(item.path).name, len(order)))


SOURCES = pytest.StashKey[str]()


def _leads(config: pytest.Config) -> bool:
    """Whether this process starts the tests (xdist's workers do not), and they use the compiler."""
    return not hasattr(config, "workerinput") and os.environ.get("NUMBA_DISABLE_JIT", "0") == "0"
