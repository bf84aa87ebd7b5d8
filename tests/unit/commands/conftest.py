"""Commands that run within the tests leave the tests' own priority as it is."""

import os

import pytest


@pytest.fixture(autouse=True)
def own_priority(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody's priority changes: `onboard run` would raise that of all tests after it."""
    monkeypatch.setattr(os, "setpriority", lambda *_: None)
