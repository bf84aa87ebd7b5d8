"""MAVLink over UDP: whole frames in datagrams.

`udpin` listens, and sends to the address of the last datagram that gave a message: a bridge that restarts on
another port is followed at once. Whether it did, its receiver says: what is garbage, has a wrong checksum, or
lacks the signature that the link wants diverts no reply. Two senders on one port would get the replies in turn:
give each its own link. `udpout` sends first, and receives only from that
address. It sends from one port, kept over restarts: PX4 sends for ever to the first port that it has heard.
"""

import asyncio
import errno
import math
import socket
import struct
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from enum import IntEnum
from functools import partial
from typing import Any, Final
from zlib import crc32

from onboard.links.link import (
    Backlog,
    Deliver,
    Link,
    LinkError,
    NowNs,
    bind,
    close_all,
    keep_connected,
    opened,
    reason_of,
    until_lost,
)
from onboard.messages import Datagram, Encoding, LinkHealth
from onboard.messages.causes import NO_REASON
from onboard.units import NS_PER_S

Surplus = Callable[[bytes], int]
Taken = tuple[int, Datagram, Any]  # a datagram after its `surplus` and before its sender

MAX_DATAGRAM_BYTES: Final = 65_535
RECEIVE_BUFFER_BYTES: Final = 4 << 20  # a second of a flood, if the event loop is late
PASSING: Final = (errno.EAGAIN, errno.ENOBUFS, errno.ECONNREFUSED)  # no room, or nobody listens there yet
BURST_SIZE: Final = 128  # delivered of a group, in ten milliseconds; half as many of a group twice as large
MIN_SURPLUS_COUNT: Final = 16  # delivered of any group
GROUP_SIZE: Final = 1024  # datagrams read together, so that the newest need not wait behind the oldest
GATHER_TIME_S: Final = 0.02  # for which surplus alone waits for more: single datagrams find cold caches
MAX_GATHERED_COUNT: Final = 16  # ... and no more of it
TURN_SIZE: Final = 16  # delivered, or an eighth of those read, before other links have their turn
MAX_SENDER_RATE: Final = 30_000  # datagrams per second: more than any autopilot sends and we can decode
RATE_WINDOW_NS: Final = NS_PER_S
MAX_SENDER_COUNT: Final = 64  # with a budget of their own; all others share one
OUT_PORT, OUT_PORTS = 20_000, 10_000  # that `udpout` sends from: below those that a kernel gives out
ANCILLARY_BYTES: Final = 128  # a time and a count, each with its header


class Option(IntEnum):
    """Linux socket options that Python's `socket` lacks."""

    SO_RCVBUFFORCE = 33  # beyond net.core.rmem_max, for the privileged
    SO_RXQ_OVFL = 40  # the number of datagrams dropped before each one
    SO_TIMESTAMPNS_NEW = 64  # of Linux 5.1: two 64-bit numbers on every machine


