"""A socket is read in groups: where more waits than there is time for, samples of the IMU and other aircraft's
reports are left out, the oldest first, and nothing else is."""

import asyncio
import random
import socket
from itertools import pairwise
from typing import Any

import pytest

from onboard.config import Config
from onboard.links import udp
from onboard.links.udp import oldest_surplus
from onboard.messages import Datagram, LinkHealth
from onboard.pipeline import Pipeline, Rim
from onboard.sinks.console import ConsoleLines
from onboard.wire.mavlink.frame import V1, V2
from onboard.wire.surplus import IMU_RANK, NEEDED_RANK, SURPLUS_KINDS, TRAFFIC_RANK, surplus
from tests.support.running_link import until, with_link

HEARTBEAT, ATTITUDE, HIGHRES_IMU, ADSB_VEHICLE = 0, 30, 105, 246


def frame(number: int, count: int = 0, *, signed: bool = False) -> bytes:
    head = bytes([V2, 4, int(signed), 0, 0, 1, 1]) + number.to_bytes(3, "little")
    return head + count.to_bytes(4, "little") + bytes(15 if signed else 2)


def count_of(datagram: Datagram) -> int:
    return int.from_bytes(datagram.data[10:14], "little")


@pytest.mark.parametrize("signed", [False, True])
def test_what_may_be_left_out(signed: bool) -> None:
    ranks = {number: surplus(frame(number, signed=signed)) for number in range(1000)}
    assert {number: rank for number, rank in ranks.items() if rank} == SURPLUS_KINDS
    assert (ranks[HIGHRES_IMU], ranks[ADSB_VEHICLE]) == (IMU_RANK, TRAFFIC_RANK)
    assert surplus(bytes([V1, 4, 0, 1, 1, HIGHRES_IMU]) + bytes(6)) == IMU_RANK


def test_a_datagram_of_several_frames_is_needed_and_so_is_what_is_none() -> None:
    assert surplus(frame(HIGHRES_IMU) + frame(ATTITUDE)) == NEEDED_RANK
    for data in (b"", b"\xfd", frame(HIGHRES_IMU)[:9], frame(HIGHRES_IMU)[:-1], bytes(30)):
        assert surplus(data) == NEEDED_RANK


def test_the_oldest_of_the_greatest_rank_go_first_with_seed_3() -> None:
    assert oldest_surplus([1, 2, 0, 1, 2, 0], 6) == set()
    assert oldest_surplus([1, 2, 0, 1, 2, 0], 5) == {1}
    assert oldest_surplus([1, 2, 0, 1, 2, 0], 3) == {0, 1, 4}
    assert oldest_surplus([1, 2, 0, 1, 2, 0], 0) == {0, 1, 3, 4}
    ranks = random.Random(3).choices((0, 1, 2), k=500)
    assert len(oldest_surplus(ranks, 400)) == 100


def flooded(kinds: list[int]) -> tuple[list[Datagram], int]:
    """What a link delivers of these frames, numbered from 0, all of which wait when it begins to read; how many it
    has left out."""
    found: list[Datagram] = []
    shed = 0

    async def test(link: Any, received: list[Datagram]) -> None:
        nonlocal shed
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            for k, kind in enumerate(kinds):
                sender.sendto(frame(kind, k), link.address)
        await until(lambda: link.received + link.shed == len(kinds))
        found.extend(received)
        shed = link.health().shed

    with_link("udpin:127.0.0.1:0", test, surplus=surplus)
    return found, shed


def test_in_a_flood_of_the_imu_all_else_arrives_and_the_newest_samples() -> None:
    kinds = [ATTITUDE if k % 20 == 0 else HIGHRES_IMU for k in range(1000)]
    found, shed = flooded(kinds)
    needed = [k for k, kind in enumerate(kinds) if kind == ATTITUDE]
    newest = [k for k, kind in enumerate(kinds) if kind == HIGHRES_IMU][-udp.MIN_SURPLUS_COUNT :]
    assert [count_of(d) for d in found] == sorted(needed + newest), "in the order of arrival"
    assert shed == 1000 - len(found)


