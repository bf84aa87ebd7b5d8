"""Flights in which the set-up is right are given no advice about it by the daemon's pipeline. The study of
manoeuvres counts such advice in each of its flights.
"""

import gzip

import pytest

from onboard.messages import Severity
from onboard.pipeline import Pipeline
from onboard.wire.logs.tlog import read_tlog
from studies.closed_loop.flight import SET_UP
from tests.replay.test_formation_copter import CAMERA, EXCERPT, recording
from tests.support.streams import make_config

S = 1_000_000_000
OF_A_LOG = SET_UP - {"stamps", "clock"}  # how late images arrive in a log is its recorder's


def advised(log: bytes) -> set[str]:
    """The kinds of advice about the set-up, worse than a notice, over a flight, asked once a second."""
    pipeline, next_ns, found = Pipeline(make_config(CAMERA)), 0, set[str]()
    for datagram, _ in read_tlog(log):
        if datagram is None:
            continue
        pipeline.feed(datagram)
        if datagram.t_recv_ns >= next_ns:
            next_ns = datagram.t_recv_ns + S
            advice = pipeline.health(datagram.t_recv_ns).advice
            found |= {a.cause for a in advice if a.cause in OF_A_LOG and a.severity is not Severity.NOTICE}
    return found


def test_an_excerpt_of_a_formation_is_given_none() -> None:
    """Of its first half."""
    log = gzip.decompress((EXCERPT / "copter.tlog.gz").read_bytes())
    assert advised(log[: len(log) // 2]) == set()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ardupilot_turns_round", "ardupilot_killed", "px4_beside"])
def test_a_recorded_flight_is_given_none(name: str) -> None:
    log = gzip.decompress(recording(f"follow5/{name}.tlog.gz").read_bytes())
    assert advised(log) == set()
