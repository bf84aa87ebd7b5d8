"""The demo's own parts."""

import contextlib
import signal

import pytest

from onboard.demo import _interruptions


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_an_interruption_that_is_lost_is_heeded_all_the_same(number: signal.Signals) -> None:
    """As one raised while an object is finalised is: Python prints it and goes on."""
    before = signal.getsignal(number)
    with _interruptions() as heed:
        heed()
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(number)
        with pytest.raises(KeyboardInterrupt):
            heed()
    assert signal.getsignal(number) is before


def test_an_interruption_interrupts() -> None:
    with _interruptions(), pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)
