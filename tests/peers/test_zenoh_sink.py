"""The Zenoh side as a stranger sees it: our router in this process, a client session beside it."""

import asyncio
import json
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from typing import Any

import msgspec
import pytest
import zenoh

from onboard.links import LinkError
from onboard.links import zenoh as zenoh_link
from onboard.links.zenoh import MAX_WAITING_COUNT, ZenohLink
from onboard.messages import Datagram, Encoding, Estimate, Health, Lifecycle, OwnPose
from onboard.sinks import SinkRunner
from onboard.sinks.zenoh import ZenohSink
from onboard.sinks.zenoh_session import ZenohConfig, open_session, this_computer
from onboard.wire.documents.document import MAX_DOCUMENT_BYTES
from tests.support.programs import free_endpoint, until
from tests.support.records import POSE, make_estimate

TIMEOUT_S = 300.0  # what takes longer hangs
PREFIX = "onboard/uav-1"


@pytest.fixture
def session(endpoint: str) -> Iterator[Any]:
    session = open_session(ZenohConfig(vehicle="uav-1", listen=(endpoint,)))
    yield session
    session.close()


@pytest.fixture
def client(session: Any, endpoint: str) -> Iterator[Any]:  # noqa: ARG001 - the router must be there first
    """A stranger's session, configured by hand and not by our code."""
    text = (
        f'{{mode: "client", connect: {{endpoints: ["{endpoint}"]}}, scouting: {{multicast: {{enabled: false}}}}}}'
    )
    client = zenoh.open(zenoh.Config.from_json5(text))
    yield client
    client.close()


HEALTH = Health(
    t_ns=1,
    t_recv_ns=2,
    uptime=3.0,
    autopilot="px4",
    autopilot_reboots=0,
    clock_source="timesync",
    clock_offset_ns=None,
    round_trip=None,
    streams={},
    states={"ukf": Lifecycle.TRACKING},
    verdicts={},
    rejected={},
    sinks={},
)


def get(client: Any, selector: str) -> dict[str, tuple[bytes, dict[str, Any]]]:
    found = {}
    for reply in client.get(selector, timeout=TIMEOUT_S):
        assert str(reply.ok.key_expr) not in found
        assert reply.ok.encoding == zenoh.Encoding.APPLICATION_JSON
        attachment = json.loads(reply.ok.attachment.to_bytes())
        found[str(reply.ok.key_expr)] = reply.ok.payload.to_bytes(), attachment
    return found


def opened(session: Any, **options: Any) -> ZenohSink:
    sink = ZenohSink(session, PREFIX, **options)
    sink.open()
    return sink


def test_a_subscriber_receives_each_record_on_its_key_as_json(session: Any, client: Any) -> None:
    received: dict[str, Any] = {}
    client.declare_subscriber("onboard/**", lambda s: received.__setitem__(str(s.key_expr), s))
    sink = opened(session, now_ns=lambda: 1_700_000_000_123_456_789)

    def all_there() -> bool:
        sink.write([make_estimate(), POSE, HEALTH])  # again until the subscription has reached the router
        return len(received) == 3

    until(all_there, "records over Zenoh")
    payloads = {key: sample.payload.to_bytes() for key, sample in received.items()}
    assert msgspec.json.decode(payloads[f"{PREFIX}/estimate/ukf"], type=Estimate) == make_estimate()
    assert msgspec.json.decode(payloads[f"{PREFIX}/ownship"], type=OwnPose) == POSE
    assert msgspec.json.decode(payloads[f"{PREFIX}/health"], type=Health) == HEALTH
    for sample in received.values():
        assert sample.encoding == zenoh.Encoding.APPLICATION_JSON
        assert sample.congestion_control == zenoh.CongestionControl.DROP
        assert sample.express
        assert sample.attachment.to_bytes() == b"1700000000123456789"  # when it was published
    sink.close()


