"""The path of records to an output: a bounded queue, a thread, restarts with back-off.

The event loop only appends to a queue, which drops the oldest record when it is full. A sink is opened, written
and closed in its own thread, so that a full disk, a slow viewer or a stalled peer delays nothing else. The thread
is a daemon thread: the process can end while it is stuck in a write.
"""

import asyncio
import errno
import queue
import threading
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from typing import Final, Generic, Protocol, TypeVar

from onboard import UserError
from onboard.messages import SinkHealth
from onboard.messages.causes import Cause

T = TypeVar("T")
In_contra = TypeVar("In_contra", contravariant=True)

IDLE_PERIOD_S: Final = 0.25  # a sink without records is called this often, so that it can flush
MAX_RECORDS: Final = 1024
PIECE_RECORDS: Final = 64  # of an optional sink: a millisecond of the interpreter ...
QUEUE_OVERFLOW_FACTOR: Final = 4  # larger pieces before records are lost
PAUSE_TIME_S: Final = 0.002  # ... after which the event loop has it, which releases it with each datagram
YIELDING_FACTOR: Final = 4  # items that give way are accepted while a queue is filled to less than 1 in this many
MIN_RETRY_DELAY_S: Final = 0.5
MAX_RETRY_DELAY_S: Final = 30.0
SINK_CLOSE_TIMEOUT_S: Final = 3.0


class SinkError(UserError):
    """A sink cannot be opened; the message names the sink, the reason, and a remedy."""


class Sink(Protocol[In_contra]):
    """An output of records; its methods are called in one thread, its own, and may block or raise."""

    def open(self) -> None:
        """Prepare for writing. Called again after each failure."""

    def write(self, records: Sequence[In_contra]) -> None:
        """Write records, oldest first; an empty sequence after a pause is an opportunity to flush."""

    def close(self) -> None:
        """Release all resources. Also called after an `open` that failed."""


class BoundedQueue(Generic[T]):
    """A queue between two threads that drops the oldest item when full.

    Items that give way (`gives_way`) are accepted only while few wait, and have room of their own: they never cost
    another item its place. `put` neither waits nor fails. Each item is either taken or dropped; `dropped` counts
    all dropped items, `dropped_important` those that do not give way.
    """

    def __init__(self, capacity: int, gives_way: Callable[[T], bool] | None = None) -> None:
        if capacity < 1:
            raise ValueError(f"a queue needs room for one item at least, not {capacity}")
        self.dropped = 0
        self.dropped_important = 0
        self._gives_way = gives_way or (lambda _: False)
        self._yielding = capacity // YIELDING_FACTOR if gives_way is not None else 0
        self._capacity = capacity + self._yielding
        self._items: queue.SimpleQueue[T] = queue.SimpleQueue()

    def put(self, item: T) -> None:
        """Append. Call it from the producer's thread only."""
        waiting = self._items.qsize()
        if waiting >= self._yielding and self._gives_way(item):
            self._count(item)
            return
        if waiting >= self._capacity:
            with suppress(queue.Empty):  # the consumer has emptied it meanwhile
                while self._items.qsize() >= self._capacity:
                    self._count(self._items.get_nowait())
        self._items.put(item)

    def important(self, items: Iterable[T]) -> int:
        """Count the items that do not give way to others."""
        return sum(not self._gives_way(item) for item in items)

    def _count(self, dropped: T) -> None:
        self.dropped += 1
        self.dropped_important += not self._gives_way(dropped)

    @property
    def has_room(self) -> bool:
        """Whether three quarters of the queue are free."""
        return 4 * self._items.qsize() < self._capacity

    def take(self, limit: int, timeout: float) -> list[T]:
        """Return up to `limit` items; wait at most `timeout` seconds for the first."""
        items: list[T] = []
        with suppress(queue.Empty):
            items.append(self._items.get(timeout=timeout))
            while len(items) < limit:
                items.append(self._items.get_nowait())
        return items


