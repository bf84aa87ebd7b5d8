"""The queue and the runner: a sink may be slow, stuck or broken, and nobody else notices."""

import asyncio
import errno
import threading
import time
from collections.abc import Awaitable, Callable, Sequence
from contextlib import suppress
from typing import Any

import pytest

from onboard.messages import Cause
from onboard.sinks import BoundedQueue, SinkError, SinkRunner
from onboard.sinks import sink as sinks
from tests.support.running_link import TIMEOUT_S, until


class Collector:
    """A sink that collects records. A write waits for `gate`; opening and writing fail a given number of times."""

    def __init__(self, *, failing_opens: int = 0, failing_writes: int = 0) -> None:
        self.gate = threading.Event()
        self.gate.set()
        self.written: list[int] = []
        self.calls: list[str] = []
        self.failing_opens, self.failing_writes = failing_opens, failing_writes

    def open(self) -> None:
        self.calls.append("open")
        if self.failing_opens:
            self.failing_opens -= 1
            raise SinkError("cannot open")

    def write(self, records: Sequence[int]) -> None:
        self.gate.wait()
        if records and self.failing_writes:
            self.failing_writes -= 1
            raise OSError("disk full")
        self.written += records

    def close(self) -> None:
        self.calls.append("close")


def with_runner(
    sink: Collector, check: Callable[[SinkRunner[int]], Awaitable[None]], capacity: int = 100, **options: Any
) -> SinkRunner[int]:
    async def main() -> SinkRunner[int]:
        runner = SinkRunner("test", sink, capacity, first_retry_s=0.01, **options)
        task = asyncio.create_task(runner.run())
        try:
            await check(runner)
        finally:
            task.cancel()
            with suppress(asyncio.CancelledError):
                await task
        return runner

    return asyncio.run(main())


def test_a_full_queue_drops_its_oldest_and_counts() -> None:
    queue: BoundedQueue[int] = BoundedQueue(3)
    for n in range(10):
        queue.put(n)
    assert queue.take(100, 0.0) == [7, 8, 9]
    assert queue.dropped == 7
    assert queue.take(100, 0.0) == []


def test_every_item_is_either_taken_or_dropped_and_none_twice() -> None:
    """Two threads, a small queue: the count is exact, not nearly so."""
    queue: BoundedQueue[int] = BoundedQueue(4)
    total, taken = 50_000, []

    def consume() -> None:
        while not taken or taken[-1] != total - 1:
            taken.extend(queue.take(3, 0.01))

    consumer = threading.Thread(target=consume)
    consumer.start()
    for n in range(total):
        queue.put(n)
    consumer.join(TIMEOUT_S)
    assert taken == sorted(set(taken))
    assert len(taken) + queue.dropped == total


class Sizes(Collector):
    """Keeps how many records each write has."""

    def __init__(self) -> None:
        super().__init__()
        self.sizes: list[int] = []

    def write(self, records: Sequence[int]) -> None:
        self.sizes.append(len(records))
        super().write(records)


@pytest.mark.parametrize(
    ("gathers_s", "capacity", "most"),
    [
        (0.0, 3000, sinks.MAX_RECORDS),
        (0.01, 20_000, sinks.PIECE_RECORDS),
        (0.01, 3000, sinks.QUEUE_OVERFLOW_FACTOR * sinks.PIECE_RECORDS),
    ],
)
def test_a_sink_that_nobody_waits_for_is_written_in_pieces(gathers_s: float, capacity: int, most: int) -> None:
    """Between them the event loop has the interpreter: it gives it away with each datagram that it reads, and got
    it back after the whole batch. They are larger where records would be lost."""
    sink = Sizes()

    async def check(_: SinkRunner[int]) -> None:
        await until(lambda: len(sink.written) == 3000)

    async def filled(runner: SinkRunner[int]) -> None:
        sink.gate.clear()
        for n in range(3000):
            runner.put(n)
        sink.gate.set()
        await check(runner)

    with_runner(sink, filled, capacity=capacity, gathers_s=gathers_s)
    assert sink.written == list(range(3000))
    assert max(sink.sizes) == most
    if gathers_s:
        assert sum(size == sinks.PIECE_RECORDS for size in sink.sizes) >= 8  # the last ones


def test_what_is_put_is_written_in_order_and_counted() -> None:
    sink = Collector()

    async def check(runner: SinkRunner[int]) -> None:
        for n in range(50):
            runner.put(n)
        await until(lambda: len(sink.written) == 50)

    health = with_runner(sink, check).health()
    assert sink.written == list(range(50))
    assert (health.sent, health.dropped, health.restarts, health.error) == (50, 0, 0, "")
    assert sink.calls == ["open", "close"]


