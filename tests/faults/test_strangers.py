"""Strangers on our ports: who holds no key, or is no system of ours, takes and changes nothing."""

import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace
from pymavlink.dialects.v20 import ardupilotmega as dialect

from onboard.autopilot.output import AutopilotOutput
from onboard.autopilot.requests import STEERING
from onboard.config import Config, parse_config
from onboard.daemon import Daemon
from onboard.links.udp import UdpLink
from onboard.messages import Datagram, Encoding
from onboard.pipeline import Pipeline
from onboard.wire.mavlink_encode import MavlinkEncoder, message_number
from onboard.wire.signing import Signer
from tests.support.emitted import LINK, command_long, everything
from tests.support.leader import AUTOPILOT
from tests.support.running_link import until, with_link
from tests.support.streams import heartbeat

KEY = bytes(range(32))
NOW = 1_800_000_000 * 10**9
S = 10**9
HALF_A_YEAR, YEAR = 182 * 86_400 * S, 365 * 86_400 * S
PLAIN = MavlinkEncoder(1, 1).encode(heartbeat(0))
WITHOUT_A_SUM = PLAIN[:-2] + bytes(2)


@contextmanager
def senders() -> Iterator[tuple[socket.socket, socket.socket]]:
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as owner,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger,
    ):
        yield owner, stranger


@pytest.mark.parametrize(
    ("has_key", "false"),
    [(True, PLAIN), (True, bytes([0xFD]) + bytes(9)), (False, bytes([0xFE]) + bytes(9)), (False, WITHOUT_A_SUM)],
    ids=["unsigned", "signed link: garbage", "plain link: garbage", "plain link: a wrong checksum"],
)
def test_a_stranger_does_not_take_the_stream(has_key: bool, false: bytes, tmp_path: Path) -> None:
    """Through the daemon: what does not pass teaches no address."""
    row: dict[str, Any] = {"name": "autopilot", "url": "udpin:127.0.0.1:0"}
    if has_key:
        key_file = tmp_path / "key"
        key_file.write_text(KEY.hex())
        key_file.chmod(0o600)
        row["key_file"] = str(key_file)
    daemon = Daemon(parse_config({"link": [row], "zenoh": {"enabled": False}}), report=lambda _: None)
    signer = Signer(KEY, 0)

    def beat() -> bytes:
        return signer.sign(PLAIN, daemon._now_ns()) if has_key else PLAIN

    async def test(link: UdpLink, received: list[Datagram]) -> None:
        with senders() as (owner, stranger):
            for k in range(10):
                owner.sendto(beat(), link.address)
                await until(lambda n=11 * k + 1: link.received == n)
                assert link._peer == ("127.0.0.1", owner.getsockname()[1])
                for _ in range(10):
                    stranger.sendto(false, link.address)
                await until(lambda n=11 * k + 11: link.received == n)
                assert link._peer == ("127.0.0.1", owner.getsockname()[1])
            owner.settimeout(1.0)
            link.send(b"for the owner")
            assert owner.recv(100) == b"for the owner"
        assert len(received) == 110

    with_link("udpin:127.0.0.1:0", test, passes=daemon._deliver)


class Signed:
    """A pipeline whose link has a key, and what it makes of frames that are signed at another time."""

    def __init__(self) -> None:
        self.pipeline = Pipeline(Config(), {"autopilot": KEY})

    def accepts(self, signed_ns: int, *, arrival: int = NOW, step: int = 0) -> bool:
        frame = Signer(KEY, 0).sign(PLAIN, signed_ns)
        datagram = Datagram(
            channel="autopilot", encoding=Encoding.MAVLINK, t_recv_ns=arrival, data=frame, wall_step_ns=step
        )
        return bool(self.pipeline.decode(datagram))

    def reasons(self) -> list[str]:
        return [refusal.reason for refusal in self.pipeline.health(NOW).refusals]


