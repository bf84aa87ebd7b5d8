"""The demo's own parts."""

import contextlib
import signal
from pathlib import Path

import pytest
from rich.console import Console

from onboard.commands import demo_flight
from onboard.commands.compiling import Module
from onboard.commands.processes import DemoError, interruptions
from onboard.commands.progress import announce_once


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_an_interruption_that_is_lost_is_heeded_all_the_same(number: signal.Signals) -> None:
    """As one raised while an object is finalised is: Python prints it and goes on."""
    ours = signal.getsignal(number)
    before = signal.default_int_handler
    signal.signal(number, before)  # under nohup SIGHUP would be ignored
    try:
        with interruptions() as heed:
            heed()
            with contextlib.suppress(KeyboardInterrupt):
                signal.raise_signal(number)
            with pytest.raises(KeyboardInterrupt):
                heed()
        assert signal.getsignal(number) is before
    finally:
        signal.signal(number, ours)


def test_an_interruption_interrupts() -> None:
    with interruptions(), pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)


def test_compiling_is_announced_once_and_only_if_there_was_something_to_compile() -> None:
    console = Console(record=True, quiet=False, stderr=True)
    on_module = announce_once(console, "this flight", "a minute")
    on_module(Module("there", loaded=3, compiled=0, seconds=0.1, folder=""))
    assert console.export_text(clear=False) == ""
    for _ in range(2):
        on_module(Module("new", loaded=0, compiled=3, seconds=9.0, folder=""))
    assert console.export_text().count("compiling what this flight needs (a minute on two cores, once)") == 1


def test_a_scenario_with_pictures_flies_with_the_example_of_its_name_or_says_what_is_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = demo_flight._example("pictures-tag")
    assert found is not None
    assert found.name == "tag.py"
    assert demo_flight._example("formation") is None
    monkeypatch.setattr(demo_flight, "__file__", str(tmp_path / "onboard" / "commands" / "demo_flight.py"))
    with pytest.raises(DemoError, match="scenario pictures needs --detector, such as"):
        demo_flight._example("pictures")