def test_a_sink_that_gathers_writes_all_at_once_and_also_at_the_end() -> None:
    sink = Collector()
    batches: list[list[int]] = []
    write = sink.write

    def keep(records: Sequence[int]) -> None:
        batches.append([*records])
        write(records)

    sink.write = keep

    async def check(runner: SinkRunner[int]) -> None:
        await until(lambda: "open" in sink.calls)
        for n in range(3):
            runner.put(n)
            await asyncio.sleep(0.01)

    runner = with_runner(sink, check, gathers_s=3600.0)
    assert batches == [[0, 1, 2], []]
    assert runner.health().sent == 3


def test_a_sink_that_was_stuck_until_the_end_still_writes_all_that_is_queued() -> None:
    """Several batches wait when it is stopped, whoever is faster: it is let go only after the stop."""
    sink = Collector()
    sink.gate.clear()

    async def check(runner: SinkRunner[int]) -> None:
        await until(lambda: sink.calls)
        for n in range(3000):
            runner.put(n)

        def let_go() -> None:
            runner._stop.wait(TIMEOUT_S)
            sink.gate.set()

        threading.Thread(target=let_go).start()

    runner = with_runner(sink, check, capacity=5000, close_timeout_s=TIMEOUT_S)
    assert sink.written == list(range(3000))
    assert (runner.health().sent, runner.health().dropped) == (3000, 0)


def test_a_blocked_sink_delays_nobody_drops_the_oldest_and_lets_the_program_end() -> None:
    sink = Collector()
    sink.gate.clear()

    async def check(runner: SinkRunner[int]) -> None:
        await until(lambda: sink.calls == ["open"])
        await asyncio.sleep(0.3)  # now it sits in write()
        for n in range(20_000):  # waited for, they would run into the tests' time limit
            runner.put(n)
        assert runner.health().dropped == 20_000 - 100

    with_runner(sink, check, close_timeout_s=0.2)
    sink.gate.set()


def test_a_sink_that_cannot_open_is_retried_and_says_why_meanwhile() -> None:
    sink = Collector(failing_opens=3)
    seen: list[str] = []

    async def check(runner: SinkRunner[int]) -> None:
        runner.put(1)

        def written() -> bool:
            seen.append(runner.health().error)
            return bool(sink.written)

        await until(written)

    health = with_runner(sink, check).health()
    assert sink.written == [1]
    assert (health.sent, health.restarts, health.cause, health.error) == (1, 3, Cause.NONE, "")
    assert "cannot open" in seen
    assert sink.calls == ["open", "close"] * 4


def test_a_write_that_fails_restarts_the_sink_and_counts_what_was_lost() -> None:
    sink = Collector(failing_writes=1)

    async def check(runner: SinkRunner[int]) -> None:
        runner.put(1)
        await until(lambda: runner.health().restarts == 1)
        runner.put(2)
        await until(lambda: sink.written)

    health = with_runner(sink, check).health()
    assert sink.written == [2]
    assert (health.sent, health.dropped, health.restarts) == (1, 1, 1)


def test_a_panic_that_is_no_exception_restarts_the_sink_too() -> None:
    class Panic(BaseException):
        pass

    class Panicking(Collector):
        def write(self, records: Sequence[int]) -> None:
            if records == [1]:
                raise Panic("in Rust")
            super().write(records)

    sink = Panicking()

    async def check(runner: SinkRunner[int]) -> None:
        runner.put(1)
        await until(lambda: runner.health().restarts == 1)
        runner.put(2)
        await until(lambda: sink.written == [2])

    with_runner(sink, check)


def test_a_sink_that_keeps_failing_is_tried_ever_more_slowly_and_the_program_ends() -> None:
    sink = Collector(failing_opens=10**9)

    async def check(_: SinkRunner[int]) -> None:
        await asyncio.sleep(0.5)

    health = with_runner(sink, check).health()
    assert 3 <= health.restarts <= 7  # 10, 20, 40 .. 320 ms; without back-off fifty
    assert (health.cause, health.error) == (Cause.FAILED, "cannot open")


@pytest.mark.parametrize("wrapped", [False, True])
def test_a_full_disk_is_a_cause_of_its_own_whatever_its_words(wrapped: bool) -> None:
    class Full(Collector):
        def open(self) -> None:
            full = OSError(errno.ENOSPC, "kein Platz")
            if not wrapped:
                raise full
            raise SinkError("cannot record to flight.mcap: kein Platz") from full

    async def check(runner: SinkRunner[int]) -> None:
        assert runner.health().cause is Cause.NONE
        await until(lambda: runner.health().restarts)

    assert with_runner(Full(), check).health().cause is Cause.DISK_FULL


def test_the_thread_of_a_sink_has_ended_with_it(monkeypatch: pytest.MonkeyPatch) -> None:
    class Slow(threading.Thread):
        def run(self) -> None:
            super().run()
            time.sleep(0.2)

    monkeypatch.setattr("onboard.sinks.sink.threading.Thread", Slow)

    async def check(_: SinkRunner[int]) -> None:
        await until(lambda: any(isinstance(thread, Slow) for thread in threading.enumerate()))

    with_runner(Collector(), check)
    assert not any(isinstance(thread, Slow) for thread in threading.enumerate())
