"""The conversation with the autopilot, frame by frame, as an independent parser reads it."""

from collections import Counter
from typing import Any

import pytest
from msgspec.structs import replace
from pymavlink.dialects.v20 import ardupilotmega as dialect

from onboard import __version__
from onboard.autopilot.output import AutopilotOutput
from onboard.autopilot.session import Session
from onboard.config import AutopilotConfig, Config, parse_config
from onboard.messages import Clock, Command, CommandAck, FollowTarget, Heartbeat, ParamValue, Ping, TimeSync
from onboard.messages.causes import Cause
from onboard.messages.vehicle import TIMESYNC_TAG_NS
from tests.support.emitted import command_long

MS = 1_000_000
S = 1_000_000_000
T0 = 1_700_000_000 * S + 123_456
AUTOPILOT = Heartbeat(
    t_ns=T0,
    t_recv_ns=T0,
    clock=Clock.NONE,
    system=42,
    component=1,
    vehicle_type=2,
    autopilot=3,
    armed=True,
    status=4,
)
SLOW: dict[str, float] = {}
STATUS = {"EKF_STATUS_REPORT", "ESTIMATOR_STATUS", "ODOMETRY"}
FAST = {name: rate * 0.95 for name, rate in AutopilotConfig().rates_hz.items()}


def parsed(frames: list[bytes]) -> list[Any]:
    parser = dialect.MAVLink(None)
    return [m for frame in frames for m in parser.parse_buffer(frame) or []]


def connected(config: AutopilotConfig | None = None) -> Session:
    session = Session(config or AutopilotConfig())
    session.connect(AUTOPILOT)
    return session


def talk(
    session: Session, begin: float, end: float, rates: dict[str, float], *, healthy: bool = True
) -> list[tuple[float, Any]]:
    """(s, message) of what it says between two times, asked every 50 ms as the daemon does."""
    sent = []
    for t in range(round(begin * 1000), round(end * 1000), 50):
        frames = session.tick(T0 + t * MS, healthy=healthy, rates=rates)
        sent += [(t / 1000, m) for m in parsed(frames)]
    return sent


def command(number: int, *params: float, system: int = 42, component: int = 191) -> Command:
    return command_long(number, *params, t_ns=T0, system=system, component=component)


def request(t_recv_ns: int, *, system: int = 42) -> TimeSync:
    return TimeSync(
        t_ns=t_recv_ns, t_recv_ns=t_recv_ns, clock=Clock.NONE, system=system, component=1, tc1_ns=0, ts1_ns=77
    )


def test_nothing_is_said_before_an_autopilot_is_heard() -> None:
    session = Session(AutopilotConfig())
    assert talk(session, 0, 10, SLOW) == []
    assert session.respond([request(T0), command(512, 0.0)], T0) == []


@pytest.mark.parametrize(
    ("url", "system", "first"),
    [
        ("udpout:127.0.0.1:1", 0, [1] * 3),
        ("serial:/dev/ttyACM0:115200", 0, [1] * 3),
        ("tcp:127.0.0.1:1", 7, [7] * 3),
        ("udpin:127.0.0.1:1", 0, []),
        ("tcpin:127.0.0.1:1", 0, []),
        ("json:127.0.0.1:1", 0, []),
    ],
)
def test_heartbeats_go_out_from_the_start_where_we_do_not_listen(url: str, system: int, first: list[int]) -> None:
    """PX4 on USB, and UDP servers, were silent for ever: they speak only to who has spoken."""
    config = {"autopilot": {"system": system}, "link": [{"name": "a", "url": url}]}
    out = AutopilotOutput(parse_config(config))
    request_of_us = [command(512, 0.0, system=system or 1), request(T0)]

    def said(begin: int) -> list[Any]:
        ticks = (out.tick(T0 + t * MS, healthy=False, rates=FAST) for t in range(begin, begin + 3000, 50))
        return parsed([frame for tick in ticks for outgoing in tick for frame in outgoing.frames])

    assert [(m.get_type(), m.get_srcSystem()) for m in said(0)] == [("HEARTBEAT", one) for one in first]
    if out.is_autopilot("a"):
        assert not out.respond("a", request_of_us, T0).frames
    out.connect(AUTOPILOT)
    after = [m.get_srcSystem() for m in said(3000) if m.get_type() == "HEARTBEAT"]
    assert after == ([] if url.startswith("json") else [AUTOPILOT.system] * 3)


def test_heartbeat_once_a_second_as_an_onboard_controller_of_the_autopilots_system() -> None:
    sent = talk(connected(), 0, 10, FAST)
    beats = [(t, m) for t, m in sent if m.get_type() == "HEARTBEAT"]
    assert [t for t, _ in beats] == [float(i) for i in range(10)]
    for _, m in beats:
        assert (m.get_srcSystem(), m.get_srcComponent()) == (42, 191)
        assert (m.type, m.autopilot, m.system_status) == (18, 8, 4)