@pytest.mark.parametrize("is_known", [False, True])
def test_a_signed_frame_from_far_ahead_does_not_shut_the_owner_out(is_known: bool) -> None:
    link = Signed()
    assert not is_known or link.accepts(NOW)
    for ahead in (61 * S, YEAR, 70 * YEAR):
        assert not link.accepts(NOW + ahead)
    assert link.accepts(NOW + 59 * S)
    assert link.accepts(NOW + 59 * S + 20_000)
    assert link.pipeline.health(NOW).rejected["signed_ahead"] == 3
    (reason,) = link.reasons()  # once, however many
    assert "the clock of system 1, component 1 is ahead" in reason


@pytest.mark.parametrize(
    ("signed", "ours", "words"),
    [
        (NOW + YEAR, NOW, "system 1, component 1 is ahead of this computer's"),
        (NOW - HALF_A_YEAR, NOW, "system 1, component 1 is behind this computer's"),
        (NOW, 3_600 * S, "this computer's clock is not set, it says 1970-01-01 01:00"),
        (1_420_070_400 * S + 60 * S, NOW, "the clock of system 1, component 1 is not set"),
    ],
)
def test_it_is_said_which_clock_of_a_signed_link_is_wrong(signed: int, ours: int, words: str) -> None:
    link = Signed()
    assert not link.accepts(signed, arrival=ours)
    assert [words in reason for reason in link.reasons()] == [True]


def test_signatures_are_compared_with_the_clock_that_is_set() -> None:
    """The clock of arrivals is never set; a computer that starts half a year late is, by GPS, after its start."""
    link, began = Signed(), NOW - HALF_A_YEAR
    assert not link.accepts(NOW, arrival=began)  # not set yet
    assert link.accepts(NOW, arrival=began, step=HALF_A_YEAR)
    assert not Signed().accepts(began, arrival=began, step=HALF_A_YEAR)  # half a year old: a recording
    assert not Signed().accepts(began + 30 * S, arrival=began, step=HALF_A_YEAR)


FLIES = (
    *("FOLLOW_TARGET", "GLOBAL_POSITION_INT", "TARGET_RELATIVE", "LANDING_TARGET", "ADSB_VEHICLE"),
    *("COLLISION", "ODOMETRY"),
)


def asked(out: AutopilotOutput, command: int, *params: float, system: int = 66) -> list[Any]:
    """The daemon's answers to a command of that system."""
    message = replace(command_long(command, *params), system=system, component=66)
    parser = dialect.MAVLink(None)
    return [m for frame in out.respond(LINK, [message], NOW).frames for m in parser.parse_buffer(frame) or []]


@pytest.mark.parametrize("name", FLIES)
def test_a_stranger_does_not_change_what_flies_the_vehicle(name: str) -> None:
    refused: list[tuple[str, str, int]] = []
    out, number = everything(refuse=lambda *r: refused.append(r)), message_number(name)
    before = asked(out, 510, number)[1].interval_us
    for interval in (-1, 1_000_000, 0):
        (ack,) = asked(out, 511, number, interval)
        assert ack.result == 2, "MAV_RESULT_DENIED"
    assert asked(out, 510, number)[1].interval_us == before > 0
    assert out.take_lines() == []
    assert {(source, name in reason) for source, reason, _ in refused} == {("system 66, component 66", True)}
    (ack,) = asked(out, 511, number, -1, system=255)
    assert ack.result == 0
    assert out.take_lines() == [f"{name} off by system 255, component 66"]
    assert asked(out, 511, number, -1, system=255)[0].result == 0
    assert out.take_lines() == [], "nothing has changed"


def test_what_an_autopilot_may_follow_fuse_or_avoid_is_named() -> None:
    assert set(STEERING) == set(FLIES)
    assert Config().autopilot.trusted == ()


def test_a_refused_request_is_in_the_health() -> None:
    rows = {"leader_out": [{"link": "autopilot"}], "zenoh": {"enabled": False}}
    daemon = Daemon(parse_config(rows), report=lambda _: None)
    daemon._output.connect(AUTOPILOT)
    number = message_number("FOLLOW_TARGET")
    message = replace(command_long(511, number, -1), system=66, component=66)
    daemon._output.respond("autopilot", [message], NOW)
    (refusal,) = daemon._pipeline.health(NOW).refusals
    assert (refusal.source, refusal.count) == ("system 66, component 66", 1)
    assert "FOLLOW_TARGET" in refusal.reason
