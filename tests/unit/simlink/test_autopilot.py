from collections import Counter
from itertools import islice

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from onboard.messages import Command, CommandAck, Message, TimeSync
from simlink.autopilot import Autopilot, AutopilotLink
from simlink.scenarios.scenario import Scenario
from simlink.scenarios.vehicle import Rates, Vehicle
from simlink.simulation import boot_time_ns, ticks

MS = 1_000_000
UNIX = 1_700_000_000 * 10**9
HIGHRES_IMU, ATTITUDE_QUATERNION, AUTOPILOT_VERSION = 105, 31, 148


def command(number: int, *params: float, to: tuple[int, int] = (1, 1)) -> Command:
    seven = (*params, *(0.0,) * (7 - len(params)))
    return Command(
        t_ns=0,
        t_recv_ns=0,
        component=191,
        target_system=to[0],
        target_component=to[1],
        command=number,
        params=seven,
    )


def sent(
    autopilot: Autopilot, seconds: float, scenario: Scenario | None = None, skip: float = 0.0
) -> Counter[str]:
    scenario = scenario or Scenario()
    count: Counter[str] = Counter()
    run = ticks(scenario, 1, boot_time_ns(scenario))
    for tick in islice(run, round(skip * 200), round((skip + seconds) * 200)):
        count.update(type(m).__name__ for m in autopilot.due(tick.t_ns, tick.reading))
    return count


def fresh(vehicle: Vehicle | None = None) -> Autopilot:
    return Autopilot(vehicle or Vehicle(), UNIX)


def ack(replies: list[Message]) -> CommandAck:
    assert isinstance(replies[0], CommandAck)
    return replies[0]


def test_default_rates_seed_1() -> None:
    assert sent(fresh(), 4.0) == {
        "Heartbeat": 4,
        "SystemTime": 8,
        "Imu": 400,
        "Attitude": 200,
        "LocalPosition": 200,
        "GlobalPosition": 40,
        "GpsFix": 20,
        "ActuatorOutputs": 40,
    }


def test_set_message_interval_is_honoured_and_undone_seed_1() -> None:
    autopilot = fresh()
    assert ack(autopilot.answer(command(511, HIGHRES_IMU, 5000.0), 40_000 * MS)).result == 0
    assert ack(autopilot.answer(command(511, ATTITUDE_QUATERNION, -1.0), 40_000 * MS)).result == 0
    count = sent(autopilot, 2.0)
    assert (count["Imu"], count["Attitude"], count["LocalPosition"]) == (400, 0, 100)
    autopilot.answer(command(511, HIGHRES_IMU, 0.0), 42_000 * MS)
    autopilot.answer(command(511, ATTITUDE_QUATERNION, 100_000.0), 42_000 * MS)
    count = sent(autopilot, 2.0, skip=2.0)
    assert (count["Imu"], count["Attitude"]) == (200, 20)


@pytest.mark.parametrize("params", [(9999.0, 1000.0), (105.0, float("nan")), (105.0, -2.0), (float("nan"), 0.0)])
def test_a_bad_interval_is_denied_and_changes_nothing_seed_1(params: tuple[float, float]) -> None:
    autopilot = fresh()
    assert ack(autopilot.answer(command(511, *params), 40_000 * MS)).result == 2
    assert sent(autopilot, 1.0)["Imu"] == 100


def test_request_message_sends_it_once_seed_1() -> None:
    autopilot = fresh(Vehicle(rates=Rates(gps=0.0)))
    before_flight = autopilot.answer(command(512, 24.0), 39_000 * MS)
    assert [type(m).__name__ for m in before_flight] == ["CommandAck"]
    assert ack(before_flight).result == 4
    sent(autopilot, 1.0)
    replies = autopilot.answer(command(512, 24.0), 41_000 * MS)
    assert [type(m).__name__ for m in replies] == ["CommandAck", "GpsFix"]
    assert ack(replies).result == 0
    assert ack(autopilot.answer(command(512, float(AUTOPILOT_VERSION)), 41_000 * MS)).result == 2


@pytest.mark.parametrize("number", [16, 22, 176, 400, 42429])
def test_unknown_commands_are_acknowledged_as_unsupported(number: int) -> None:
    reply = ack(fresh().answer(command(number, 1.0), 40_000 * MS))
    assert (reply.command, reply.result) == (number, 3)
    assert (reply.target_system, reply.target_component) == (1, 191)


@pytest.mark.parametrize(("to", "answers"), [((0, 0), 1), ((1, 0), 1), ((2, 1), 0), ((1, 191), 0)])
def test_only_commands_addressed_to_it_are_answered(to: tuple[int, int], answers: int) -> None:
    assert len(fresh().answer(command(400, to=to), 0)) == answers


def test_timesync_requests_are_answered_and_replies_are_not() -> None:
    request = TimeSync(t_ns=0, t_recv_ns=0, tc1_ns=0, ts1_ns=123_456_789)
    (reply,) = fresh().answer(request, 41_000_000_123)
    assert isinstance(reply, TimeSync)
    assert (reply.tc1_ns, reply.ts1_ns) == (41_000_000_123, 123_456_789)
    assert fresh().answer(reply, 42_000_000_000) == []


@pytest.mark.parametrize("form", ["long", "int"])
def test_the_bytes_are_what_pymavlink_reads_and_writes(form: str) -> None:
    link = AutopilotLink(Vehicle(system=7), UNIX, stream=False)
    peer = dialect.MAVLink(None, srcSystem=255, srcComponent=190)
    if form == "long":
        asked = dialect.MAVLink_command_long_message(7, 1, 511, 0, 105, 5000, 0, 0, 0, 0, 0)
    else:
        asked = dialect.MAVLink_command_int_message(7, 1, 0, 511, 0, 0, 105, 5000, 0, 0, 0, 0, 0)
    (frame,) = link.receive(asked.pack(peer), 40_000 * MS)
    (reply,) = peer.parse_buffer(frame)
    assert (reply.get_type(), reply.command, reply.result) == ("COMMAND_ACK", 511, 0)
    assert (reply.get_srcSystem(), reply.get_srcComponent()) == (7, 1)
    assert (reply.target_system, reply.target_component) == (255, 190)


def test_the_values_on_the_wire_are_the_worlds_seed_1() -> None:
    scenario = Scenario()
    link = AutopilotLink(scenario.vehicle, UNIX, stream=False)
    (tick,) = islice(ticks(scenario, 1, boot_time_ns(scenario)), 1)
    peer = dialect.MAVLink(None)
    got = {m.get_type(): m for m in (peer.parse_buffer(f)[0] for f in link.send(tick.t_ns, tick.reading))}
    assert got["SYSTEM_TIME"].time_boot_ms == 40_000
    assert got["SYSTEM_TIME"].time_unix_usec == 1_700_000_040_000_000
    local = got["LOCAL_POSITION_NED"]
    assert (local.x, local.y, local.z) == pytest.approx(tick.state.r_OF_n, rel=1e-6)
    assert (local.vx, local.vy, local.vz) == pytest.approx(tick.state.v_F_n, rel=1e-6)
    # 1e-7 degree of latitude is 1.11 cm; one metre north is 89.9 of them
    metres = (got["GLOBAL_POSITION_INT"].lat - 473977420) * 0.0111132
    assert metres == pytest.approx(tick.state.r_OF_n[0], rel=2e-3)
    assert got["GLOBAL_POSITION_INT"].alt == pytest.approx((488.0 - tick.state.r_OF_n[2]) * 1000, abs=2)
    assert got["HIGHRES_IMU"].zacc == pytest.approx(tick.state.f_b[2], abs=0.1)