def test_a_late_joiner_gets_the_latest_of_everything_once(session: Any, client: Any) -> None:
    sink = opened(session)
    sink.write([make_estimate(1), make_estimate(1, "csvsf"), make_estimate(2), POSE, HEALTH])
    until(lambda: get(client, f"{PREFIX}/estimate/ukf"), "records over Zenoh")
    found = get(client, f"{PREFIX}/**")
    assert set(found) == {f"{PREFIX}/{k}" for k in ("estimate/ukf", "estimate/csvsf", "ownship", "health")}
    payload, attachment = found[f"{PREFIX}/estimate/ukf"]
    assert msgspec.json.decode(payload, type=Estimate) == make_estimate(2)
    assert 0 <= attachment["age_s"] < TIMEOUT_S
    assert set(get(client, f"{PREFIX}/estimate/*")) == {f"{PREFIX}/estimate/ukf", f"{PREFIX}/estimate/csvsf"}
    assert get(client, f"{PREFIX}/estimate/none") == {}
    sink.close()
    assert get(client, f"{PREFIX}/**") == {}


def test_a_stale_estimate_comes_back_lost_and_not_valid(session: Any, client: Any) -> None:
    now = [100.0]
    sink = opened(session, validity_s=2.0, monotonic=lambda: now[0])
    sink.write([make_estimate(), POSE])
    until(lambda: get(client, f"{PREFIX}/ownship"), "records over Zenoh")

    def reply() -> tuple[Estimate, dict[str, Any]]:
        payload, attachment = get(client, f"{PREFIX}/estimate/ukf")[f"{PREFIX}/estimate/ukf"]
        return msgspec.json.decode(payload, type=Estimate), attachment

    now[0] = 101.9
    assert reply() == (make_estimate(), {"age_s": 1.9, "stale": False})
    now[0] = 103.2
    found, attachment = reply()
    assert (found.valid, found.state) == (False, Lifecycle.LOST)
    assert "3.2 s ago" in found.reason
    assert attachment == {"age_s": 3.2, "stale": True}
    assert found.mean == make_estimate().mean  # still available
    assert get(client, f"{PREFIX}/ownship")[f"{PREFIX}/ownship"][1]["stale"]
    sink.close()


def test_the_liveliness_token_comes_and_goes_with_the_sink(session: Any, client: Any) -> None:
    changes: list[tuple[str, Any]] = []
    client.liveliness().declare_subscriber(
        "onboard/*/alive", lambda s: changes.append((str(s.key_expr), s.kind)), history=True
    )
    sink = opened(session)
    until(lambda: changes == [(f"{PREFIX}/alive", zenoh.SampleKind.PUT)], "records over Zenoh")
    sink.close()
    until(lambda: changes[1:] == [(f"{PREFIX}/alive", zenoh.SampleKind.DELETE)], "records over Zenoh")


def test_behind_its_runner_it_publishes_and_survives_the_session_going(session: Any, client: Any) -> None:
    received: list[bytes] = []
    client.declare_subscriber(f"{PREFIX}/estimate/*", lambda s: received.append(s.payload.to_bytes()))

    async def main() -> None:
        runner: SinkRunner[Any] = SinkRunner("zenoh", ZenohSink(session, PREFIX), 64, first_retry_s=0.01)
        task = asyncio.create_task(runner.run())
        async with asyncio.timeout(TIMEOUT_S):
            while not received:
                runner.put(make_estimate())
                await asyncio.sleep(0.01)
            await asyncio.to_thread(session.close)
            while runner.health().restarts < 2:
                runner.put(make_estimate())
                await asyncio.sleep(0.01)
        assert "session is closed" in runner.health().error
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task

    asyncio.run(main())


def test_camera_points_come_in_with_their_key_and_arrival(session: Any, client: Any) -> None:
    key = f"{PREFIX}/camera/front/points"
    put = partial(client.put, congestion_control=zenoh.CongestionControl.BLOCK)  # else it may drop any
    received: list[Datagram] = []

    async def main() -> None:
        link = ZenohLink(session, PREFIX, camera="front")
        await link.open()
        task = asyncio.create_task(link.run(received.append, time.time_ns))
        async with asyncio.timeout(TIMEOUT_S):
            while not received:
                put(key, b'{"first": 1}')
                await asyncio.sleep(0.01)
            put(f"{PREFIX}/camera/front/other", b"not for us")
            put(key, b"")
            put(key, bytes(100_000))
            put(key, b'{"last": 1}')
            while received[-1].data != b'{"last": 1}':  # noqa: ASYNC110 - as above
                await asyncio.sleep(0.01)
        assert link.errors == 0
        assert link.received == len(received)
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task

    before = time.time_ns()
    asyncio.run(main())
    assert {(d.channel, d.encoding) for d in received} == {(key, Encoding.POINTS)}
    cut = bytes(MAX_DOCUMENT_BYTES + 1)  # for the decoder to refuse with a reason
    assert {d.data for d in received} == {b'{"first": 1}', b"", cut, b'{"last": 1}'}
    stamps = [d.t_recv_ns for d in received]
    assert before <= stamps[0]
    assert stamps == sorted(stamps)
    client.put(key, b"after the loop has closed")  # must not disturb anyone


