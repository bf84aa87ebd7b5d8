"""Silence: only the latched autopilot counts as heard, and no subscriber's last word stays valid."""

from typing import Any

import pytest

from onboard.autopilot.output import Outgoing
from onboard.daemon import Daemon
from onboard.links.host_clock import HostClock
from onboard.messages import (
    Cause,
    Datagram,
    Estimate,
    Health,
    Lifecycle,
    LinkHealth,
    SinkHealth,
    TargetPoints,
)
from onboard.pipeline.silence import BEHIND
from tests.support.faulty_flight import DATAGRAMS, T1
from tests.support.streams import EPOCH, MS, Item, S, Stream, encode, heartbeat, make_config
from tests.unit.autopilot.test_session import parsed

END = EPOCH + round(T1 * S)


class Wire:
    """Keeps what is sent over a link, and is a sink that only keeps what is published."""

    def __init__(self) -> None:
        self.frames: list[bytes] = []
        self.records: list[Any] = []

    def send(self, frame: bytes) -> None:
        self.frames.append(frame)

    def put(self, record: Any) -> None:
        self.records.append(record)

    def health(self) -> Any:
        return SinkHealth()


class Link:
    """The link of a wire."""

    channel = "udp"

    def __init__(self, wire: Wire) -> None:
        self.send = wire.send

    def health(self) -> LinkHealth:
        return LinkHealth()


class SetClock(HostClock):
    """A clock that shows what it is set to."""

    def __init__(self) -> None:
        self.shown_ns = 0
        super().__init__(wall=lambda: self.shown_ns, monotonic=lambda: self.shown_ns)

    def now_ns(self) -> int:
        return self.shown_ns


def flying(*overrides: str) -> tuple[Daemon, Wire, list[str]]:
    """A daemon after the flight, tracking."""
    lines: list[str] = []
    config = make_config("link=[{name='udp', url='udpin:127.0.0.1:0'}]", "zenoh.enabled=false", *overrides)
    daemon, wire = Daemon(config, report=lines.append, clock=SetClock()), Wire()
    daemon._links, daemon._sinks = [Link(wire)], {"wire": wire}  # type: ignore[list-item, dict-item]
    for datagram in DATAGRAMS:
        deliver(daemon, datagram)
    return daemon, wire, lines


def deliver(daemon: Daemon, datagram: Datagram, *, waited_ns: int = 0) -> None:
    """Let a datagram be read so long after it has arrived."""
    daemon._clock.shown_ns = datagram.t_recv_ns + waited_ns  # type: ignore[attr-defined] # of a SetClock
    daemon._deliver(datagram)


def tick(daemon: Daemon, now_ns: int) -> None:
    daemon._clock.shown_ns = now_ns  # type: ignore[attr-defined] # of a SetClock
    daemon._tick(now_ns)


def pass_time(daemon: Daemon, seconds: float, start_ns: int = END) -> None:
    for ms in range(0, round(seconds * 1000), 50):
        tick(daemon, start_ns + ms * MS)


def statuses(wire: Wire) -> list[int]:
    """system_status of the heartbeats that were sent."""
    return [m.system_status for m in parsed(wire.frames) if m.get_type() == "HEARTBEAT"]


@pytest.mark.parametrize(
    "chatter",
    [heartbeat(0, system=255, autopilot=8), pytest.param(heartbeat(0, system=9), marks=pytest.mark.slow)],
)
def test_others_that_talk_do_not_make_a_dead_autopilot_healthy(chatter: Any) -> None:
    daemon, wire, lines = flying()
    for tenth in range(80):
        now_ns = END + tenth * 100 * MS
        (datagram,) = encode([Item(now_ns, chatter)])
        deliver(daemon, datagram)
        tick(daemon, now_ns)
    assert statuses(wire)[0] == 4
    assert statuses(wire)[-4:] == [5, 5, 5, 5]
    assert any("silent" in line for line in lines)


def test_when_everything_falls_silent_the_last_word_is_not_valid() -> None:
    daemon, wire, _ = flying()
    last = [r for r in wire.records if isinstance(r, Estimate)][-1]
    assert last.valid
    pass_time(daemon, 0.9)
    assert [r for r in wire.records if isinstance(r, Estimate)][-1] == last
    pass_time(daemon, 3.0, END + 900 * MS)
    word = [r for r in wire.records if isinstance(r, Estimate)][-1]
    assert (word.target, word.valid, word.state) == ("leader", False, Lifecycle.LOST)
    assert word.cause is Cause.SILENT
    assert word.reason == "withdrawn: nothing usable of our own motion arrives"
    assert (word.mean, word.t_ns, word.sequence) == (last.mean, last.t_ns, last.sequence + 1)
    assert sum(isinstance(r, Estimate) and not r.valid for r in wire.records[-100:]) == 1, "withdrawn once"
    healths = [r for r in wire.records if isinstance(r, Health)]
    assert healths[-1].states == {"leader": "lost"}


def test_estimates_are_valid_again_when_the_autopilot_returns_soon() -> None:
    daemon, wire, _ = flying()
    pass_time(daemon, 1.5)
    assert not [r for r in wire.records if isinstance(r, Estimate)][-1].valid
    for datagram in encode(Stream(t0=T1 + 1.5, t1=T1 + 4, seed=21, sparse=True).items()):
        deliver(daemon, datagram)
    assert [r for r in wire.records if isinstance(r, Estimate)][-1].valid


def test_images_that_go_on_do_not_keep_an_estimate_valid() -> None:
    daemon, wire, _ = flying()
    images = [
        i for i in Stream(t0=T1, t1=T1 + 4, seed=21, sparse=True).items() if isinstance(i.message, TargetPoints)
    ]
    for datagram in encode(images):
        deliver(daemon, datagram)
        daemon._tick(datagram.t_recv_ns)
    assert not [r for r in wire.records if isinstance(r, Estimate)][-1].valid


def newest(wire: Wire) -> Estimate:
    found: Estimate = [r for r in wire.records if isinstance(r, Estimate)][-1]
    return found


def test_what_has_waited_for_a_sink_or_a_socket_is_judged_again() -> None:
    """A process may be stopped at any place."""
    daemon, wire, _ = flying()
    tick(daemon, END)
    last = newest(wire)
    assert daemon._mark_outdated(last) is last
    daemon._clock.shown_ns = END + S  # type: ignore[attr-defined] # of a SetClock
    assert (daemon._mark_outdated(last).valid, daemon._mark_outdated(last).cause) == (False, BEHIND.cause)
    sent = len(wire.frames)
    daemon._send([Outgoing("udp", [b"frame"])], made_ns=END)
    assert len(wire.frames) == sent
    daemon._send([Outgoing("udp", [b"frame"])], made_ns=END + S)
    assert len(wire.frames) == sent + 1