class SinkRunner(Generic[T]):
    """One sink with its queue; call `put` from the event loop's thread, `run` is the sink's task.

    An optional sink gathers records for `gathers_s` seconds before it writes, since each wake-up of a thread takes
    the interpreter from the event loop, which costs more than the writing. It writes in small pieces.
    """

    def __init__(
        self,
        name: str,
        sink: Sink[T],
        capacity: int,
        *,
        gives_way: Callable[[T], bool] | None = None,
        first_retry_s: float = MIN_RETRY_DELAY_S,
        close_timeout_s: float = SINK_CLOSE_TIMEOUT_S,
        gathers_s: float = 0.0,
    ) -> None:
        self.name = name
        self._sink = sink
        self._queue: BoundedQueue[T] = BoundedQueue(capacity, gives_way)
        self._stop = threading.Event()
        self._first_retry_s, self._close_timeout_s = first_retry_s, close_timeout_s
        self._gathers_s = gathers_s
        self._sent = 0
        self._lost = 0  # in a write that failed
        self._lost_important = 0
        self._restarts = 0
        self._error, self._cause = "", Cause.NONE

    def put(self, record: T) -> None:
        """Queue a record without blocking; records wait in the queue until `run` starts."""
        self._queue.put(record)

    def health(self) -> SinkHealth:
        """Return the counts so far.

        `error` is the reason why the sink is not running now, "" if it is. A batch whose write failed counts as
        dropped.
        """
        return SinkHealth(
            sent=self._sent,
            dropped=self._queue.dropped + self._lost,
            dropped_important=self._queue.dropped_important + self._lost_important,
            restarts=self._restarts,
            error=self._error,
            cause=self._cause,
        )

    async def run(self) -> None:
        """Run until cancelled; a sink that fails is restarted, and its exception is not raised.

        On cancellation the queued records are still written and the sink is closed, unless that takes longer than
        `close_timeout_s`.
        """
        self._stop.clear()
        thread = threading.Thread(target=self._work, name=f"sink-{self.name}", daemon=True)
        thread.start()
        try:
            await asyncio.get_running_loop().create_future()  # which is never done
        finally:
            self._stop.set()
            # Wait for the thread's end: it may be inside a Rust library, where no thread may be when the
            # interpreter ends (`onboard.sinks.zenoh_session`).
            await asyncio.to_thread(thread.join, self._close_timeout_s)

    def _work(self) -> None:
        """Use the sink until `_stop` is set; after each failure retry with a growing delay."""
        delay_s = self._first_retry_s
        while True:
            sent = self._sent
            try:
                self._use()
            except BaseException as error:  # a panic in a Rust library is no Exception
                self._error, self._cause = str(error) or type(error).__name__, _cause(error)
                self._restarts += 1
            if self._sent > sent:
                delay_s = self._first_retry_s
            if self._stop.wait(0 if not self._error else delay_s):
                return
            delay_s = min(2 * delay_s, MAX_RETRY_DELAY_S)

    def _use(self) -> None:
        """Open, write until `_stop` is set, close."""
        sink = self._sink
        try:
            sink.open()
            self._error, self._cause = "", Cause.NONE
            records: list[T] = []
            limit = MAX_RECORDS
            while True:
                if self._gathers_s:
                    is_more = len(records) == limit
                    self._stop.wait(PAUSE_TIME_S if is_more else self._gathers_s)
                    limit = PIECE_RECORDS if self._queue.has_room else QUEUE_OVERFLOW_FACTOR * PIECE_RECORDS
                stopping = self._stop.is_set()  # read before `take`: records put before the stop are written
                records = self._queue.take(limit, 0.0 if stopping else IDLE_PERIOD_S)
                try:
                    sink.write(records)
                except BaseException:  # a panic in a Rust library is no Exception
                    self._lost += len(records)
                    self._lost_important += self._queue.important(records)
                    raise
                self._sent += len(records)
                if stopping and not records:
                    return
        finally:
            sink.close()


def _cause(error: BaseException) -> Cause:
    """Return the cause of a sink's failure from its error and the error behind it."""
    is_full = any(getattr(e, "errno", None) == errno.ENOSPC for e in (error, error.__cause__))
    return Cause.DISK_FULL if is_full else Cause.FAILED
