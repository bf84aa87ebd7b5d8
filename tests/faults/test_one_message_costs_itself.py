"""An exception over one message costs that message: it is counted, reported once, and everything else goes on."""

from collections.abc import Callable
from typing import Any

import pytest
from msgspec.structs import replace

from onboard.daemon import Daemon
from onboard.messages import Message
from onboard.wire.mavlink.encode import MavlinkEncoder
from onboard.wire.mavlink.records import CONVERT
from tests.support.faulty_flight import DATAGRAMS, assert_on_target
from tests.support.streams import CIRCLE, EPOCH, Run, S, feed, heartbeat, make_config
from tests.unit.autopilot.test_session import command, connected, parsed


@pytest.mark.parametrize("value", [float("nan"), float("inf"), float("-inf"), 1e300])
def test_a_command_whose_parameter_is_no_message_number_is_refused(value: float) -> None:
    (ack,) = parsed(connected().respond([command(512, value)], EPOCH))
    assert (ack.get_type(), ack.command, ack.result) == ("COMMAND_ACK", 512, 3)


def once(function: Callable[..., Any], at: int) -> Callable[..., Any]:
    """The function, which raises at its call number `at`."""
    calls = 0

    def failing(*arguments: Any) -> Any:
        nonlocal calls
        calls += 1
        if calls == at:
            raise ZeroDivisionError("one message")
        return function(*arguments)

    return failing


def test_an_exception_while_decoding_costs_one_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    layout, convert = CONVERT["ATTITUDE_QUATERNION"]
    monkeypatch.setitem(CONVERT, "ATTITUDE_QUATERNION", (layout, once(convert, 100)))
    run = feed(DATAGRAMS, errors=True)
    assert_on_target(run, 1.0)
    assert run.rejected == {"error.ATTITUDE_QUATERNION": 1}
    (line,) = run.pipeline.errors
    assert "ATTITUDE_QUATERNION" in line
    assert "ZeroDivisionError: one message" in line


def test_a_frame_that_fails_does_not_cost_the_others_of_its_datagram(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: Any) -> Message:
        raise ValueError("every time")

    layout, _ = CONVERT["ATTITUDE_QUATERNION"]
    monkeypatch.setitem(CONVERT, "ATTITUDE_QUATERNION", (layout, fail))
    encoder = MavlinkEncoder(1, 1)
    frames = b"".join(map(encoder.encode, (heartbeat(S), CIRCLE.attitude(S), CIRCLE.position(S))))
    run = feed([replace(DATAGRAMS[0], data=frames)], errors=True)
    assert set(run.pipeline.health(0).streams) == {"Heartbeat", "LocalPosition"}
    assert run.rejected == {"error.ATTITUDE_QUATERNION": 1}


@pytest.mark.parametrize("method", ["observe", "tick"])
def test_an_exception_in_an_estimator_resets_it_and_costs_one_message(
    monkeypatch: pytest.MonkeyPatch, method: str
) -> None:
    run = feed(DATAGRAMS[: len(DATAGRAMS) // 2])
    before, leader = len(run.estimates), run.pipeline.estimators["leader"]
    monkeypatch.setattr(leader, method, once(getattr(leader, method), 5))
    for datagram in DATAGRAMS[len(DATAGRAMS) // 2 :]:
        run.outputs.extend(run.pipeline.feed(datagram))
    assert_on_target(run, 2.0)
    assert run.estimates[-1].reset_count == 1
    assert run.rejected == {"error.leader": 1}
    assert any(not e.valid for e in run.estimates[before:])


def test_an_estimator_that_always_fails_leaves_the_others(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fail(*_: Any) -> Any:
        raise ValueError("every time")

    config = make_config("estimator.own_state={}")
    run = feed(DATAGRAMS[:1], config)
    for method in ("observe", "tick", "reset"):
        monkeypatch.setattr(run.pipeline.estimators["own_state"], method, fail)
    for datagram in DATAGRAMS[1:]:
        run.outputs.extend(run.pipeline.feed(datagram))
    assert_on_target(Run(run.pipeline, [e for e in run.estimates if e.name == "leader"]), 1.0)
    assert run.rejected["error.own_state"] > 400  # nearly every attitude and position
    assert len(run.pipeline.errors) == 1


def test_an_exception_in_the_daemon_costs_one_datagram(monkeypatch: pytest.MonkeyPatch) -> None:
    lines: list[str] = []
    daemon = Daemon(make_config("zenoh.enabled=false", "link=[]"), report=lines.append)
    show = daemon._console.show_state
    monkeypatch.setattr(daemon._console, "show_state", once(show, 50))
    for datagram in DATAGRAMS:
        daemon._deliver(datagram)
    health = daemon._pipeline.health(EPOCH)
    assert health.rejected == {"error.daemon": 1}
    assert health.states == {"leader": "tracking"}