def test_a_flood_of_points_costs_points_not_memory(session: Any, client: Any) -> None:
    async def main() -> None:
        link = ZenohLink(session, PREFIX, camera="front")
        received: list[Datagram] = []
        task = asyncio.create_task(link.run(received.append, time.time_ns))
        key = f"{PREFIX}/camera/front/points"
        async with asyncio.timeout(TIMEOUT_S):
            while not received:
                client.put(key, b"x")
                await asyncio.sleep(0.01)
            while link.errors == 0:
                for _ in range(2000):
                    client.put(key, b"x")
                time.sleep(0.05)  # noqa: ASYNC251 - the loop is to be late
            before = len(received)
            await asyncio.sleep(0)  # all that waited for the loop is before this in its queue, and nothing else
            assert 0 < len(received) - before <= MAX_WAITING_COUNT
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task

    asyncio.run(main())


def test_a_client_of_another_router_publishes_through_it(session: Any, client: Any, endpoint: str) -> None:  # noqa: ARG001
    ours = open_session(ZenohConfig(vehicle="uav-1", mode="client", connect=(endpoint,)))
    try:
        sink = opened(ours)
        sink.write([make_estimate()])
        until(lambda: get(client, f"{PREFIX}/estimate/ukf"), "records over Zenoh")
        sink.close()
    finally:
        ours.close()


def test_the_health_says_whether_the_router_is_connected(session: Any, endpoint: str) -> None:
    config = ZenohConfig(vehicle="uav-2", mode="client", connect=(endpoint,))
    ours = open_session(config)
    try:
        link = ZenohLink(ours, config.prefix, camera="front")
        until(lambda: link.health().routers == 1, "the router")
        session.close()
        until(lambda: link.health().routers == 0, "the router's end")
    finally:
        ours.close()
    assert link.health().routers == 0


@pytest.mark.parametrize(
    ("are_armed", "ended"), [((False, False), (1,)), ((False, True), (0,)), ((True, True), ()), ((None, True), ())]
)
def test_of_two_vehicles_of_one_name_the_one_that_flies_keeps_it(
    session: Any,
    client: Any,
    endpoint: str,
    monkeypatch: pytest.MonkeyPatch,
    are_armed: tuple[bool | None, bool | None],
    ended: tuple[int, ...],
) -> None:
    """A copied card, in a computer that boots later: neither vehicle's images were used, also in flight.

    None: its autopilot has not been heard yet, so it waits.
    """
    monkeypatch.setattr(zenoh_link, "WATCH_PERIOD_S", 0.05)
    config = ZenohConfig(vehicle="uav-1", listen=(free_endpoint(),), connect=(endpoint,))
    sessions, received = (session, open_session(config)), [list[Datagram](), list[Datagram]()]

    async def reaches(condition: Callable[[], bool], data: bytes = b"") -> None:
        while not condition():
            if data:
                client.put(f"{PREFIX}/camera/front/points", data)
            await asyncio.sleep(0.01)

    async def main() -> None:
        links = [
            ZenohLink(each, PREFIX, camera="front", is_armed=lambda armed=armed: armed)
            for each, armed in zip(sessions, are_armed, strict=True)
        ]
        runs = [link.run(to.append, time.time_ns) for link, to in zip(links, received, strict=True)]
        tasks = [asyncio.create_task(run) for run in runs]
        async with asyncio.timeout(TIMEOUT_S):
            await reaches(lambda: bool(links[1].health().error or ended))
            await reaches(lambda: all(tasks[i].done() for i in ended))
            assert tuple(i for i, task in enumerate(tasks) if task.done()) == ended
            for i in ended:
                error = tasks[i].exception()
                assert isinstance(error, LinkError)
                assert f"vehicle `uav-1` is also the name of {this_computer()}, session" in str(error)
            await reaches(lambda: ended != (1,) or bool(received[0]), b"ours")
            await reaches(lambda: are_armed != (True, True) or links[1].errors > 0, b"whose?")
            assert links[0].errors == 0
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    try:
        asyncio.run(main())
    finally:
        sessions[1].close()
