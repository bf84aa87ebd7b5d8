"""Floods are shed by policy and counted, and the leader's estimates go on.

Sensors over Zenoh have rooms of their own (tests/unit/links/test_zenoh_flood.py), and so has what is recorded
(tests/unit/sinks/test_recorder_flood.py). Names without end: tests/unit/estimators/*/test_*floods.py.
"""

import asyncio
import socket
from typing import Any

import numpy as np
import pytest

from onboard.links import tcp, udp
from onboard.links.udp import Budget
from onboard.messages import Attitude, Datagram, Encoding, Estimate, Heartbeat
from onboard.wire.mavlink.encode import MavlinkEncoder
from tests.support.faulty_flight import DATAGRAMS, assert_on_target, clean
from tests.support.running_link import until, with_link
from tests.support.streams import MS, feed, heartbeat, make_config

BYTES_A_SECOND = 900_000
RUBBISH = 65_000


def of_heartbeats(size: int) -> bytes:
    """Heartbeats of another vehicle."""
    beat = MavlinkEncoder(9, 1).encode(heartbeat(0))
    return beat * (size // len(beat))


def flooded_with_seed_51() -> tuple[list[Datagram], int]:
    """The flight, with a second of heartbeats on TCP and rubbish ten times a second; how many heartbeats."""
    rng = np.random.default_rng(51)
    first = DATAGRAMS[len(DATAGRAMS) // 2].t_recv_ns
    piece = of_heartbeats(BYTES_A_SECOND // 100)
    beats = [datagram("tcp", Encoding.MAVLINK_STREAM, first + 10 * k * MS, piece) for k in range(100)]
    rubbish = [
        datagram(channel, encoding, first + 100 * k * MS, rng.bytes(RUBBISH))
        for k in range(30)
        for channel, encoding in (("udp", Encoding.MAVLINK), ("tcp 2", Encoding.MAVLINK_STREAM))
    ]
    both = sorted([*DATAGRAMS, *beats, *rubbish], key=lambda d: d.t_recv_ns)
    return both, 100 * len(piece) // 21


def datagram(channel: str, encoding: Encoding, t_recv_ns: int, data: bytes) -> Datagram:
    return Datagram(channel=channel, encoding=encoding, t_recv_ns=t_recv_ns, data=data)


def test_heartbeats_at_0_9_mb_a_second_and_rubbish_change_no_estimate_with_seed_51() -> None:
    datagrams, beats = flooded_with_seed_51()
    run = feed(datagrams)
    assert_on_target(run, 1.0)
    assert [e for e in run.outputs if isinstance(e, Estimate)] == clean().estimates
    assert run.rejected["other_system"] + run.rejected["repeated"] == beats > 40_000
    assert run.rejected["bad_frame"] >= 60  # each piece of rubbish, once
    assert not run.pipeline.errors


def test_a_flood_of_one_sender_costs_that_sender_alone() -> None:
    budget = Budget()
    admitted = [budget.admits("flood", 10_000 * k) for k in range(100_000)]  # 100,000 in a second
    assert sum(admitted) == udp.BUDGET
    assert budget.admits("autopilot", 999_999_000)
    assert budget.admits("flood", 1_000_000_000), "a new second"


def test_twenty_thousand_messages_a_second_are_no_flood() -> None:
    budget = Budget()
    assert all(budget.admits("autopilot", 50_000 * k) for k in range(60_000))


def test_any_number_of_senders_shares_one_budget() -> None:
    budget = Budget()
    admitted = sum(budget.admits(port, port) for port in range(100_000))
    assert admitted == udp.BUDGET + udp.SENDERS
    assert len(budget._counts) <= udp.SENDERS + 1


def test_a_clock_that_goes_back_begins_a_new_second(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(udp, "BUDGET", 1)
    budget = Budget()
    assert [budget.admits("a", t) for t in (5_000_000_000, 5_000_000_001, 1)] == [True, False, True]


def test_what_a_socket_sheds_is_counted_and_others_are_heard(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(udp, "BUDGET", 100)
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
        assert max(len(d.data) for d in received) <= tcp.TCP_READ
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