def test_timesync_five_times_a_second_tagged_as_ours() -> None:
    requests = [(t, m) for t, m in talk(connected(), 0, 4, FAST) if m.get_type() == "TIMESYNC"]
    assert len(requests) == 20
    for t, m in requests:
        assert m.tc1 == 0
        assert m.ts1 % 1000 == TIMESYNC_TAG_NS == 191
        assert abs(m.ts1 - (T0 + round(t * 1000) * MS)) < 1000


def test_only_slow_streams_are_asked_for() -> None:
    """A stream at 69 % of what is wanted is slow, at 71 % it is not."""
    wanted = AutopilotConfig().rates_hz
    for share, asked in ((0.69, set(wanted)), (0.71, set())):
        rates = {name: rate * share for name, rate in wanted.items()}
        assert {n for n, _ in requests_of(talk(connected(), 0, 1, rates))} == asked
    one_slow = {**FAST, "GPS_RAW_INT": 5.0}
    assert requests_of(talk(connected(), 0, 1, one_slow)) == [("GPS_RAW_INT", 100_000.0)]


def requests_of(sent: list[tuple[float, Any]]) -> list[tuple[str, float]]:
    """(name, us) of each SET_MESSAGE_INTERVAL, but for the filter's status."""
    found = []
    for _, m in sent:
        if m.get_type() == "COMMAND_LONG":
            assert (m.command, m.target_system, m.target_component) == (511, 42, 1)
            found.append((dialect.mavlink_map[int(m.param1)].msgname, m.param2))
    return [(name, interval_us) for name, interval_us in found if name not in STATUS]


@pytest.mark.parametrize(
    ("autopilot", "names"), [(3, ["EKF_STATUS_REPORT"]), (12, ["ESTIMATOR_STATUS", "ODOMETRY"])]
)
def test_the_status_of_the_autopilots_filter_is_asked_for_once_per_boot(autopilot: int, names: list[str]) -> None:
    session = Session(AutopilotConfig())
    session.connect(replace(AUTOPILOT, autopilot=autopilot))
    for start in (0, 20):
        sent = talk(session, start, start + 20, FAST)
        asked = [(t, m) for t, m in sent if m.get_type() == "COMMAND_LONG"]
        found = [(t, dialect.mavlink_map[int(m.param1)].msgname) for t, m in asked]
        assert found == [(float(start), name) for name in names]
        session.reboot()


def test_a_parameter_is_asked_for_until_it_comes_three_times_a_boot() -> None:
    session = Session(AutopilotConfig())
    session.connect(AUTOPILOT, ("WPNAV_SPEED", "WP_SPD"))

    def asked(begin: float) -> list[tuple[float, str]]:
        sent = [(t, m) for t, m in talk(session, begin, begin + 60, FAST) if m.get_type() == "PARAM_REQUEST_READ"]
        assert all((m.target_system, m.target_component, m.param_index) == (42, 1, -1) for _, m in sent)
        return [(t - begin, m.param_id) for t, m in sent]

    names = ("WPNAV_SPEED", "WP_SPD")
    assert asked(0) == [(t, name) for t in (0.0, 5.0, 10.0) for name in names]
    session.reboot()
    value = ParamValue(
        t_ns=T0, t_recv_ns=T0, clock=Clock.NONE, system=42, extended=False, name="WP_SPD", value=9.0
    )
    session.respond([replace(value, name="WP_SPD_UP")], T0)
    assert len(asked(60)) == 6
    session.reboot()
    others = [replace(value, name=name, system=s, component=c) for s, c in ((66, 1), (42, 66)) for name in names]
    session.respond(others, T0)
    session.respond([value], T0)
    assert asked(120) == [(t, "WPNAV_SPEED") for t in (0.0, 5.0, 10.0)]


def test_slow_streams_are_asked_for_every_five_seconds_until_they_are_fast() -> None:
    session = connected()
    asked = [t for t, m in talk(session, 0, 12, SLOW) if m.get_type() == "COMMAND_LONG"]
    assert Counter(asked) == {0.0: 6, 5.0: 5, 10.0: 5}
    assert requests_of(talk(session, 12, 30, FAST)) == []


def test_rates_are_asked_for_at_once_after_a_reboot() -> None:
    session = connected()
    talk(session, 0, 1, SLOW)
    assert requests_of(talk(session, 1, 2, SLOW)) == []
    session.reboot()
    assert len(requests_of(talk(session, 2, 2.1, SLOW))) == 5


def test_timesync_request_of_the_autopilot_is_answered_with_our_clock() -> None:
    (reply,) = parsed(connected().respond([request(T0)], T0 + 5 * MS))
    assert reply.get_type() == "TIMESYNC"
    assert (reply.tc1, reply.ts1) == (T0 + 5 * MS, 77)


