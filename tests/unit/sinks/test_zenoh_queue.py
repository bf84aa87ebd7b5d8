"""The queue in front of Zenoh: further targets give way to the leader."""

from collections.abc import Sequence
from functools import partial
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest

from onboard.messages import Cause, Estimate, Lifecycle, Reason, invalidate
from onboard.sinks import zenoh
from tests.support.records import make_estimate

OLD = Reason(Cause.OUTDATED, "old")


class Nothing:
    """A sink that is never opened."""

    def open(self) -> None:
        raise NotImplementedError

    def write(self, records: Sequence[Any]) -> None:
        raise NotImplementedError

    def close(self) -> None:
        raise NotImplementedError


class Session:
    """A Zenoh session that declares, and keeps what is not undeclared."""

    def __init__(self) -> None:
        self.declared: list[str] = []

    def declare_publisher(self, key: str, **_: Any) -> Any:
        self.declared.append(key)
        return SimpleNamespace(put=lambda *_, **__: None, undeclare=lambda: self.declared.remove(key))


def test_the_publisher_of_a_target_that_is_gone_is_undeclared_and_the_leader_s_stays() -> None:
    session = Session()
    sink = zenoh.ZenohSink(session, "onboard/1")
    for target in ("leader", "target/1", "target/2"):
        for state in (Lifecycle.TRACKING, Lifecycle.SEARCHING):
            if (target, state) != ("target/2", Lifecycle.SEARCHING):
                sink.write([make_estimate(1, "leader", target=target, state=state)])
    assert len(session.declared) == 2
    assert not [key for key in session.declared if "target/1" in key]


def test_a_record_is_published_and_replied_as_it_holds_then(monkeypatch: pytest.MonkeyPatch) -> None:
    """It may have waited in the queue while the program stood still."""
    put: list[bytes] = []
    session = Session()
    monkeypatch.setattr(session, "declare_publisher", lambda *_, **__: SimpleNamespace(put=partial(keep, put)))
    sink = zenoh.ZenohSink(
        session, "onboard/1", current=lambda r: invalidate(r, OLD) if isinstance(r, Estimate) and len(put) else r
    )
    record = make_estimate(1, "leader", state=Lifecycle.TRACKING)
    sink.write([record])
    sink.write([record])
    found = [msgspec.json.decode(data, type=Estimate) for data in put]
    assert [(e.valid, e.cause, e.reason) for e in found] == [(True, record.cause, record.reason), (False, *OLD)]


def keep(kept: list[bytes], data: bytes, **_: Any) -> None:
    kept.append(data)


def waiting(runner: Any) -> list[Any]:
    return list(runner._queue.take(10**6, 0.0))


def test_a_flood_of_further_targets_costs_the_leader_no_estimate() -> None:
    runner = zenoh.runner(Nothing())
    leaders = [make_estimate(n, "leader") for n in range(1000)]
    for n, leader in enumerate(leaders):
        for k in range(20):
            runner.put(make_estimate(n, "leader", target=f"target/{k}"))
        runner.put(leader)
    assert [r for r in waiting(runner) if r.is_primary] == leaders
    health = runner.health()
    assert health.dropped > 0
    assert health.dropped_important == 0


def test_the_last_estimate_of_a_target_does_not_give_way() -> None:
    runner = zenoh.runner(Nothing())
    for n in range(1000):
        runner.put(make_estimate(n, "leader", target=f"target/{n}"))
    last = make_estimate(1000, "leader", target="target/1", state=Lifecycle.SEARCHING, valid=False)
    runner.put(last)
    assert waiting(runner)[-1] == last
