"""Floods are shed by policy and counted, and the leader's estimates go on.

Sensors over Zenoh have rooms of their own (tests/unit/links/test_zenoh_flood.py), and so has what is recorded
(tests/unit/sinks/test_recorder_flood.py). Names without end: tests/unit/estimators/*/test_*floods.py.
"""

import asyncio
import socket
from typing import Any

import pytest

from onboard.links import tcp, udp
from onboard.links.udp import Budget
from onboard.messages import Attitude, Datagram, Heartbeat
from onboard.wire.mavlink.encode import MavlinkEncoder
from tests.support.faulty_flight import DATAGRAMS
from tests.support.running_link import until, with_link
from tests.support.streams import MS, feed, heartbeat, make_config


def of_heartbeats(size: int) -> bytes:
    """Heartbeats of another vehicle."""
    beat = MavlinkEncoder(9, 1).encode(heartbeat(0))
    return beat * (size // len(beat))


def test_a_flood_of_one_sender_costs_that_sender_alone() -> None:
    budget = Budget()
    admitted = [budget.admits("flood", 10_000 * k) for k in range(100_000)]  # 100,000 in a second
    assert sum(admitted) == udp.MAX_SENDER_RATE
    assert budget.admits("autopilot", 999_999_000)
    assert budget.admits("flood", 1_000_000_000), "a new second"


def test_any_number_of_senders_shares_one_budget() -> None:
    budget = Budget()
    admitted = sum(budget.admits(port, port) for port in range(100_000))
    assert admitted == udp.MAX_SENDER_RATE + udp.MAX_SENDER_COUNT
    assert len(budget._counts) <= udp.MAX_SENDER_COUNT + 1


def test_a_clock_that_goes_back_begins_a_new_second(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(udp, "MAX_SENDER_RATE", 1)
    budget = Budget()
    assert [budget.admits("a", t) for t in (5_000_000_000, 5_000_000_001, 1)] == [True, False, True]


def test_what_a_socket_sheds_is_counted_and_others_are_heard(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(udp, "MAX_SENDER_RATE", 100)
    beat = MavlinkEncoder(1, 1).encode(heartbeat(0))

    async def test(link: Any, received: list[Datagram]) -> None:
        with (
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as flood,
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as autopilot,
        ):
            for _ in range(300):
                flood.sendto(b"\xfe" + bytes(20), link.address)
            autopilot.sendto(beat, link.address)
            await until(lambda: any(d.data == beat for d in received))
        await until(lambda: link.received + link.shed == 301)
        assert link.health().shed == link.shed >= 100  # a second may have begun meanwhile
        assert len(received) == link.received == 301 - link.shed

    with_link("udpin:127.0.0.1:0", test)


def test_a_tcp_peer_that_floods_leaves_turns_to_other_links() -> None:
    flood = of_heartbeats(1_000_000)

    async def test(link: Any, received: list[Datagram]) -> None:
        reader, writer = await asyncio.open_connection(*link.address)
        writer.write(flood)
        await until(lambda: sum(len(d.data) for d in received) == len(flood))
        assert max(len(d.data) for d in received) <= tcp.READ_BYTES
        writer.close()
        del reader

    with_link("tcpin:127.0.0.1:0", test)


def test_the_health_of_a_flooded_stream_is_that_of_its_last_seconds() -> None:
    """Its window is trimmed, not summed up: at 100,000 messages a second that took 20 ms each second."""
    run = feed(DATAGRAMS, make_config("estimator={}"))
    last = DATAGRAMS[-1].t_recv_ns
    streams = run.pipeline.health(last).streams
    assert streams["Attitude"].rate == pytest.approx(25, abs=1)
    assert run.pipeline.health(last + 1_500 * MS).streams["Attitude"].rate == pytest.approx(6.25, abs=1)
    later = run.pipeline.health(last + 5_000 * MS).streams["Attitude"]
    assert (later.rate, later.count) == (0.0, streams["Attitude"].count)
    assert later.age == pytest.approx(5.0, abs=0.05)
    assert len(run.pipeline._monitor._streams[Attitude]._window) == 1
    assert Heartbeat.__name__ in streams
