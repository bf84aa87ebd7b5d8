"""The sink that publishes over Zenoh.

Below `onboard/<vehicle>/` it publishes `estimate/<name>`, `own_state`, `ownship` and `health` as JSON, and answers
queries with the latest value. The attachment of a published record is the time of publication, in ns of this
computer's clock, as decimal ASCII. The liveliness token `alive` exists while the program runs. A reply has the
attachment `{"age_s": ..., "stale": ...}`; an estimate older than the validity timeout is reported as lost and not
valid, so that a late joiner cannot mistake it for a new one.
"""

import time
from collections.abc import Callable, Sequence
from typing import Any, Final

import msgspec

from onboard.messages import Estimate, Health, LeaderState, Lifecycle, OwnPose, invalidate
from onboard.messages.causes import Cause, Reason
from onboard.messages.schemas import key_of
from onboard.sinks.sink import SinkError, SinkRunner
from onboard.sinks.zenoh_session import ZenohSession

Published = Estimate | OwnPose | LeaderState | Health

PUBLISHER_CAPACITY: Final = 2048  # queued records: one or two seconds, or several updates of many tracks
QUERYABLE: Final = ("estimate/**", "leader", "own_state", "ownship", "health")


class ZenohSink:
    """A sink that publishes on a session opened and closed elsewhere.

    `current` returns a record as it may be published now, however long it has been queued; the sink's and Zenoh's
    threads call it.
    """

    def __init__(
        self,
        session: ZenohSession,
        prefix: str,
        *,
        current: Callable[[Published], Published] = lambda record: record,
        validity_s: float = 2.0,
        monotonic: Callable[[], float] = time.monotonic,
        now_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self._session, self._prefix = session, prefix
        self._now_ns, self._current = now_ns, current
        self._validity_s, self._monotonic = validity_s, monotonic
        self._encoder = msgspec.json.Encoder()
        self._latest: dict[str, tuple[Published, float]] = {}  # key -> record, when it was published
        self._publishers: dict[str, Any] = {}
        self._declared: list[Any] = []

    def open(self) -> None:
        """Declare the queryables and, last, the liveliness token.

        Raises SinkError if the session is closed.
        """
        if self._session.is_closed():
            raise SinkError("zenoh: the session is closed")
        for pattern in QUERYABLE:
            key = f"{self._prefix}/{pattern}"
            self._declared.append(self._session.declare_queryable(key, self._answer))
        self._declared.append(self._session.liveliness().declare_token(f"{self._prefix}/alive"))

    def write(self, records: Sequence[Published]) -> None:
        """Publish each record."""
        for record in records:
            key = f"{self._prefix}/{key_of(record)}"
            publisher = self._publishers.get(key) or self._declare(key)
            self._latest[key] = record, self._monotonic()
            stamp = b"%d" % self._now_ns()  # first: a process stopped in between claims no later time
            publisher.put(self._encoder.encode(self._current(record)), attachment=stamp)
            if isinstance(record, Estimate) and not record.is_primary and record.state is Lifecycle.SEARCHING:
                self._publishers.pop(key).undeclare()  # this target is gone; else publishers would accumulate
                del self._latest[key]

    def close(self) -> None:
        """Undeclare everything in reverse order."""
        declared = [*self._declared, *self._publishers.values()]
        self._declared, self._publishers = [], {}
        if not self._session.is_closed():
            for thing in reversed(declared):
                thing.undeclare()

    def _declare(self, key: str) -> Any:
        import zenoh  # noqa: PLC0415 - loaded already: there is a session

        drop, json = zenoh.CongestionControl.DROP, zenoh.Encoding.APPLICATION_JSON
        publisher = self._session.declare_publisher(key, encoding=json, congestion_control=drop, express=True)
        self._publishers[key] = publisher
        return publisher

    def _answer(self, query: Any) -> None:
        """Reply with the latest values that match the query; runs in one of Zenoh's threads."""
        import zenoh  # noqa: PLC0415 - loaded already: there is a session

        with query:
            for key, (record, t_published) in list(self._latest.items()):
                if query.key_expr.intersects(zenoh.KeyExpr(key)):
                    age_s = self._monotonic() - t_published
                    payload, attachment = aged(self._current(record), age_s, self._validity_s)
                    json = zenoh.Encoding.APPLICATION_JSON
                    query.reply(key, payload, encoding=json, attachment=attachment)


def runner(sink: ZenohSink) -> SinkRunner[Published]:
    """Return the sink with its queue, in which traffic and further targets give way.

    A target's last estimate does not give way: without it, its key would stay declared.
    """

    def gives_way(record: Published) -> bool:
        return isinstance(record, Estimate) and not record.is_primary and record.state is not Lifecycle.SEARCHING

    return SinkRunner("zenoh", sink, PUBLISHER_CAPACITY, gives_way=gives_way)


def aged(record: Published, age_s: float, validity_s: float) -> tuple[bytes, bytes]:
    """Return (payload, attachment) of a reply with a record published `age_s` seconds ago."""
    stale = age_s > validity_s
    if stale and isinstance(record, Estimate | LeaderState):
        why = Reason(Cause.OUTDATED, f"stale: published {age_s:.1f} s ago")
        record = msgspec.structs.replace(invalidate(record, why), state=Lifecycle.LOST)
    attachment = {"age_s": round(age_s, 3), "stale": stale}
    return msgspec.json.encode(record), msgspec.json.encode(attachment)
