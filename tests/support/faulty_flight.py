"""A synthetic flight of 9 s as messages and bytes, to which faults are applied.

Own motion comes at 25 Hz and images at 12.5 Hz, half the usual rates, to halve the cost.
"""

from functools import cache

from onboard.messages import Datagram, Lifecycle, TargetPoints
from onboard.pipeline import Pipeline
from tests.support.beginnings import Beginning
from tests.support.streams import Run, Stream, assert_sane, encode, position_error

T0, T1 = 43.0, 52.0
OWN_RATE_HZ = 25


ITEMS = Stream(t0=T0, t1=T1, seed=21, sparse=True).items()
DATAGRAMS = encode(ITEMS)
SHARED = Beginning(DATAGRAMS, Pipeline.feed)  # the seconds before a fault
IMAGES = sum(isinstance(i.message, TargetPoints) for i in ITEMS)


def flown(datagrams: list[Datagram]) -> Run:
    """The pipeline's run over these datagrams; every estimate is sane."""
    run = SHARED.run(datagrams)
    assert not run.pipeline.errors, run.pipeline.errors
    assert_sane(run.estimates)
    return run


def assert_on_target(run: Run, within: float = 2.0) -> None:
    """The run ends tracking, with a position error below `within` (m)."""
    last = run.estimates[-1]
    assert last.valid
    assert last.state is Lifecycle.TRACKING
    assert position_error(last) < within


@cache
def clean() -> Run:
    """The run without faults."""
    return flown(DATAGRAMS)
