"""Strangers on our ports: who holds no key, or is no system of ours, takes and changes nothing."""

import asyncio
import os
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace
from pymavlink.dialects.v20 import ardupilotmega as dialect

from onboard.autopilot.output import AutopilotOutput
from onboard.autopilot.rations import BYTES_PER_S, MAX_BYTES, MAX_SOURCE_COUNT, Rations
from onboard.autopilot.requests import STEERING
from onboard.config import Config, Storing, parse_config, read_stored
from onboard.daemon import Daemon
from onboard.links.link import close_all
from onboard.links.udp import UdpLink
from onboard.messages import Clock, Datagram, Encoding, Message, ParamAction, ParamRequest, Reason
from onboard.pipeline import Pipeline
from onboard.wire.mavlink.encode import MavlinkEncoder, message_number
from onboard.wire.mavlink.signing import Signer
from tests.support.emitted import LINK, answered, command_long, everything, sent
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
        (NOW, 3_600 * S, "this computer's clock shows 1970-01-01 01:00; set it"),
        (1_420_070_400 * S + 60 * S, NOW, "the clock of system 1, component 1 shows"),
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


REPEATED = {"fc": KEY, "gcs": KEY, "other": KEY[::-1]}


@pytest.mark.parametrize(("link", "why"), [("fc", "replayed"), ("gcs", "replayed"), ("other", "forged")])
@pytest.mark.parametrize("age_s", [0, 30], ids="{} s ago".format)
def test_a_signed_frame_that_is_repeated_on_any_link_is_no_news(
    link: str, why: str, age_s: int, tmp_path: Path
) -> None:
    """Through the daemon: a trusted command of a while ago is not obeyed, and teaches no address."""
    rows = []
    for name, key in REPEATED.items():
        (tmp_path / name).write_text(key.hex())
        (tmp_path / name).chmod(0o600)
        rows.append({"name": name, "url": "udpin:127.0.0.1:0", "key_file": str(tmp_path / name)})
    trusting: dict[str, Any] = {"link": rows, "autopilot": {"trusted": [255]}, "zenoh": {"enabled": False}}
    daemon, now = Daemon(parse_config(trusting), report=lambda _: None), NOW - age_s * S
    daemon._output.connect(AUTOPILOT)
    answers: list[bytes] = []
    daemon._send = lambda outgoing, _: answers.extend(f for o in outgoing for f in o.frames)
    command = dialect.MAVLink_command_long_message(7, 191, 511, 0, message_number("TIMESYNC"), -1, 0, 0, 0, 0, 0)
    frame = Signer(KEY, 3).sign(bytes(command.pack(dialect.MAVLink(None, srcSystem=255))), now)

    def delivered(channel: str, arrival: int) -> bool:
        datagram = Datagram(channel=channel, encoding=Encoding.MAVLINK, t_recv_ns=arrival, data=frame)
        return daemon._deliver(datagram)

    assert delivered("fc", now)
    assert len(answers) == 1
    assert not delivered(link, NOW)
    assert len(answers) == 1
    assert daemon._pipeline.health(NOW).rejected[why] == 1


@pytest.mark.parametrize("keys", [{}, {LINK: KEY}], ids=["plain", "signed"])
def test_what_we_send_is_refused_and_named_when_it_comes_back(keys: dict[str, bytes]) -> None:
    """By a router's loop or a stranger who repeats it: as ourselves, the virtual leader, or our camera."""
    out = everything(keys)
    pipeline = Pipeline(out._config, keys)

    def fed(frame: bytes) -> bool:
        data = out.signed(LINK, frame, NOW)
        return bool(pipeline.decode(Datagram(channel=LINK, encoding=Encoding.MAVLINK, t_recv_ns=NOW, data=data)))

    pipeline.advance([AUTOPILOT])
    frames = [*sent(out), *answered(out)]
    assert [fed(frame) for frame in frames] == [False] * len(frames)
    health = pipeline.health(NOW)
    assert health.rejected == {"our_own": len(frames)}
    named = {(r.source, r.reason.partition(",")[0]) for r in health.refusals}
    assert named == {
        (f"system {system}, component {component}", f"this is us: our frames come back on link `{LINK}`")
        for system, component in ((7, 191), (99, 191), (7, 100))
    }
    assert fed(MavlinkEncoder(7, 1).encode(heartbeat(0))), "the autopilot's"
    assert fed(MavlinkEncoder(8, 191).encode(heartbeat(0))), "another vehicle's"


def test_a_detector_may_have_our_component_id() -> None:
    """A program beside us with the same id, though the leader is sent as LANDING_TARGET, too."""
    out = everything()
    pipeline, made = Pipeline(out._config), list[Message]()
    pipeline.advance([AUTOPILOT])
    detector = dialect.MAVLink(None, srcSystem=7, srcComponent=191)
    for number in range(3):
        point = dialect.MAVLink_landing_target_message(1000, number, 8, 0.01 * number, 0, 0, 0, 0)
        data = bytes(point.pack(detector))
        made += pipeline.decode(Datagram(channel=LINK, encoding=Encoding.MAVLINK, t_recv_ns=NOW, data=data))
    assert [type(m).__name__ for m in made] == ["Exposure"]