class UdpLink(Link):
    """A UDP socket; `address` is its local address once open.

    `surplus` ranks datagrams for omission if more than `BURST_SIZE` wait; rank 0 is never left out. Datagrams that
    have waited `longest_wait_s` in the kernel are left out.
    """

    def __init__(
        self,
        spec: str,
        channel: str,
        host: str,
        port: int,
        *,
        listening: bool,
        encoding: Encoding = Encoding.MAVLINK,
        surplus: Surplus = lambda _: 0,
        longest_wait_s: float = math.inf,
    ) -> None:
        self._encoding, self._surplus = encoding, surplus
        self._backlog = Backlog(longest_wait_s)
        self._emptied_ns: dict[socket.socket, int] = {}  # when no datagram waited in the kernel
        self.channel = channel
        self.dropped = 0
        self.shed = 0
        self._lost: asyncio.Future[str] | None = None
        self.address: Any = None
        self._spec, self._host, self._port, self._listening = spec, host, port, listening
        self._sockets: list[socket.socket] = []  # of each address of the host
        self._via: socket.socket | None = None  # that of the peer, once it has sent something
        self._peer: Any = None
        self._drops: dict[socket.socket, int] = {}  # of the open sockets, beside those that were closed:
        self._dropped_before = 0
        self._buffer_bytes = 0
        self._budget = Budget()
        self._work: dict[socket.socket, Iterator[None]] = {}  # groups that are being read and delivered
        # surplus that waits for others to come, and what ends its waiting
        self._gathered: dict[socket.socket, tuple[list[Taken], asyncio.TimerHandle]] = {}

    def health(self) -> LinkHealth:
        """The link's counts."""
        return LinkHealth(
            received=self.received,
            sent=self.sent,
            errors=self.errors,
            dropped=self.dropped,
            buffer_bytes=self._buffer_bytes,
            shed=self.shed,
            skipped=self._backlog.skipped,
            cause=self.trouble.cause,
            error=self.trouble.words,
        )

    async def open(self) -> None:
        """Bind (udpin) or connect (udpout). Raises LinkError."""
        self._sockets = await opened(self._spec, self._host, self._port, socket.SOCK_DGRAM, self._attach)
        self._via = None
        for sock in self._sockets:
            self._set_up(sock)
        self.address = self._sockets[0].getsockname()

    def _set_up(self, sock: socket.socket) -> None:
        sock.setblocking(False)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
        # Not everywhere: SO_RCVBUFFORCE needs a privilege. Without SO_TIMESTAMPNS_NEW, the time of reading counts
        # as arrival; without SO_RXQ_OVFL, drops are unknown.
        buffer = Option.SO_RCVBUFFORCE, RECEIVE_BUFFER_BYTES
        for option, value in (buffer, (Option.SO_TIMESTAMPNS_NEW, 1), (Option.SO_RXQ_OVFL, 1)):
            with suppress(OSError):
                sock.setsockopt(socket.SOL_SOCKET, option, value)
        self._buffer_bytes = sock.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)

    def _attach(self, sock: socket.socket, address: Any) -> None:
        """Bind (udpin) or connect (udpout) the socket. Raises LinkError."""
        if self._listening:
            bind(self._spec, sock, address)
            return
        with suppress(OSError):  # in use by another link to the same place: any port then
            sock.bind(("", OUT_PORT + crc32(f"{self._host}:{self._port}".encode()) % OUT_PORTS))
        try:
            sock.connect(address)
        except OSError as error:
            raise LinkError(f"{self._spec}: cannot send to it ({error.strerror})") from error

    async def run(self, deliver: Deliver, now_ns: NowNs) -> None:
        """Call `deliver` with each datagram until cancelled.

        Unknown names are asked for repeatedly, and a socket whose network has changed is reopened.
        """
        await keep_connected(self, partial(self._converse, now_ns), deliver, retry=True)

    async def _converse(self, now_ns: NowNs, deliver: Deliver, failed: "asyncio.Future[None]") -> None:
        """Use the sockets until they can send no more, which raises LinkError."""
        if not self._sockets:
            await self.open()
        sockets = self._sockets
        self.trouble = NO_REASON
        loop = asyncio.get_running_loop()
        self._lost = loop.create_future()
        for sock in sockets:
            loop.add_reader(sock, self._readable, sock, deliver, now_ns)
        try:
            await until_lost(self._lost, failed)
        finally:
            for sock in sockets:
                loop.remove_reader(sock)
            self._dropped_before = self.dropped
            self._drops.clear()
            self._emptied_ns.clear()
            self._work.clear()
            for _, timer in self._gathered.values():
                timer.cancel()
            self._gathered.clear()
            close_all(sockets)
        raise LinkError(f"{self._spec}: cannot send to it ({self._lost.result()})")

    def send(self, data: bytes) -> None:
        """Send one datagram to the peer, or from `udpout`, until it answers, to all its addresses."""
        if not self._sockets or (self._listening and self._via is None):
            self.errors += 1
            return
        for sock in [self._via] if self._via in self._sockets else self._sockets:
            self._send(sock, data)

    def _send(self, sock: socket.socket, data: bytes) -> None:
        try:
            if self._listening:
                sock.sendto(data, self._peer)
            else:
                sock.send(data)
        except OSError as error:  # no room, no peer yet: the next one may succeed
            self.errors += 1
            if not self._listening and error.errno not in PASSING and self._lost and not self._lost.done():
                self._lost.set_result(reason_of(error))  # the address that the socket sends from may be gone
        else:
            self.sent += 1

    def _readable(self, sock: socket.socket, deliver: Deliver, now_ns: NowNs) -> None:
        """Read a group of waiting datagrams; called again while a flood waits."""
        if sock not in self._work:
            self._work[sock] = self._drain(sock, deliver, now_ns)
            self._deliver_batch(sock)

    def _deliver_batch(self, sock: socket.socket) -> None:
        """One turn of the group. Images that came meanwhile have theirs before the next one."""
        if sock not in self._work:  # it was closed
            return
        if next(self._work[sock], "done") is None:
            asyncio.get_running_loop().call_soon(self._deliver_batch, sock)
        else:
            self._work.pop(sock, None)

    def _drain(self, sock: socket.socket, deliver: Deliver, now_ns: NowNs) -> Iterator[None]:
        """Deliver a group of waiting datagrams, with a pause after each turn.

        Surplus is left out of a group that is too large, and gathered while a group has little else.
        """
        group, timer = self._gathered.pop(sock, ([], None))
        gathered = len(group)
        for one in self._group(sock, now_ns):
            group.append(one)
            if len(group) % (8 * TURN_SIZE) == 0:
                yield
        if gathered < len(group) < MAX_GATHERED_COUNT and all(rank for rank, _, _ in group):
            loop = asyncio.get_running_loop()
            timer = timer or loop.call_later(GATHER_TIME_S, self._readable, sock, deliver, now_ns)
            self._gathered[sock] = group, timer
            return
        if timer is not None:
            timer.cancel()
        left_out = oldest_surplus([rank for rank, _, _ in group], delivered_of(group))
        self.shed += len(left_out)
        kept = (one for k, one in enumerate(group) if k not in left_out)
        for count, (_, datagram, sender) in enumerate(kept, 1):
            self.received += 1
            before = self._peer, self._via
            self._peer, self._via = sender, sock  # what is answered at once goes to who asked
            if not deliver(datagram):
                self._peer, self._via = before
            if count % TURN_SIZE == 0:
                yield

    def _group(self, sock: socket.socket, now_ns: NowNs) -> Iterator[Taken]:
        """Datagrams that wait in the kernel."""
        needed = 0
        for _ in range(GROUP_SIZE):
            try:
                data, ancillary, _, sender = sock.recvmsg(MAX_DATAGRAM_BYTES, ANCILLARY_BYTES)
            except BlockingIOError:
                self._emptied_ns[sock] = now_ns()
                return
            except OSError:  # udpout: the peer's port was closed at our last send
                self.errors += 1
                return
            # the wait first: where this process is held up in between, it arrived later, not before it was sent
            waited_ns, read_ns = _waited_ns(ancillary), now_ns()
            waited_ns = min(waited_ns, read_ns - self._emptied_ns.get(sock, 0))
            t_recv_ns = read_ns - waited_ns
            self._drops[sock] = _dropped_count(ancillary, self._drops.get(sock, 0))
            self.dropped = self._dropped_before + sum(self._drops.values())
            if not data:
                self.errors += 1
            elif not self._budget.admits(sender, t_recv_ns):
                self.shed += 1
            elif not self._backlog.skips(waited_ns):
                rank = self._surplus(data)
                yield (
                    rank,
                    Datagram(channel=self.channel, encoding=self._encoding, t_recv_ns=t_recv_ns, data=data),
                    sender,
                )
                needed += not rank
                if needed >= BURST_SIZE:
                    return


