"""After a fault has passed, estimates are valid again within 5 s of flight, without a restart.

That a Zenoh router which dies and returns is found again: tests/peers/test_fleet.py."""

import numpy as np
import pytest
from msgspec.structs import replace

from onboard.links import link, tcp
from onboard.messages import Datagram, Encoding
from tests.support.faulty_flight import DATAGRAMS, assert_on_target, flown
from tests.support.streams import EPOCH, Item, S, Stream, encode

WITHIN_S = 5.0
CUT, BACK = EPOCH + 45 * S, EPOCH + 48 * S


def serial(datagrams: list[Datagram]) -> list[Datagram]:
    """The same bytes as they come over a serial line."""
    return [replace(d, encoding=Encoding.MAVLINK_STREAM) for d in datagrams]


@pytest.mark.parametrize("seed", [51, 52])
def test_a_serial_line_that_drops_bytes_with_seed(seed: int) -> None:
    """For three seconds one byte in 50 is lost, so that few frames are whole; in the last of them, all are."""
    rng = np.random.default_rng(seed)
    received = []
    for d in serial(DATAGRAMS):
        share = 0.0 if not CUT <= d.t_recv_ns < BACK else 0.02 if d.t_recv_ns < BACK - S else 1.0
        data = np.frombuffer(d.data, dtype=np.uint8)
        received.append(replace(d, data=data[rng.random(len(data)) >= share].tobytes()))
    run = flown([d for d in received if d.data])
    assert run.rejected["bad_frame"] > 20
    after = [e for e in run.estimates if e.t_ns > BACK - EPOCH]
    first = next(e for e in after if e.valid)
    assert (first.t_ns - (BACK - EPOCH)) * 1e-9 < WITHIN_S
    assert_on_target(run)


def test_a_line_that_is_silent_for_longer_than_an_estimate_is_valid() -> None:
    silent = [d for d in serial(DATAGRAMS) if not CUT <= d.t_recv_ns < BACK]
    run = flown(silent)
    after = [e for e in run.estimates if e.t_ns > BACK - EPOCH]
    first = next(e for e in after if e.valid)
    assert (first.t_ns - (BACK - EPOCH)) * 1e-9 < WITHIN_S
    assert_on_target(run)


def test_an_autopilot_that_reboots() -> None:
    """The second flight is 6 s after the boot when it is first heard."""
    again = encode(
        [Item(i.t_recv_ns + 48 * S, i.message) for i in Stream(t0=6.0, t1=12.0, seed=22, sparse=True).items()]
    )
    run = flown([*DATAGRAMS, *again])
    first = next(e for e in run.estimates if e.valid and e.t_ns < 20 * S)
    assert first.t_ns * 1e-9 - 6.0 < WITHIN_S
    assert_on_target(run)


def test_a_lost_link_is_tried_again_often_enough() -> None:
    assert link.LONGEST_RECONNECT_S + tcp.CONNECT_TIMEOUT_S < WITHIN_S
