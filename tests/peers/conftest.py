"""A Zenoh session of vehicle 1, and where it listens."""

from collections.abc import Iterator
from typing import Any

import pytest

from onboard.sinks.zenoh_session import ZenohConfig, open_session
from tests.support.programs import free_endpoint


@pytest.fixture
def endpoint() -> str:
    return free_endpoint()


@pytest.fixture
def session(endpoint: str) -> Iterator[Any]:
    opened = open_session(ZenohConfig(vehicle="1", listen=(endpoint,)))
    yield opened
    opened.close()