def delivered_of(group: Sequence[tuple[int, Any, Any]]) -> int:
    """The number of datagrams of a group to deliver, smaller for a larger backlog."""
    needed = sum(not rank for rank, _, _ in group)
    return max(needed + MIN_SURPLUS_COUNT, min(BURST_SIZE, BURST_SIZE * BURST_SIZE // max(len(group), 1)))


def oldest_surplus(ranks: Sequence[int], most: int) -> frozenset[int]:
    """The places in a group to leave out, so that `most` are left.

    The greatest ranks go first, of these the oldest, which come first; those of rank 0 stay.
    """
    excess = max(0, len(ranks) - most)
    return frozenset(sorted((k for k, rank in enumerate(ranks) if rank), key=lambda k: -ranks[k])[:excess])


class Budget:
    """Limit of each sender's datagrams per second of arrivals.

    A flood costs its sender's datagrams; the program only reads what exceeds the limit.
    """

    def __init__(self) -> None:
        self._since_ns = 0
        self._counts: Counter[Any] = Counter()

    def admits(self, sender: Any, t_recv_ns: int) -> bool:
        """Whether a datagram that arrived now is within its sender's budget."""
        if not 0 <= t_recv_ns - self._since_ns < RATE_WINDOW_NS:
            self._since_ns = t_recv_ns
            self._counts.clear()
        whose = sender if sender in self._counts or len(self._counts) < MAX_SENDER_COUNT else None
        self._counts[whose] += 1
        return self._counts[whose] <= MAX_SENDER_RATE


def _waited_ns(ancillary: list[tuple[int, int, bytes]]) -> int:
    """The wait of a datagram in the kernel, ns, by its arrival stamp; 0 without a stamp.

    It is a difference of two readings of one clock, so it is valid for any clock of the program. Somebody may set
    that clock between them: the caller knows the largest possible wait.
    """
    for level, kind, value in ancillary:
        if level == socket.SOL_SOCKET and kind == Option.SO_TIMESTAMPNS_NEW and len(value) == 16:
            seconds, nanoseconds = struct.unpack("qq", value)
            return int(max(time.time_ns() - (seconds * NS_PER_S + nanoseconds), 0))
    return 0


def _dropped_count(ancillary: list[tuple[int, int, bytes]], before: int) -> int:
    """The number of datagrams dropped by the kernel, from its 32-bit count and the last one.

    The kernel sends the count only after the first drop.
    """
    for level, kind, value in ancillary:
        if level == socket.SOL_SOCKET and kind == Option.SO_RXQ_OVFL and len(value) == 4:
            return before + (int(struct.unpack("I", value)[0]) - before) % (1 << 32)
    return before
