"""What has waited in this program for too long is left out, down to the newest, and counted."""

import asyncio
import socket
from contextlib import suppress

import pytest

from onboard.links import udp
from onboard.links.link import Backlog
from onboard.links.udp import UdpLink
from onboard.messages import Datagram
from tests.support.running_link import until

MS = 1_000_000
HOUR = 3_600_000 * MS


@pytest.mark.parametrize(
    ("waited_ms", "taken"),
    [
        ([100, 400, 499], [100, 400, 499]),
        ([501, 400, 251, 249, 400, 10], [249, 400, 10]),
        ([8000, 30, 8000, 30], [30, 30]),
    ],
)
def test_a_backlog_is_left_out_down_to_half_of_the_longest_wait(waited_ms: list[int], taken: list[int]) -> None:
    backlog = Backlog(0.5)
    assert [w for w in waited_ms if not backlog.skips(w * MS)] == taken
    assert backlog.skipped == len(waited_ms) - len(taken)


def read(waits_ns: list[int], *, emptied_ns: int, monkeypatch: pytest.MonkeyPatch) -> tuple[list[int], UdpLink]:
    """How long (ms) the datagrams that a link delivers have waited, by the kernel's stamps; no datagram waited at
    `emptied_ns` on a clock that shows an hour."""
    found: list[Datagram] = []

    async def main() -> UdpLink:
        link = UdpLink("udpin:127.0.0.1:0", "a", "127.0.0.1", 0, listening=True, longest_wait_s=0.5)
        await link.open()
        link._emptied_ns[link._sockets[0]] = emptied_ns
        stamps = iter(waits_ns)
        monkeypatch.setattr(udp, "_waited_ns", lambda _: next(stamps))
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            for _ in waits_ns:
                sender.sendto(b"x", link.address)
        task = asyncio.create_task(link.run(found.append, lambda: HOUR))
        await until(lambda: len(found) + link.health().skipped == len(waits_ns))
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task
        return link

    link = asyncio.run(main())
    return [(HOUR - d.t_recv_ns) // MS for d in found], link


def test_after_a_long_pause_a_socket_is_read_down_to_its_newest(monkeypatch: pytest.MonkeyPatch) -> None:
    """However long it was: of a wait beyond some seconds nothing was known once, so that all was taken for new."""
    waits = [60_000 * MS - k * 100 * MS for k in range(600)]
    found, link = read(waits, emptied_ns=0, monkeypatch=monkeypatch)
    assert found == [200, 100]
    assert (link.health().skipped, link.received) == (598, 2)


def test_a_wall_clock_that_is_set_makes_no_backlog(monkeypatch: pytest.MonkeyPatch) -> None:
    """The kernel stamps by it, but no datagram waits for longer than since none waited."""
    found, link = read([HOUR] * 3, emptied_ns=HOUR - 40 * MS, monkeypatch=monkeypatch)
    assert found == [40, 40, 40]
    assert link.health().skipped == 0


def test_a_datagram_does_not_arrive_before_it_was_sent_where_its_reader_is_held_up(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A reply to TIMESYNC was taken for another's, as it came before its request. The times are nanoseconds."""
    clock = iter(range(HOUR, 2 * HOUR, 40 * MS))  # each reading of a clock is 40 ms after the one before
    link = UdpLink("udpin:127.0.0.1:0", "a", "127.0.0.1", 0, listening=True, longest_wait_s=0.5)
    monkeypatch.setattr(udp, "_waited_ns", lambda _: next(clock) - HOUR)
    with socket.socket(type=socket.SOCK_DGRAM) as reader, socket.socket(type=socket.SOCK_DGRAM) as sender:
        reader.bind(("127.0.0.1", 0))
        sender.sendto(b"x", reader.getsockname())
        _, datagram, _ = next(link._group(reader, lambda: next(clock)))
    assert datagram.t_recv_ns >= HOUR  # when it was sent