@pytest.mark.parametrize(("waiting", "delivered"), [(0, 128), (128, 128), (129, 127), (256, 64), (1024, 16)])
def test_the_later_we_are_the_fewer_are_delivered_so_that_we_are_late_no_longer(
    waiting: int, delivered: int
) -> None:
    assert udp.delivered_of([(IMU_RANK, None, None)] * waiting) == delivered
    assert (
        udp.delivered_of([(NEEDED_RANK, None, None)] * 200 + [(IMU_RANK, None, None)] * 824)
        == 200 + udp.MIN_SURPLUS_COUNT
    )


def test_other_aircraft_are_left_out_before_the_imu() -> None:
    found, _ = flooded([ADSB_VEHICLE] * 900 + [HIGHRES_IMU] * 100)
    assert [count_of(d) for d in found] == list(range(1000 - udp.MIN_SURPLUS_COUNT, 1000))
    found, _ = flooded([HIGHRES_IMU] * 100 + [ADSB_VEHICLE] * 900)
    assert [count_of(d) for d in found] == list(range(100 - udp.MIN_SURPLUS_COUNT, 100))


def test_nothing_else_is_ever_left_out() -> None:
    found, shed = flooded([HEARTBEAT] * 1000)
    assert ([count_of(d) for d in found], shed) == (list(range(1000)), 0)


def test_others_have_their_turn_while_a_group_is_delivered() -> None:
    """An image that comes over another link waits for sixteen datagrams, not for all."""
    turns: list[int] = []

    async def test(link: Any, received: list[Datagram]) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            for k in range(udp.BURST_SIZE):
                sender.sendto(frame(ATTITUDE, k), link.address)
        while len(received) < udp.BURST_SIZE:
            turns.append(len(received))
            await asyncio.sleep(0)
        assert [count_of(d) for d in received] == list(range(udp.BURST_SIZE))

    with_link("udpin:127.0.0.1:0", test, surplus=surplus)
    steps = [b - a for a, b in pairwise(turns)]
    assert max(steps) <= udp.TURN_SIZE
    assert sum(step > 0 for step in steps) >= udp.BURST_SIZE // udp.TURN_SIZE - 1


def arriving(kinds: list[int], *, waits: bool = False) -> tuple[list[int], list[int]]:
    """What a link has delivered of frames that come one by one, by their numbers: before the last one, and then;
    if it `waits`, only once all have come."""
    found: tuple[list[int], list[int]] = [], []

    async def test(link: Any, received: list[Datagram]) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            for k, kind in enumerate(kinds):
                found[0][:] = map(count_of, received)
                sender.sendto(frame(kind, k), link.address)
                for _ in range(20):  # turns of the event loop
                    await asyncio.sleep(0)
        if waits:
            await until(lambda: len(received) == len(kinds))
        found[1].extend(map(count_of, received))

    with_link("udpin:127.0.0.1:0", test, surplus=surplus)
    return found


def test_samples_of_the_imu_wait_for_what_is_needed_and_go_before_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(udp, "GATHER_TIME_S", 3600.0)
    assert arriving([HIGHRES_IMU, HIGHRES_IMU, ATTITUDE]) == ([], [0, 1, 2])
    assert arriving([ATTITUDE, HIGHRES_IMU, ATTITUDE]) == ([0], [0, 1, 2])


def test_samples_of_the_imu_that_nothing_follows_come_by_themselves() -> None:
    assert arriving([HIGHRES_IMU] * 2, waits=True)[1] == [0, 1]


def test_that_something_is_left_out_is_reported_once() -> None:
    lines: list[str] = []
    console, pipeline = ConsoleLines(lines.append, pilot=lambda _: None), Pipeline(Config())
    for second, shed in enumerate((0, 10, 20)):
        rim = Rim(links={"a": LinkHealth(received=1, sent=0, errors=0, shed=shed)})
        console.show_health(pipeline.health(second * 10**9, rim))
    (line,) = [line for line in lines if "link a" in line]
    assert "link a: too many messages; 10 were left out" in line