def test_timesync_of_others_is_answered_but_no_reply_is() -> None:
    session = connected()
    (reply,) = parsed(session.respond([request(T0, system=255)], T0))
    assert (reply.tc1, reply.ts1) == (T0, 77)
    assert session.respond([replace(request(T0), tc1_ns=12345)], T0) == []


def test_a_ping_is_answered_to_its_sender_and_an_answer_is_not() -> None:
    times = {"t_ns": T0, "t_recv_ns": T0, "clock": Clock.NONE, "system": 255, "component": 190}
    ping = Ping(**times, time_us=123, number=9, target_system=0, target_component=0)
    (pong,) = parsed(connected().respond([ping], T0))
    assert pong.get_type() == "PING"
    assert (pong.time_usec, pong.seq, pong.target_system, pong.target_component) == (123, 9, 255, 190)
    assert connected().respond([replace(ping, target_system=42)], T0) == []


def test_our_version_is_told_on_request() -> None:
    output = AutopilotOutput(Config())
    output.connect(AUTOPILOT)
    ack, version = parsed(output.respond("autopilot", [command(512, 148.0)], T0).frames)
    assert (ack.result, version.get_type()) == (0, "AUTOPILOT_VERSION")
    major, minor, patch = (int(x) for x in __version__.split("."))
    assert version.flight_sw_version == major << 24 | minor << 16 | patch << 8 | 255
    assert version.capabilities & dialect.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST


def test_a_refused_message_rate_is_named_in_the_health() -> None:
    refused: list[str] = []
    output = AutopilotOutput(Config(), refuse=lambda _source, why, _t_ns: refused.append(why.words))
    output.connect(AUTOPILOT)
    times = {"t_ns": T0, "t_recv_ns": T0, "clock": Clock.NONE, "system": 42, "component": 1}
    ack = CommandAck(**times, target_system=42, target_component=191, command=511, result=3)
    accepted, others = replace(ack, result=0), replace(ack, target_component=190)
    strange, camera = replace(ack, system=66), replace(ack, component=100)
    for _ in output.tick(T0 - S, healthy=True, rates=SLOW):
        pass  # requests, that of the filter's status among them, which may be refused
    for answer, count in ((accepted, 0), (others, 0), (ack, 0), (strange, 0), (camera, 0), (ack, 1), (ack, 2)):
        assert output.respond("autopilot", [answer], T0).frames == []
        assert len(refused) == count
    assert refused[0] == "the autopilot refuses a message rate (MAV_RESULT 3)"


@pytest.mark.parametrize(("name", "named"), [("FOLLOW_TARGET", 1), ("ADSB_VEHICLE", 0)])
def test_a_follow_target_of_another_beside_ours_is_named(name: str, named: int) -> None:
    """PX4 obeys any sender: a ground station's of (0, 0) takes the vehicle away."""
    refused: list[tuple[str, str]] = []
    config = parse_config({"leader_out": [{"link": "autopilot", "system": 200, "rates_hz": {name: 10.0}}]})
    output = AutopilotOutput(config, refuse=lambda source, why, _t_ns: refused.append((source, why.cause)))
    output.connect(AUTOPILOT)
    head = {"t_ns": T0, "t_recv_ns": T0, "clock": Clock.NONE, "system": 255, "component": 190}
    target = FollowTarget(
        **head, lat_deg=0.0, lon_deg=0.0, alt_msl=0.0, v_n=(0.0,) * 3, q_nL=None, position_sigma=(0.0,) * 3
    )
    output.respond("autopilot", [target], T0)
    assert refused == [("system 255, component 190", Cause.OTHER_TARGET)] * named


def test_command_to_us_is_refused_and_said_so() -> None:
    (ack,) = parsed(connected().respond([command(400, 1.0)], T0))  # arm
    assert ack.get_type() == "COMMAND_ACK"
    assert (ack.command, ack.result) == (400, 3)
    assert (ack.target_system, ack.target_component) == (255, 190)


def test_request_for_our_heartbeat_is_accepted_and_brings_one_at_once() -> None:
    session = connected()
    talk(session, 0, 0.1, FAST)
    (ack,) = parsed(session.respond([command(512, 0.0)], T0 + 100 * MS))
    assert (ack.command, ack.result) == (512, 0)
    assert any(m.get_type() == "HEARTBEAT" for _, m in talk(session, 0.1, 0.2, FAST))
    (refused,) = parsed(session.respond([command(512, 149.0)], T0))
    assert refused.result == 3


@pytest.mark.parametrize(("system", "component"), [(42, 1), (42, 0), (43, 191), (0, 0)])
def test_command_to_others_or_to_all_is_left_to_them(system: int, component: int) -> None:
    assert connected().respond([command(400, 1.0, system=system, component=component)], T0) == []
