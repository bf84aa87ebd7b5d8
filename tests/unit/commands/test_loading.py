"""What a flight loads is out of the garbage collector's way, from the start."""

import gc
from collections.abc import Iterator

import pytest

from onboard.commands.cli import main
from onboard.commands.loading import loading
from onboard.daemon import Daemon


@pytest.fixture(autouse=True)
def collector() -> Iterator[None]:
    """The collector as it was."""
    yield
    gc.enable()
    gc.unfreeze()


def test_the_collector_rests_while_modules_load_and_leaves_them_alone_afterwards() -> None:
    gc.unfreeze()
    with loading():
        assert not gc.isenabled()
        made = [[] for _ in range(1000)]  # type: ignore[var-annotated]  # of anything
    assert gc.isenabled()
    assert gc.get_freeze_count() > len(made)


def test_one_that_was_off_stays_off() -> None:
    gc.disable()
    with loading():
        pass
    assert not gc.isenabled()


def test_it_works_again_after_an_error() -> None:
    with pytest.raises(ZeroDivisionError), loading():
        _ = 1 / 0
    assert gc.isenabled()


def test_a_flight_begins_with_all_that_is_loaded_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    gc.unfreeze()
    seen: list[tuple[bool, int]] = []

    async def run(self: Daemon) -> None:
        del self
        seen.append((gc.isenabled(), gc.get_freeze_count()))

    monkeypatch.setattr(Daemon, "run", run)
    assert main(["run"]) == 0
    ((enabled, frozen),) = seen
    assert enabled
    assert frozen > 10_000