FLIES = (
    "SET_POSITION_TARGET_LOCAL_NED",
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
    refused: list[tuple[str, Reason, int]] = []
    out, number = everything(refuse=lambda *r: refused.append(r)), message_number(name)
    before = asked(out, 510, number)[1].interval_us
    for interval in (-1, 1_000_000, 0):
        (ack,) = asked(out, 511, number, interval)
        assert ack.result == 2, "MAV_RESULT_DENIED"
    assert asked(out, 510, number)[1].interval_us == before > 0
    assert out.take_lines() == []
    assert {(source, name in why.words) for source, why, _ in refused} == {("system 66, component 66", True)}
    (ack,) = asked(out, 511, number, -1, system=255)
    if name == "SET_POSITION_TARGET_LOCAL_NED":
        assert ack.result == 2, "nobody stops the setpoints of a vehicle that flies on them"
        return
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


def asks(kind: str, system: int) -> Message:
    """A message whose answer is much longer."""
    who: dict[str, Any] = {"t_ns": NOW, "t_recv_ns": NOW, "clock": Clock.NONE, "system": system, "component": 66}
    to_us = {"target_system": 7, "target_component": 191}
    if kind in {"list", "extended list"}:
        return ParamRequest(**who, **to_us, action=ParamAction.LIST, extended=kind != "list")
    to = 100 if kind == "CAMERA_INFORMATION" else 191
    return replace(command_long(512, message_number(kind), component=to), system=system, component=66)


@pytest.mark.parametrize("kind", ["list", "extended list", "AUTOPILOT_VERSION", "CAMERA_INFORMATION"])
def test_answers_are_rationed_by_source_and_counted(kind: str) -> None:
    refused: list[tuple[str, Reason, int]] = []
    out = everything(refuse=lambda *r: refused.append(r))
    sent = 0
    for k in range(1000):  # in ten seconds
        sent += sum(map(len, out.respond(LINK, [asks(kind, 66)], NOW + 10 * k * 10**6).frames))
    assert BYTES_PER_S < sent / 10 < BYTES_PER_S + (MAX_BYTES + 4000) / 10
    assert {source for source, *_ in refused} == {"system 66, component 66"}
    assert out.respond(LINK, [asks("list", 255)], NOW + 10 * S).frames, "others are answered"


def test_strangers_without_number_share_one_ration() -> None:
    out = everything()
    answered = [out.respond(LINK, [asks("list", k % 250)], NOW + k).frames for k in range(2000)]
    sent = sum(len(frame) for frames in answered for frame in frames)
    assert sent < (MAX_SOURCE_COUNT + 1) * (MAX_BYTES + 2000)
    assert len(out._rations._remaining) <= MAX_SOURCE_COUNT + 1


def test_a_ration_is_whole_again_after_two_seconds_and_not_by_a_clock_that_goes_back() -> None:
    rations, m = Rations(), asks("list", 66)
    rations.spend(m, 2 * MAX_BYTES, NOW)
    assert not rations.admits(m, NOW)
    assert not rations.admits(m, NOW - 100 * S)
    assert not rations.admits(m, NOW + 2 * S)
    assert rations.admits(m, NOW + 2 * S + S // 1000)


def test_a_parameter_is_stored_beside_the_event_loop_and_of_several_the_newest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The disk is as slow as can be: it writes nothing until all has been asked for."""
    path, may_write, writers = tmp_path / "set.toml", threading.Event(), list[threading.Thread]()

    def fsync(_: int) -> None:
        writers.append(threading.current_thread())
        if writers[-1] is not threading.main_thread():
            may_write.wait()

    monkeypatch.setattr(os, "fsync", fsync)
    rows = {"parameters": {"path": str(path)}, "zenoh": {"enabled": False}}
    daemon = Daemon(parse_config(rows), report=lambda _: None)
    daemon._output.connect(AUTOPILOT)
    sets = replace(asks("list", 66), action=ParamAction.SET, name="CAM_SIGMA_PX")
    for k in range(1000):
        daemon._output.respond("autopilot", [replace(sets, value=1.0 + k / 1000)], NOW)
    assert not path.exists()
    kept = daemon._output._sessions["autopilot"]._parameters.value("CAM_SIGMA_PX")
    may_write.set()
    assert daemon._storing is not None
    daemon._storing.close()
    assert read_stored(path)["camera"]["sigma_px"] == kept
    assert 1 <= len(writers) <= 2
    assert threading.main_thread() not in writers
    assert 1.005 < kept < 1.05, "so many are set at once"


def test_a_full_disk_is_told_once_and_leaves_nothing_half_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fsync(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", fsync)
    storing = Storing(tmp_path / "set.toml")
    storing.put({"camera": {"f_px": 600.0}})
    storing.close()
    assert "cannot be stored" in (error := storing.take_error())
    assert "No space left on device" in error
    assert storing.take_error() == ""
    assert list(tmp_path.iterdir()) == []


def test_every_link_is_open_and_named_before_the_flight() -> None:
    lines: list[str] = []
    urls = ["udpin:127.0.0.1:0", "json:127.0.0.1:0"]
    rows = {"link": [{"name": f"l{i}", "url": url} for i, url in enumerate(urls)], "zenoh": {"enabled": False}}
    daemon = Daemon(parse_config(rows), report=lines.append)
    asyncio.run(daemon._open())
    try:
        assert lines == [f"link l{i}: {url}" for i, url in enumerate(urls)]
        assert all(isinstance(link, UdpLink) and link.address[1] > 0 for link in daemon._links)
    finally:
        for link in daemon._links:
            assert isinstance(link, UdpLink)
            close_all(link._sockets)
