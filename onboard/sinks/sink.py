"""The one way records leave: a bounded drop-oldest queue, a thread behind it, and restarts with back-off.

The event loop only ever appends to a queue. Opening, writing and closing a sink happen in the sink's own thread,
so a full disk, a slow viewer or a stalled peer delays nobody else: `put` costs about a microsecond whatever the
sink is doing. The thread is a daemon: one stuck in a write cannot keep the process from ending.
"""

import asyncio
import queue
import threading
from collections.abc import Sequence
from contextlib import suppress
from typing import Final, Generic, Protocol, TypeVar

from onboard.errors import UserError
from onboard.messages import SinkHealth

T = TypeVar("T")
In_contra = TypeVar("In_contra", contravariant=True)

IDLE_S: Final = 0.25  # a sink is called this often at least, with nothing, so that it can flush
BATCH: Final = 1024
FIRST_RETRY_S: Final = 0.5
LONGEST_RETRY_S: Final = 30.0
CLOSE_TIMEOUT_S: Final = 3.0


class SinkError(UserError):
    """A sink cannot be opened; the message says which one, why, and what to do."""


class Sink(Protocol[In_contra]):
    """Where records go. All three are called in one thread, the sink's own, and may block or raise."""

    def open(self) -> None:
        """Make ready; called again after each failure."""

    def write(self, records: Sequence[In_contra]) -> None:
        """Hand records on, oldest first. Empty when there was nothing for a while: a chance to flush."""

    def close(self) -> None:
        """Release everything; must bear being called after an `open` that failed."""


class BoundedQueue(Generic[T]):
    """Between one producer and one consumer thread; the oldest item makes room for the newest.

    `put` neither waits nor fails. `dropped` counts exactly: an item is either taken or dropped.
    """

    def __init__(self, capacity: int) -> None:
        if capacity < 1:
            raise ValueError(f"a queue needs room for one item at least, not {capacity}")
        self.dropped = 0
        self._capacity = capacity
        self._items: queue.SimpleQueue[T] = queue.SimpleQueue()

    def put(self, item: T) -> None:
        """Append. From the producer's thread only."""
        with suppress(queue.Empty):  # the consumer made room meanwhile
            while self._items.qsize() >= self._capacity:
                self._items.get_nowait()
                self.dropped += 1
        self._items.put(item)

    def take(self, limit: int, timeout: float) -> list[T]:
        """Up to `limit` items, waiting at most `timeout` seconds for the first; none when none came."""
        items: list[T] = []
        with suppress(queue.Empty):
            items.append(self._items.get(timeout=timeout))
            while len(items) < limit:
                items.append(self._items.get_nowait())
        return items


class SinkRunner(Generic[T]):
    """One sink behind its queue. `put` from the event loop's thread; `run` is its (optional) task."""

    def __init__(
        self,
        name: str,
        sink: Sink[T],
        capacity: int,
        *,
        first_retry_s: float = FIRST_RETRY_S,
        close_timeout_s: float = CLOSE_TIMEOUT_S,
    ) -> None:
        self.name = name
        self._sink = sink
        self._queue: BoundedQueue[T] = BoundedQueue(capacity)
        self._stop = threading.Event()
        self._first_retry_s, self._close_timeout_s = first_retry_s, close_timeout_s
        self._sent = 0
        self._lost = 0  # in a write that failed
        self._restarts = 0
        self._error = ""

    def put(self, record: T) -> None:
        """Queue a record; never blocks, never raises. Before `run` has started it waits in the queue."""
        self._queue.put(record)

    def health(self) -> SinkHealth:
        """Counts so far. `error` is why the sink is not running now, "" when it is; a batch whose write failed
        counts as dropped."""
        dropped = self._queue.dropped + self._lost
        return SinkHealth(sent=self._sent, dropped=dropped, restarts=self._restarts, error=self._error)

    async def run(self) -> None:
        """Until cancelled; a failing sink is restarted, never raised. On cancellation what is queued is still
        written and the sink closed, unless that takes longer than `close_timeout_s`."""
        self._stop.clear()
        thread = threading.Thread(target=self._work, name=f"sink-{self.name}", daemon=True)
        thread.start()
        try:
            await asyncio.get_running_loop().create_future()  # that nothing resolves
        finally:
            self._stop.set()
            # To its very end: what it lets go of last may be in a library of Rust's, in which no thread must be
            # when Python ends (`onboard.sinks.zenoh_session`).
            await asyncio.to_thread(thread.join, self._close_timeout_s)

    def _work(self) -> None:
        """The sink's thread: use it until told to stop, again after every failure, ever more slowly."""
        delay_s = self._first_retry_s
        while True:
            sent = self._sent
            try:
                self._use()
            except BaseException as error:  # a panic in a library written in Rust is no Exception
                self._error = str(error) or type(error).__name__
                self._restarts += 1
            if self._sent > sent:
                delay_s = self._first_retry_s
            if self._stop.wait(0 if not self._error else delay_s):
                return
            delay_s = min(2 * delay_s, LONGEST_RETRY_S)

    def _use(self) -> None:
        """Open, write until told to stop, close."""
        sink = self._sink
        try:
            sink.open()
            self._error = ""
            while True:
                stopping = self._stop.is_set()  # read before taking: what was put before the stop is written
                records = self._queue.take(BATCH, 0.0 if stopping else IDLE_S)
                self._lost += len(records)
                sink.write(records)
                self._lost -= len(records)
                self._sent += len(records)
                if stopping and not records:
                    return
        finally:
            sink.close()
